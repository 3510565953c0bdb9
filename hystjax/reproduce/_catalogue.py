"""Every law of the paper, printed and found, with the record that it is for."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from .._recording import Recording
from ..library import VARIABLES
from ..models import AbstractModel, SparseModel
from . import _butterfly, _noise, _piezo, _simulated, _steel, _training_size
from ._published import copied, learned, refined
from ._records import (
    EXPERIMENT_1,
    EXPERIMENT_2,
    EXPERIMENT_4,
    EXPERIMENT_5,
    EXPERIMENT_7,
    experiment_3_setup,
    noisy_as_published,
)
from ._rivals import Entry
from ._wrong_features import ENTRIES as WRONG_FEATURES

_SINDY = "SINDy"


@dataclass(frozen=True)
class Family:
    """The laws for one record.

    **Attributes:**

    - `name`: number of the experiment, and which of its records.
    - `record`: what the laws are for.
    - `published`: coefficients that the paper's scripts simulate with, by method.
    - `learned`: by regression, with the paper's settings.
    - `settings`: of its refinement.
    """

    name: str
    record: Recording
    published: Mapping[str, Mapping[str, float]]
    learned: SparseModel
    settings: Mapping[str, Any] = field(default_factory=dict)

    def laws(self) -> Iterator[tuple[str, AbstractModel]]:
        """How each law was found, and the law."""
        for method, terms in self.published.items():
            yield f"published, {method}", copied(terms, self.record)
        yield "learned", self.learned
        yield "refined", refined(self.learned, self.record, **self.settings)


def catalogue() -> Iterator[Family]:
    """The laws of experiments 1 to 8.

    **Raises:** `InputError` when a recording cannot be had.
    """
    yield from _found_again()
    for samples, entries in _training_size.ENTRIES.items():
        record = experiment_3_setup(samples).record()
        yield _tabled(f"3, N = {samples}", record, entries)
    for level, entries in _noise.ENTRIES.items():
        record = noisy_as_published(EXPERIMENT_4.record(), level)
        yield _tabled(f"4, {100 * level:g} %", record, entries)
    yield _tabled("5", EXPERIMENT_5.record(), WRONG_FEATURES)
    yield _actuator()
    inner = EXPERIMENT_7.record()
    printed = {_SINDY: _butterfly.COPIED}
    yield Family("7, law of y", inner, printed, _butterfly.inner_law(inner))
    loop = _steel.steel_loop()
    law = learned(loop, threshold=0.01)
    yield Family("8, steel", loop, {_SINDY: _steel.COPIED}, law, {"fading": True})


def _found_again() -> Iterator[Family]:
    cases = ((1, EXPERIMENT_1, VARIABLES[:4]), (2, EXPERIMENT_2, VARIABLES))
    for number, setup, variables in cases:
        record = setup.record()
        printed = {_SINDY: _simulated.COPIED[number]}
        yield Family(str(number), record, printed, learned(record, variables=variables))


def _tabled(name: str, record: Recording, entries: Mapping[str, Entry]) -> Family:
    printed = {method: entry.terms for method, entry in entries.items()}
    return Family(name, record, printed, learned(record))


def _actuator() -> Family:
    record = _piezo.piezo(35001, 45001)
    law = learned(record, threshold=0.01)
    printed = {_SINDY: _piezo.COPIED}
    return Family("6, piezo", record, printed, law, {"free_start": True})
