"""Oscillators: the Bouc-Wen benchmark with its hidden states from a noisy record, and
what the study of it found, as tables; and hidden springs of simulated oscillators,
found again from force and position."""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jaxtyping import Array, ArrayLike, Bool, Float, PRNGKeyArray

from .._core.solution import RESULTS, Solution
from ..discovery import discover
from ..library import Library, Polynomial, Stop, Term
from ..models import AbstractModel, BoucWenOscillator, Oscillator, SparseModel
from ..recording import Recording, datasets, steady
from ..refinement import Nudging, refine
from ..signals import AbstractInputPath, Cubic
from ..signals.excitation import AbstractExcitation, Chirp, Multisine
from ..simulation import FixedStep, judge, metrics, simulate
from ._document import AbstractDocument, shown

NOISE = 7.34e-6  # m rms, on every sample of the record, by its four equal periods
_SYMBOLS = ("m", "c", "k", "alpha", "beta", "gamma", "n")
_DISTANCES = ("fitted", "unseen", "multisine", "sweep")
_BENCHMARK_HEADINGS = ("run", "start", *_SYMBOLS, *_DISTANCES, "")
_BENCHMARK_NOTE = (
    "m to n: errors of the parameters, %. Root mean squares in 1e-6 m: free run minus "
    "measured output on the three periods fitted and on the fourth, noise "
    f"{1e6 * NOISE:.2f}; and free run minus that of the true oscillator, without "
    "noise, on the multisine and on a sine sweep."
)


@dataclass(frozen=True)
class Identified:
    """Oscillators found from several starts, all arrays of shape (starts,).

    **Attributes:**

    - `model`: the oscillators, a batch.
    - `converged`: whether the fit said so.
    - `errors`: of the parameters, relative, by name.
    - `fitted`, `unseen`: root mean square of free run minus measured output on the
        periods fitted, and on the other one, m.
    - `multisine`, `sweep`: root mean square distance of free runs from those of the
        true oscillator, without noise, m.
    """

    model: Oscillator
    converged: np.ndarray
    errors: dict[str, np.ndarray]
    fitted: np.ndarray
    unseen: np.ndarray
    multisine: np.ndarray
    sweep: np.ndarray

    @property
    def worst(self) -> np.ndarray:
        """Largest error of a parameter."""
        return np.max(np.abs(list(self.errors.values())), axis=0)


@dataclass(frozen=True)
class Start:
    """One start: of which run, its number, and what came of it, as in `Identified`."""

    run: str
    start: int
    converged: bool
    errors: dict[str, float]
    fitted: float
    unseen: float
    multisine: float
    sweep: float


@dataclass(frozen=True)
class OscillatorTable(AbstractDocument):
    """A row a start, and the `runs`, by name, that they are of."""

    rows: tuple[Start, ...]
    runs: Mapping[str, Identified] = field(default_factory=dict)

    def cells(self):
        """Headings, and a line a start."""
        return [_BENCHMARK_HEADINGS, *map(_cells, self.rows)]


def tabled(runs: Mapping[str, Identified], off: float) -> OscillatorTable:
    """The runs as a table; their starts were `off` by so much, relative."""
    title = (
        "Bouc-Wen benchmark: the oscillator from random starts up to "
        f"{100 * off:.0f} % off in every parameter"
    )
    rows = (_start(name, run, i) for name, run in runs.items() for i in _starts(run))
    return OscillatorTable(title, tuple(rows), (_BENCHMARK_NOTE,), runs=runs)


def _starts(run: Identified) -> range:
    return range(len(run.converged))


def _start(name: str, run: Identified, i: int) -> Start:
    errors = {symbol: float(error[i]) for symbol, error in run.errors.items()}
    distances = (float(getattr(run, kind)[i]) for kind in _DISTANCES)
    return Start(name, i + 1, bool(run.converged[i]), errors, *distances)


def _cells(row: Start) -> list[str]:
    errors = [f"{100 * error:.2f}" for error in row.errors.values()]
    sizes = [shown(1e6 * getattr(row, kind), 3) for kind in _DISTANCES]
    said = "converged" if row.converged else "did not converge"
    return [row.run, str(row.start), *errors, *sizes, said]


_PERIOD = 8192  # samples; the record holds four
_LEAD_IN = _PERIOD // 2  # in which the fits settle
# Runge-Kutta steps a sample: to get close, for the result, and for the truth.
_CLOSE, _FINE, _EXACT = 2, 8, 32
_COARSE = optx.LevenbergMarquardt(rtol=1e-3, atol=1e-3)
_LINEAR = ("mass", "damping", "stiffness", "alpha")  # in forces
_OFF = 0.5  # how far a start may be off, relative


def true_oscillator() -> Oscillator:
    """The oscillator that made the record."""
    return BoucWenOscillator(2.0, 10.0, 5e4, 5e4, 800.0, -1100.0)


