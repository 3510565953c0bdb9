"""Classical models of grain-oriented steel, fitted to some of its loops and judged on
the others."""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import jax
import numpy as np

from ..comparison import compare
from ..models import AbstractModel, JilesAtherton, Tellinen
from ..recording import Recording, datasets
from ..refinement import LevenbergMarquardt, refine
from ..simulation import judge
from ._document import AbstractDocument, shown

LOOPS = ("0.43T", "0.95T", "1.50T")
MODELS: Mapping[str, Callable[[Recording], AbstractModel]] = {
    "JilesAtherton": JilesAtherton.guess,
    "Tellinen": Tellinen.guess,
}
_LINEAR = "Everett"  # linear in its numbers: no starts, and the one minimum there is
_STARTS = 10  # of fits to all loops
_SAME = 1e-4  # relative, of losses at the same minimum
# The last digits of a loss take as many steps again, along a curved valley.
_SETTINGS: Mapping[str, Any] = {
    "solver": LevenbergMarquardt(rtol=1e-7),
    "substeps": 2,
    "throw": False,
}
_HEADINGS = ("model", "fitted", "own, %", "unseen", "unseen, %")
_NOTES = (
    "NRMSE over the range of each loop, the mean of own loops; free runs from the "
    "first measured flux density. Everett is Preisach's operator by a smooth function "
    "of each play, on a grid that is read off the widest loop.",
)


@dataclass(frozen=True)
class Judged:
    """A model fitted to some loops.

    **Attributes:** the `name` and the `model`; the loops that were `fitted`, and their
    error `own`; the one that was not, `unseen`, with its `error`; errors in per cent,
    and none where all were fitted.
    """

    name: str
    model: AbstractModel
    fitted: tuple[str, ...]
    own: float
    unseen: str | None = None
    error: float | None = None


@dataclass(frozen=True)
class SteelTable(AbstractDocument):
    """All models, and all choices of loops."""

    rows: tuple[Judged, ...]

    def cells(self):
        """Headings, and a line a fit."""
        return [_HEADINGS, *map(_cells, self.rows)]


def steel_models() -> SteelTable:
    """Fit each model to two of three loops, all choices, and to all three from ten
    starts.

    **Raises:** `InputError` when a recording cannot be had.
    """
    loops = {name: datasets.load("steel_m130_27s", name) for name in LOOPS}
    rows, notes = [], list(_NOTES)
    for name in MODELS:
        found, note = together(name, loops)
        rows += [*(left_out(name, loops, each) for each in LOOPS), found]
        notes += [note, str(found.model)]
    rows += [left_out(_LINEAR, loops, each) for each in (*LOOPS, None)]
    title = "Models of M130-27s steel, NRMSE in %"
    return SteelTable(title, tuple(rows), tuple(notes))


def left_out(name: str, loops: Mapping[str, Recording], unseen: str | None) -> Judged:
    """One model, fitted to all loops but one, or to all, and judged on that."""
    own = tuple(each for each in loops if each != unseen)
    fitted = [loops[each] for each in own]
    if name == _LINEAR:
        model = compare(fitted, families=[name]).best.model
    else:
        model = refine(_guess(name, fitted), fitted, **_SETTINGS).value
    errors = float(np.mean([_error(model, each) for each in fitted]))
    missed = None if unseen is None else _error(model, loops[unseen])
    return Judged(name, model, own, errors, unseen, missed)


def together(name: str, loops: Mapping[str, Recording]) -> tuple[Judged, str]:
    """One model, fitted to all loops from several starts; and how many of them lead to
    the best minimum, in what time."""
    fitted = list(loops.values())
    begun = time.perf_counter()
    solution = refine(
        _guess(name, fitted),
        fitted,
        starts=_STARTS,
        key=jax.random.key(0),
        **_SETTINGS,
    )
    losses = np.asarray(solution.stats["losses"])
    taken = time.perf_counter() - begun
    same = int(np.sum(losses <= (1 + _SAME) * losses.min()))
    model = solution.value
    own = float(np.mean([_error(model, each) for each in fitted]))
    note = (
        f"{name}, all loops: {same} of {_STARTS} starts, numbers off by up to 50 % of "
        f"the guess, end at the same minimum; {taken:.0f} s with compilation."
    )
    return Judged(name, model, tuple(loops), own), note


def _guess(name: str, fitted: list[Recording]) -> AbstractModel:
    """Read off the loop of the largest amplitude, which shows most of the curve."""
    return MODELS[name](max(fitted, key=lambda each: float(np.ptp(each.u))))


def _error(model: AbstractModel, loop: Recording) -> float:
    return 100 * float(judge(model, loop).errors["nrmse"])


def _cells(row: Judged) -> tuple[str, ...]:
    own = shown(row.own, 3)
    if row.error is None:
        return row.name, ", ".join(row.fitted), own, "-", "-"
    return (
        row.name,
        ", ".join(row.fitted),
        own,
        shown(row.unseen),
        shown(row.error, 3),
    )
