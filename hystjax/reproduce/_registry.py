"""What `hystjax reproduce` can print."""

from collections.abc import Callable, Mapping
from typing import Protocol, runtime_checkable

from .._errors import InputError
from ._cramer_rao import certainty
from ._experiments import experiment_1, experiment_2, experiment_6
from ._measured import measured
from ._oscillator import boucwen


@runtime_checkable
class Table(Protocol):
    """A result that prints."""

    def text(self) -> str:
        """The table for a terminal."""
        ...


EXPERIMENTS: Mapping[str, Callable[[], Table]] = {
    "1": experiment_1,
    "2": experiment_2,
    "6": experiment_6,
}
"""Experiments of the source paper, by number."""

STUDIES: Mapping[str, Callable[[], Table]] = {
    "boucwen": boucwen,
    "certainty": certainty,
    "measured": measured,
}
"""Studies of what the paper does not do, by name."""


def reproduce(name: int | str) -> Table:
    """Rerun an experiment of the paper with its settings, or another study.

    **Arguments:** `name`: a number of `EXPERIMENTS` or a name of `STUDIES`.

    **Raises:** `InputError` for another name, or when a recording cannot be had.
    """
    known = {**EXPERIMENTS, **STUDIES}
    if str(name) not in known:
        raise InputError(
            f"there is no experiment {name!r} to reproduce; choose from "
            f"{', '.join(known)}."
        )
    return known[str(name)]()