def boucwen(starts: int = 10, *, key: PRNGKeyArray | None = None) -> OscillatorTable:
    """Identify the oscillator of the benchmark from several random starts.

    Three of the four periods are fitted, and the last one judged. Each start has every
    parameter off by up to 50 %, and nothing else is known of the truth, but for n in
    the first of two runs.

    A start is first fitted with its n, drawn to the measured output less and less
    (`refinement.Nudging`), then as a free run. With n free too, the first fit lets the
    hysteresis in from none: with n 50 % too large and the rest as it may be, z grows
    without bound.

    **Arguments:**

    - `starts`: their number in each run.
    - `key`: a `jax.random` key, the same every time by default.

    **Raises:** `InputError` when the recording cannot be had.

    **Source:** Noël and Schoukens (2016), Hysteretic benchmark with a dynamic
    nonlinearity, doi 10.4121/12967592.
    """
    key = jax.random.key(0) if key is None else key
    record = datasets.load("boucwen_benchmark")
    both = zip((True, False), jax.random.split(key, 2), strict=True)
    known, free = (_run(record, random_starts(starts, k, n), n) for n, k in both)
    return tabled({"n known": known, "n free": free}, _OFF)


def random_starts(starts: int, key: PRNGKeyArray, n_known: bool) -> Oscillator:
    """Oscillators, a batch, with parameters off by up to 50 % of the truth."""
    truth = true_oscillator()
    values = jnp.stack(list(truth.parameters().values()))
    shape = (starts, len(values))
    changes = jax.random.uniform(key, shape, values.dtype, -_OFF, _OFF)
    changes = changes.at[:, -1].multiply(not n_known)
    columns = (values * (1 + changes)).T
    return truth.with_parameters(dict(zip(truth.parameters(), columns, strict=True)))


def _run(record: Recording, starts: Oscillator, n_known: bool) -> Identified:
    """Fit and judge, with forces over their root mean square: where z is of order 1,
    n changes the shape of the hysteresis and hardly its size, which beta and gamma
    give."""
    force = jnp.sqrt(jnp.mean(record.u**2))
    fitted = mean_period(record, force)
    found, converged = _fits(in_units(starts, force), fitted, n_known)
    return _judged(record, in_units(found, 1 / force), converged)


def in_units(model: Oscillator, force: ArrayLike) -> Oscillator:
    """The same oscillator with forces in other units, a `force` each."""
    values = model.parameters()
    linear = {name: values[name] / force for name in _LINEAR}
    unit = force ** (values["n"] - 1)
    bends = {name: values[name] * unit for name in ("beta", "gamma")}
    return model.with_parameters(linear | bends)


def mean_period(record: Recording, force: ArrayLike) -> Recording:
    """The mean of the first three periods."""
    scaled = record.with_input(record.u / force)
    mean, _ = steady(scaled.window(0, 3 * _PERIOD), _PERIOD, lead_in=0)
    return mean


@eqx.filter_jit
def _fits(
    starts: Oscillator, record: Recording, n_known: bool
) -> tuple[Oscillator, Bool[Array, " s"]]:
    """The oscillators that starts lead to, and whether they converged."""
    return eqx.filter_vmap(lambda start: _fit(start, record, n_known))(starts)


def _fit(start: Oscillator, record: Recording, n_known: bool):
    none = jnp.zeros_like(start.mass)
    near = refine(
        start if n_known else start.with_parameters({"beta": none, "gamma": none}),
        record,
        fixed=("n",),
        periodic=True,
        lead_in=_LEAD_IN,
        shooting=Nudging(),
        solver=_COARSE,
        substeps=_CLOSE,
        throw=False,
    )
    end = refine(
        near.value,
        record,
        fixed=("n",) if n_known else (),
        periodic=True,
        lead_in=_LEAD_IN,
        substeps=_FINE,
        throw=False,
    )
    return end.value, end.result == RESULTS.successful


def _judged(record: Recording, found: Oscillator, converged) -> Identified:
    """Free runs beside the measured output, and beside those of the truth."""
    truth, sweep = true_oscillator(), _sweep()
    settled = _steady_runs(found, record.window(3 * _PERIOD, 4 * _PERIOD))
    swept = _free_runs(found, sweep)
    exact = FixedStep(_EXACT)
    true = simulate(truth, record.path, w0=0.0, method=exact).w
    true_sweep = simulate(truth, sweep, w0=0.0, method=exact).w
    pairs = zip(truth.parameters().items(), found.parameters().values(), strict=True)
    measured = _periods(record.w)
    return Identified(
        found,
        np.asarray(converged),
        {name: np.asarray(own / value - 1) for (name, value), own in pairs},
        _rms(settled[:, None] - measured[:3]),
        _rms(settled - measured[3]),
        _rms(settled - _periods(true)[-1]),
        _rms(swept - true_sweep),
    )


@eqx.filter_jit
def _free_runs(models: Oscillator, path: AbstractInputPath):
    """Outputs from rest, shape (s, n)."""

    def run(model):
        return simulate(model, path, w0=0.0, method=FixedStep(_FINE), throw=False).w

    return eqx.filter_vmap(run)(models)


