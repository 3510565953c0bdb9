"""Classical models: from their own simulated records, a guess, then `refine`; and of
grain-oriented steel, fitted to some of its loops and judged on the others."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import jax
import numpy as np

from ..comparison import compare
from ..models import (
    AbstractModel,
    BoucWenBaberNoori,
    BoucWenForce,
    ColemanHodgdon,
    Dahl,
    InverseJilesAtherton,
    JilesAtherton,
    LuGre,
    MaxwellSlip,
    RambergOsgood,
    Tellinen,
)
from ..recording import Recording, datasets
from ..refinement import LevenbergMarquardt, refine
from ..simulation import FixedStep, judge, simulate
from ._document import AbstractDocument, shown

NOISES = (0.01, 0.05, 0.10)  # over the standard deviation of the output
SEEDS = 20
_NEAR = 4.0  # standard errors
_HEADINGS = (
    "model",
    "noise, %",
    "numbers",
    "seeds within 4 s.e.",
    "worst number",
    "residual / noise",
)
_NOTES = (
    "Noise is added to the output of the true model, `guess` reads a first model off "
    "the noisy record, and `refine` fits it. Shown are the seeds in which a number is "
    "within four of its standard errors of the true one: the least over all numbers, "
    "and the number that this is.",
    "Inputs: sines that grow over four cycles, 801 samples. Of LuGre 1601 in a quarter "
    "of the time, so that velocities count.",
    "Of BoucWenBaberNoori q, delta_psi and lam keep the values of the guess, which are "
    "the true ones: with noise they are not told from psi and zeta_s.",
)


@dataclass(frozen=True)
class Case:
    """A true model, and what drives it.

    **Attributes:**

    - `truth`: the model.
    - `amplitude`: of the input.
    - `samples`: their number.
    - `time`: of the record, s.
    - `fixed`: numbers that are not fitted.
    - `substeps`: integration steps a sample interval.
    """

    truth: AbstractModel
    amplitude: float
    samples: int = 801
    time: float = 8 * np.pi
    fixed: Sequence[str] = ()
    substeps: int = 4

    def clean(self) -> Recording:
        """The record without noise."""
        t = np.linspace(0, 1, self.samples)
        u = self.amplitude * np.minimum(1, 0.25 + t) * np.sin(8 * np.pi * t)
        still = Recording(self.time * t, u, np.zeros_like(t))
        w = simulate(self.truth, still, method=FixedStep(self.substeps)).w
        return Recording(still.t, u, w)


_STEEL = JilesAtherton(1.3e6, 40.0, 50.0, 6e-5, 0.15)
CASES: Mapping[str, Case] = {
    "JilesAtherton": Case(_STEEL, 250.0),
    "InverseJilesAtherton": Case(InverseJilesAtherton(_STEEL), 1.4, substeps=8),
    "Tellinen": Case(Tellinen(1.4, 60.0, 80.0, 1e-3), 250.0),
    "ColemanHodgdon": Case(ColemanHodgdon(1.3, 60.0, 1e-3, 0.015, 0.3), 250.0),
    "Dahl": Case(Dahl(600.0, 5.0, 1.5), 0.1),
    "LuGre": Case(
        LuGre(2e3, 8.0, 0.6, 1.0, 1.5, 0.1),
        0.1,
        samples=1601,
        time=2 * np.pi,
        substeps=8,
    ),
    "MaxwellSlip": Case(
        MaxwellSlip([30.0, 20.0, 15.0, 10.0], [0.01, 0.03, 0.05, 0.08]),
        0.1,
        substeps=1,
    ),
    "BoucWenForce": Case(BoucWenForce(0.1, 50.0, 12.0, 8.0, 1.5), 0.3),
    "BoucWenBaberNoori": Case(
        BoucWenBaberNoori(
            0.1, 50.0, 12.0, 4.0, 1.2, 0.03, 0.02, zeta_s=0.8, p=0.5, psi=0.1
        ),
        0.6,
        fixed=("q", "delta_psi", "lam"),
    ),
    "RambergOsgood": Case(RambergOsgood(200e3, 400.0, 7.0), 6e-3, substeps=1),
}


@dataclass(frozen=True)
class Found:
    """What fits of one model to records with some noise come to.

    **Attributes:**

    - `model`: its name.
    - `noise`: over the standard deviation of the output.
    - `numbers`: how many are fitted.
    - `within`: by number, the seeds in which it is within four standard errors.
    - `seeds`: their number.
    - `residual`: root mean square of residuals over that of the noise, the mean.
    """

    model: str
    noise: float
    numbers: int
    within: Mapping[str, int]
    seeds: int
    residual: float

    @property
    def worst(self) -> str:
        """The number that fewest seeds find."""
        return min(self.within, key=lambda name: self.within[name])


@dataclass(frozen=True)
class FoundTable(AbstractDocument):
    """All models, and all noises."""

    rows: tuple[Found, ...]

    def cells(self):
        """Headings, and a line a model and noise."""
        return [_HEADINGS, *map(_cells, self.rows)]


def classical() -> FoundTable:
    """Fit each classical model to its own noisy records, from a guess that is read off
    them."""
    rows = [found(name, noise, range(SEEDS)) for name in CASES for noise in NOISES]
    title = "Classical models from their own noisy records"
    return FoundTable(title, tuple(rows), _NOTES)


def found(name: str, noise: float, seeds: Sequence[int]) -> Found:
    """Fits of one model to records that differ by their noise."""
    case = CASES[name]
    clean = case.clean()
    truth = case.truth.parameters()
    free = [key for key in truth if key not in case.fixed]
    level = noise * float(np.std(clean.w))
    within, residuals = dict.fromkeys(free, 0), []
    for seed in seeds:
        drawn = level * np.random.default_rng(seed).normal(size=len(clean))
        solution = _fit(case, Recording(clean.t, clean.u, clean.w + drawn))
        errors = solution.stats["standard_errors"]
        values = solution.value.parameters()
        for key in free:
            off = abs(float(values[key]) - float(truth[key]))
            within[key] += bool(off <= _NEAR * float(errors[key]))
        residuals.append(float(solution.stats["rmse"][0]) / np.sqrt(np.mean(drawn**2)))
    return Found(name, noise, len(free), within, len(seeds), float(np.mean(residuals)))


def _fit(case: Case, record: Recording) -> Any:
    guess: Any = type(case.truth)
    return refine(
        guess.guess(record),
        record,
        fixed=case.fixed,
        substeps=case.substeps,
        throw=False,
    )


def _cells(row: Found) -> tuple[str, ...]:
    return (
        row.model,
        f"{100 * row.noise:g}",
        str(row.numbers),
        f"{row.within[row.worst]} of {row.seeds}",
        row.worst,
        shown(row.residual, 4),
    )


LOOPS = ("0.43T", "0.95T", "1.50T")
MODELS: Mapping[str, Callable[[Recording], AbstractModel]] = {
    "JilesAtherton": JilesAtherton.guess,
    "Tellinen": Tellinen.guess,
}
_LINEAR = "Everett"  # linear in its numbers: no starts, and the one minimum there is
_STARTS = 10  # of fits to all loops
_SAME = 1e-4  # relative, of losses at the same minimum
_SUBSTEPS = 2  # of these fits, which all need about as many
# The last digits of a loss take as many steps again, along a curved valley.
_SETTINGS: Mapping[str, Any] = {
    "solver": LevenbergMarquardt(rtol=1e-7),
    "throw": False,
}
_STEEL_HEADINGS = ("model", "fitted", "own, %", "unseen", "unseen, %")
_STEEL_NOTES = (
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
        return [_STEEL_HEADINGS, *map(_steel_cells, self.rows)]


def steel_models() -> SteelTable:
    """Fit each model to two of three loops, all choices, and to all three from ten
    starts.

    **Raises:** `InputError` when a recording cannot be had.
    """
    loops = {name: datasets.load("steel_m130_27s", name) for name in LOOPS}
    rows, notes = [], list(_STEEL_NOTES)
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
        substeps=_SUBSTEPS,
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


def _steel_cells(row: Judged) -> tuple[str, ...]:
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
