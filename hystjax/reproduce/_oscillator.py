"""The Bouc-Wen benchmark: an oscillator with hidden states from its noisy record, and
what the study of it found, as tables."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jaxtyping import Array, ArrayLike, Bool, Float, PRNGKeyArray

from .._core.solution import RESULTS
from ..models import BoucWenOscillator, Oscillator
from ..recording import Recording, datasets, steady
from ..refinement import Nudging, refine
from ..signals import AbstractInputPath
from ..signals.excitation import Chirp
from ..simulation import FixedStep, judge, simulate
from ._document import AbstractDocument, shown

NOISE = 7.4e-6  # m rms, on every sample of the record
_SYMBOLS = ("m", "c", "k", "alpha", "beta", "gamma", "n")
_DISTANCES = ("fitted", "unseen", "multisine", "sweep")
_HEADINGS = ("run", "start", *_SYMBOLS, *_DISTANCES, "")
_NOTE = (
    "m to n: errors of the parameters, %. Root mean squares in 1e-6 m: free run minus "
    "measured output on the three periods fitted and on the fourth, noise "
    f"{1e6 * NOISE:.1f}; and free run minus that of the true oscillator, without "
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
        return [_HEADINGS, *map(_cells, self.rows)]


def tabled(runs: Mapping[str, Identified], off: float) -> OscillatorTable:
    """The runs as a table; their starts were `off` by so much, relative."""
    title = (
        "Bouc-Wen benchmark: the oscillator from random starts up to "
        f"{100 * off:.0f} % off in every parameter"
    )
    rows = (_start(name, run, i) for name, run in runs.items() for i in _starts(run))
    return OscillatorTable(title, tuple(rows), (_NOTE,), runs=runs)


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
