"""Hidden springs of simulated oscillators, found again from force and position."""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from .._core.solution import Solution
from ..discovery import discover
from ..library import Library, Polynomial, Stop, Term
from ..models import AbstractModel, Oscillator, SparseModel
from ..recording import Recording, steady
from ..refinement import refine
from ..signals import Cubic
from ..signals.excitation import AbstractExcitation, Chirp, Multisine
from ..simulation import FixedStep, metrics, simulate
from ._document import AbstractDocument, shown

NOISES = (0.01, 0.05)  # over the standard deviation of the position
SEEDS = 10
_PERIOD, _STEP = 1024, 0.1  # samples, s; the mass swings once in about 3 s
_SETTLED = 3  # periods that are averaged, behind one in which the mass settles
_METHOD = FixedStep(4)
_LARGEST = 3  # terms of a law
_SAME = 3.0  # times the error of the refined true law, on what nobody fitted
_HEADINGS = (
    *("spring", "force", "noise, %", "seeds", "right terms", "right device"),
    *("false loops", "weakest term, s.e.", "worst coefficient, %", "unseen ratio"),
)
_NOTES = (
    "mass y'' + damping y' + stiffness y + z = u with z' as given, or of the stop z = "
    "3 stop(y, 0.5), which is looked for among the radii 0.2, 0.4, 0.8 and 1.6; only u "
    "and y are recorded, and nothing is known: `discover` starts from ones. Multisine: "
    "three settled periods of 1024 samples, averaged. Sweep: one record of as many "
    "samples from rest, up through the resonance.",
    "Right terms: seeds that lead to exactly the true ones, or to no hysteresis where "
    "there is none. Right device: to these, or to as many others that are the same "
    "device in other words: z less a share of y obeys another law of as many terms, "
    "with that share in the stiffness, and nothing measured tells which spring it is. "
    "False loops: hysteresis where there is none.",
    "The weakest term is that of the true law, refined, over its standard error (which "
    "is the Cramer-Rao bound): the median of the seeds. Below 5 a term is hardly to be "
    "told from none. The worst coefficient is that of the seeds that are right: the "
    "median of their largest relative errors. Unseen: the error of the free run under "
    "another multisine, 1.5 times as strong, over that of the refined true law; the "
    "median of the seeds. Up to 3 it counts as the same device.",
)


@dataclass(frozen=True)
class Spring:
    """A hidden law, and the candidates it is looked for among.

    **Attributes:**

    - `terms`: coefficients by term; w stands for z, u for the position.
    - `library`: the candidates.
    - `target`: what the law gives, the `"rate"` z' or the `"value"` z.
    """

    terms: dict[str, float]
    library: Library
    target: str = "rate"

    @property
    def hysteretic(self) -> bool:
        """Whether there is a loop to find."""
        return _hysteretic(self.law)

    @property
    def law(self) -> SparseModel:
        """The law of z."""
        return SparseModel.from_terms(self.terms, target=self.target)


def _polynomial(degree: int, *more: str) -> Library:
    return Polynomial(degree, ("w", "du", "|du|", *more))


# The radius of the stop is none of those that are tried.
_SLIDING = Stop([0.2, 0.4, 0.8, 1.6]) + Library(
    tuple(map(Term.parse, ("u^2", "u^3", "du*|du|")))
)

SPRINGS: Mapping[str, Spring] = {
    "Bouc-Wen, n = 1": Spring(
        {"du": 3.0, "w*|du|": -2.0, "du*|w|": 1.5}, _polynomial(2, "|w|")
    ),
    "Bouc-Wen, n = 2": Spring(
        {"du": 3.0, "w*|du|*|w|": -2.0, "w^2*du": 1.5}, _polynomial(3, "|w|")
    ),
    "Dahl": Spring({"du": 3.0, "w*|du|": -2.0}, _polynomial(2, "|w|")),
    "Duhem and a cubic spring": Spring(
        {"du": 2.0, "u^2*du": 1.0, "w*|du|": -1.0}, _polynomial(3, "u")
    ),
    "no memory": Spring({"du": 3.0}, _polynomial(2, "|w|")),
    "stop": Spring({"stop(u,0.5)": 3.0}, _SLIDING, "value"),
    "no memory, stops tried": Spring({"u": 3.0}, _SLIDING, "value"),
}


def _multisine(amplitude: float = 2.0, seed: int = 2) -> AbstractExcitation:
    frequencies = np.arange(3, 90) / (_PERIOD * _STEP)
    return Multisine(frequencies, amplitude, key=jax.random.key(seed))


def _sweep() -> AbstractExcitation:
    return Chirp(2.0, 0.05, 1.0, _SETTLED * _PERIOD * _STEP)


FORCES = {"multisine": _multisine, "sweep": _sweep}


class Tried(NamedTuple):
    """What one noisy record leads to.

    **Attributes:** whether the `terms` and the `device` are right, and whether there
    are `false` loops; the `weakest` true term in standard errors; the largest relative
    `error` of a coefficient, NaN where terms are wrong; and the error on what nobody
    fitted over that of the refined true law, `unseen`.
    """

    terms: bool
    device: bool
    false: bool
    weakest: float
    error: float
    unseen: float


