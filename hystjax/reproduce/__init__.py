"""The source paper's experiments, rerun, and studies of what it does not do."""

from collections.abc import Callable, Mapping

from matplotlib.figure import Figure

from .._core import checks
from .._core.checks import InputError
from . import baselines
from ._classical import classical, steel_models
from ._devices import experiment_6, experiment_8, table_3
from ._document import AbstractDocument, Comparison, Row, write
from ._hybrid import hybrid
from ._inverses import compensation, voltages
from ._measured import measured, memory, sizes
from ._noise import experiment_4, outliers
from ._oscillators import boucwen, hidden
from ._properties import properties
from ._published import duhem_growing_sine, published_settings
from ._simulated import (
    butterflies,
    experiment_1,
    experiment_2,
    experiment_3,
    experiment_5,
    experiment_7,
)
from ._trust import certainty, choice, families

__all__ = [
    "EXPERIMENTS",
    "STUDIES",
    "TABLES",
    "AbstractDocument",
    "Comparison",
    "Row",
    "baselines",
    "boucwen",
    "certainty",
    "duhem_growing_sine",
    "figure",
    "measured",
    "published_settings",
    "reproduce",
    "table_3",
    "write",
]


def __dir__() -> list[str]:
    return __all__


EXPERIMENTS: Mapping[str, Callable[[], Comparison]] = {
    "1": experiment_1,
    "2": experiment_2,
    "3": experiment_3,
    "4": experiment_4,
    "5": experiment_5,
    "6": experiment_6,
    "7": experiment_7,
    "8": experiment_8,
}
"""Experiments of the source paper, by number."""

TABLES: Mapping[str, Callable[..., AbstractDocument]] = {
    "3": experiment_3,
    "4": experiment_4,
    "table3": table_3,
}
"""The paper's Tables I, II and III: two experiments, and one more by its name. They
train networks, for at most so many epochs as they are called with."""

STUDIES: Mapping[str, Callable[[], AbstractDocument]] = {
    "boucwen": boucwen,
    "butterflies": butterflies,
    "certainty": certainty,
    "choice": choice,
    "classical": classical,
    "control": compensation,
    "families": families,
    "hidden": hidden,
    "hybrid": hybrid,
    "measured": measured,
    "memory": memory,
    "outliers": outliers,
    "properties": properties,
    "sizes": sizes,
    "steel_models": steel_models,
    "voltages": voltages,
}
"""Studies of what the paper does not do, by name."""


def figure(name: int | str) -> Figure:
    """Rerun an experiment, 1 to 8, and draw it: the paper's figure beside one that
    shows how good its laws, and refined ones, are on what they were not fitted on.

    Where the table is wanted too, `reproduce(name).drawing()` runs the experiment once.

    **Arguments:** `name`: a key of `EXPERIMENTS`.

    **Raises:** `InputError` for another name, or when a recording cannot be had.
    """
    if str(name) not in EXPERIMENTS:
        raise InputError(
            f"there is no figure {name!r}; choose from {', '.join(EXPERIMENTS)}."
        )
    drawing = EXPERIMENTS[str(name)]().drawing
    assert drawing is not None  # experiments have one, all of them
    return drawing()


def reproduce(name: int | str, *, epochs: int | None = None) -> AbstractDocument:
    """Rerun an experiment of the paper with its settings, or another study.

    **Arguments:**

    - `name`: a key of `EXPERIMENTS`, `TABLES` or `STUDIES`.
    - `epochs`: of `TABLES`, most epochs of a network's training (Table III: of each
        stage), for a quick look; all by default.

    **Raises:** `InputError` for another name, for `epochs` that are no count or where
    no network is trained, or when a recording cannot be had.
    """
    known = {**EXPERIMENTS, **TABLES, **STUDIES}
    if str(name) not in known:
        raise InputError(
            f"there is no experiment {name!r} to reproduce; choose from "
            f"{', '.join(known)}."
        )
    if epochs is None:
        return known[str(name)]()
    if str(name) not in TABLES:
        raise InputError(
            f"`epochs` is for those that train networks, {', '.join(TABLES)}; leave it "
            f"out for {name!r}."
        )
    return TABLES[str(name)](checks.count("epochs", epochs))
