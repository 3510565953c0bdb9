"""Which properties of hysteresis the laws of the paper have, printed and found."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..library import VARIABLES
from ..models import AbstractModel, SparseModel
from ..recording import Recording
from ..simulation.properties import Drive, Properties, examine
from . import _devices, _noise, _simulated
from ._document import AbstractDocument, shown_share
from ._published import (
    EXPERIMENT_1,
    EXPERIMENT_2,
    EXPERIMENT_4,
    EXPERIMENT_5,
    EXPERIMENT_7,
    Entry,
    copied,
    experiment_3_setup,
    learned,
    noisy_as_published,
    refined,
)
from ._simulated import UNFIT_ENTRIES

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
    for samples, entries in _simulated.SIZE_ENTRIES.items():
        record = experiment_3_setup(samples).record()
        yield _tabled(f"3, N = {samples}", record, entries)
    for level, entries in _noise.ENTRIES.items():
        record = noisy_as_published(EXPERIMENT_4.record(), level)
        yield _tabled(f"4, {100 * level:g} %", record, entries)
    yield _tabled("5", EXPERIMENT_5.record(), UNFIT_ENTRIES)
    yield _actuator()
    inner = EXPERIMENT_7.record()
    printed = {_SINDY: _simulated.COPIED_BUTTERFLY}
    yield Family("7, law of y", inner, printed, _simulated.inner_law(inner))
    loop = _devices.steel_loop()
    law = learned(loop, threshold=0.01)
    yield Family(
        "8, steel", loop, {_SINDY: _devices.COPIED_STEEL}, law, {"fading": True}
    )


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
    record = _devices.piezo(35001, 45001)
    law = learned(record, threshold=0.01)
    printed = {_SINDY: _devices.COPIED_PIEZO}
    return Family("6, piezo", record, printed, law, {"free_start": True})


_MEASURES = (
    "rate dependence",
    "least slope",
    "incongruency",
    "memory loss",
    "loop area",
    "unclosed",
)
_NOTES = (
    "The input runs along straight lines over the range of the record at its mean "
    "speed; the loop is the one after 19 cycles. See hystjax.properties for what "
    "the columns are; slope and area are relative to the rectangle about the "
    "loop, unclosed to its height.",
    "Rate dependence compares a quarter of the speed, the speed, and four times "
    "it. Laws with terms of degree one in u' and |u'| alone have none: all but "
    "those of the piezo and of the steel, whose records, at one frequency, cannot "
    "tell the two kinds apart.",
    "No law keeps return points: all forget, as the input moves or, of the piezo, "
    "as time passes. Where beta times the width of the excursion is large (1 and "
    "5), what is left is small; elsewhere a minor loop misses its return point by "
    "0.5 to 8 % of the range. Minor loops converge to one shape after a cycle or "
    "more, so incongruency is smaller. The features of another law (5) change "
    "this: 9 % is lost in place of 1e-5 %.",
    "A negative least slope is an output that runs on for a while after the input "
    "has turned: the Duhem laws of 1 and 7 do. In 4 the true law does by 1 %, and "
    "noise and rounding decide what the published ones do. A negative area is an "
    "output that lags (1, 4, 6, 7).",
    "The steel's laws follow their record and diverge here, the refined one too, "
    "although it forgets its initial value on the record: straight lines in place "
    "of a sine, or another speed, are enough. Diffrax with error control says the "
    "same.",
)


@dataclass(frozen=True)
class Examined:
    """A law's properties.

    **Attributes:** `family`, the experiment; `law`, how it was found; its `equation`;
    its `properties`.
    """

    family: str
    law: str
    equation: str
    properties: Properties


@dataclass(frozen=True)
class PropertyTable(AbstractDocument):
    """The properties of many laws."""

    rows: tuple[Examined, ...]

    def cells(self):
        """Headings, and a line a law."""
        return [("experiment", "law", *_MEASURES), *map(_cells, self.rows)]


def properties() -> PropertyTable:
    """Examine every law of experiments 1 to 8: published, learned and refined.

    **Raises:** `InputError` when a recording cannot be had.
    """
    title = "Properties of laws over the input range of their records, in %"
    rows = tuple(row for family in catalogue() for row in _examined(family))
    return PropertyTable(title, rows, _NOTES)


def _examined(family: Family):
    drive = Drive.like(family.record)
    for name, law in family.laws():
        yield Examined(family.name, name, str(law), examine(law, drive))


def _cells(row: Examined) -> list[str]:
    found = row.properties
    work = found.dissipation
    numbers = (
        found.rate_dependence,
        np.minimum(*found.steepness),
        found.incongruency,
        found.memory_loss,
        work.share[-1, 0],
        work.closure[-1, 0],
    )
    return [row.family, row.law, *(shown_share(float(x)) for x in numbers)]