@eqx.filter_jit
def _steady_runs(models: Oscillator, record: Recording):
    """Outputs of a settled period, from rest three periods before, shape (s, n)."""

    def run(model):
        method = FixedStep(_FINE)
        settled = {"periodic": True, "lead_in": 3 * _PERIOD}
        return judge(model, record, w0=0.0, method=method, **settled).trajectory.w

    return eqx.filter_vmap(run)(models)


def _sweep() -> AbstractInputPath:
    """40 N, from 20 to 50 Hz at 10 Hz a minute, as in the benchmark's second test."""
    seconds = 180
    return Chirp(40.0, 20.0, 50.0, seconds).path(jnp.arange(seconds * 750) / 750)


def _periods(w: Float[Array, " *s n"]) -> Float[Array, " *s 4 period"]:
    return w.reshape(*w.shape[:-1], 4, _PERIOD)


def _rms(errors: Float[Array, " s *n"]) -> np.ndarray:
    """Of each start."""
    return np.sqrt(np.mean(np.reshape(errors, (len(errors), -1)) ** 2, axis=1))


NOISES = (0.01, 0.05)  # over the standard deviation of the position
SEEDS = 10
_CYCLE, _STEP = 1024, 0.1  # samples, s; the mass swings once in about 3 s
_SETTLED = 3  # periods that are averaged, behind one in which the mass settles
_METHOD = FixedStep(4)
_LARGEST = 3  # terms of a law
_SAME = 3.0  # times the error of the refined true law, on what nobody fitted
_SPRING_HEADINGS = (
    *("spring", "force", "noise, %", "seeds", "right terms", "right device"),
    *("false loops", "weakest term, s.e.", "worst coefficient, %", "unseen ratio"),
)
_SPRING_NOTES = (
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
    frequencies = np.arange(3, 90) / (_CYCLE * _STEP)
    return Multisine(frequencies, amplitude, key=jax.random.key(seed))


def _chirp() -> AbstractExcitation:
    return Chirp(2.0, 0.05, 1.0, _SETTLED * _CYCLE * _STEP)


FORCES = {"multisine": _multisine, "sweep": _chirp}


class Tried(NamedTuple):
    """What one noisy record leads to.

    **Attributes:** whether the `terms` and the `device` are right, and whether there
    are `false` loops; the `weakest` true term in standard errors; the largest relative
    `error` of a coefficient, NaN where terms are wrong, and both where there is no
    memory; and the error on what nobody fitted over that of the refined true law,
    `unseen`.
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

    def median(self, what: str, unit: float = 1.0) -> float | None:
        """The median of those seeds that have such a number, in a `unit`; `None` where
        none has."""
        found = np.array([getattr(one, what) for one in self.tried]) / unit
        return None if np.all(np.isnan(found)) else float(np.nanmedian(found))


@dataclass(frozen=True)
class HiddenTable(AbstractDocument):
    """All springs under all forces and noises."""

    rows: tuple[Row, ...]

    def cells(self):
        """Headings, and a line a case."""
        return [
            _SPRING_HEADINGS,
            *(
                (
                    row.spring,
                    row.force,
                    shown(100 * row.noise, 2),
                    str(len(row.tried)),
                    *(str(row.count(what)) for what in ("terms", "device", "false")),
                    shown(row.median("weakest"), 3),
                    shown(row.median("error", 0.01), 2),
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
    return HiddenTable(title, tuple(rows), _SPRING_NOTES)


def _row(name: str, force: str, noise: float, seeds: int) -> Row:
    spring = SPRINGS[name]
    clean = _clean(spring, force)
    records = (_noisy(clean, noise, seed) for seed in range(seeds))
    return Row(name, force, noise, tuple(_tried(spring, force, r) for r in records))


def _clean(spring: Spring, force: str) -> Recording:
    """Of the multisine a period more, in which the mass settles."""
    periods = _SETTLED + (force == "multisine")
    t = _STEP * jnp.arange(periods * _CYCLE)
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
        rec, weight = steady(rec.window(_CYCLE, len(rec)), _CYCLE)
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
        # Without memory only the sum of both stiffnesses is known.
        _weakest(truth) if spring.hysteretic else math.nan,
        _error(law, spring) if right and spring.hysteretic else math.nan,
        unseen,
    )


def _missed(model: AbstractModel, spring: Spring) -> float:
    """The error of a free run under a force that no record had, output units; inf where
    it diverges."""
    path = _multisine(3.0, 5).path(_STEP * jnp.arange(_SETTLED * _CYCLE))
    ours, true = (
        simulate(each, path, w0=0.0, method=_METHOD, throw=False).w
        for each in (model, _oscillator(spring))
    )
    missed = float(metrics.rmse(true, ours))
    return missed if math.isfinite(missed) else math.inf


def _hysteretic(law: AbstractModel) -> bool:
    return law.kind is not None and law.kind.hysteretic


def _weakest(truth: Solution) -> float:
    """How many standard errors the weakest term of the refined true law is strong."""
    terms, errors = truth.value.spring.terms(), truth.stats["standard_errors"]
    return min(float(abs(value) / errors[name]) for name, value in terms.items())


def _error(law: SparseModel, spring: Spring) -> float:
    """The largest relative error of a coefficient, or of a radius."""
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