@dataclass(frozen=True)
class Row:
    """One spring under one force and noise, and what each seed led to."""

    spring: str
    force: str
    noise: float
    tried: tuple[Tried, ...]

    def count(self, what: str) -> int:
        """Of how many seeds that is so."""
        return sum(getattr(one, what) for one in self.tried)

    def median(self, what: str) -> float:
        """The median of those seeds that have such a number."""
        found = np.array([getattr(one, what) for one in self.tried])
        return float(np.nanmedian(found)) if not np.all(np.isnan(found)) else math.nan


@dataclass(frozen=True)
class HiddenTable(AbstractDocument):
    """All springs under all forces and noises."""

    rows: tuple[Row, ...]

    def cells(self):
        """Headings, and a line a case."""
        return [
            _HEADINGS,
            *(
                (
                    row.spring,
                    row.force,
                    shown(100 * row.noise, 2),
                    str(len(row.tried)),
                    *(str(row.count(what)) for what in ("terms", "device", "false")),
                    shown(row.median("weakest"), 3),
                    shown(100 * row.median("error"), 2),
                    shown(row.median("unseen"), 3),
                )
                for row in self.rows
            ),
        ]


def hidden(
    springs: Sequence[str] = tuple(SPRINGS),
    forces: Sequence[str] = tuple(FORCES),
    noises: Sequence[float] = NOISES,
    seeds: int = SEEDS,
) -> HiddenTable:
    """Look for the law of each spring under each force and noise."""
    rows = []
    for name in springs:
        for force in forces:
            for noise in noises:
                rows.append(_row(name, force, noise, seeds))
            jax.clear_caches()  # programs of one library are of no use to the next
    title = "Hidden springs, found from the force on a mass and where it went"
    return HiddenTable(title, tuple(rows), _NOTES)


def _row(name: str, force: str, noise: float, seeds: int) -> Row:
    spring = SPRINGS[name]
    clean = _clean(spring, force)
    records = (_noisy(clean, noise, seed) for seed in range(seeds))
    return Row(name, force, noise, tuple(_tried(spring, force, r) for r in records))


def _clean(spring: Spring, force: str) -> Recording:
    """Of the multisine a period more, in which the mass settles."""
    periods = _SETTLED + (force == "multisine")
    t = _STEP * jnp.arange(periods * _PERIOD)
    path = FORCES[force]().path(t)
    run = simulate(_oscillator(spring), path, w0=0.0, method=_METHOD)
    return Recording(t, run.u, run.w, interpolation=Cubic())


def _oscillator(spring: Spring) -> Oscillator:
    return Oscillator(1.0, 0.2, 2.0, spring.law)


def _noisy(clean: Recording, noise: float, seed: int) -> Recording:
    error = np.random.default_rng(seed).normal(size=len(clean)) * np.std(clean.w)
    w = np.asarray(clean.w) + noise * error
    return Recording(clean.t, clean.u, w, interpolation=clean.interpolation)


def _tried(spring: Spring, force: str, rec: Recording) -> Tried:
    """What `discover` and `refine` make of a noisy record."""
    weights = None
    if force == "multisine":
        rec, weight = steady(rec.window(_PERIOD, len(rec)), _PERIOD)
        weights = [weight]
    fit: dict[str, Any] = {"weights": weights, "throw": False}
    truth = refine(_oscillator(spring), rec, substeps=4, **fit)
    asked = {"around": _around, "target": spring.target, "largest": _LARGEST}
    found = discover(rec, spring.library, **asked, **fit)
    law = found.value.spring
    loops = _hysteretic(law)
    right = sorted(map(_kind, law.terms())) == sorted(map(_kind, spring.terms))
    if not spring.hysteretic:  # where a spring has no memory it is one with the other
        right = not loops
    unseen = _missed(found.value, spring) / _missed(truth.value, spring)
    alike = len(law.terms()) == len(spring.terms) and unseen < _SAME
    return Tried(
        right,
        right or alike,
        loops and not spring.hysteretic,
        _weakest(truth),
        _error(law, spring) if right else math.nan,
        unseen,
    )


def _missed(model: AbstractModel, spring: Spring) -> float:
    """The error of a free run under a force that no record had, output units."""
    path = _multisine(3.0, 5).path(_STEP * jnp.arange(_SETTLED * _PERIOD))
    ours, true = (
        simulate(each, path, w0=0.0, method=_METHOD, throw=False).w
        for each in (model, _oscillator(spring))
    )
    return float(metrics.rmse(true, ours))


def _hysteretic(law: AbstractModel) -> bool:
    return law.kind is not None and law.kind.hysteretic


def _weakest(truth: Solution) -> float:
    """How many standard errors the weakest term of the refined true law is strong."""
    terms, errors = truth.value.spring.terms(), truth.stats["standard_errors"]
    return min(float(abs(value) / errors[name]) for name, value in terms.items())


def _error(law: SparseModel, spring: Spring) -> float:
    """The largest relative error of a coefficient, or of a radius."""
    if not spring.hysteretic:  # only the sum of both stiffnesses is known
        return 0.0
    found, true = (
        {_kind(name): float(x) for name, x in each.parameters().items()}
        for each in (law, spring.law)
    )
    return max(abs(found[name] / x - 1) for name, x in true.items())


def _kind(name: str) -> str:
    """The name of a term or of its radius, whatever that is."""
    return re.sub(r",[^()]*\)", ",r)", name)


def _around(law: AbstractModel) -> Oscillator:
    """Nothing is known."""
    return Oscillator(1.0, 1.0, 1.0, law)
