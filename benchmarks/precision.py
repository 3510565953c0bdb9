"""What single precision costs, and what it saves."""

import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

import hystjax as hj

from . import _multisine, _problem, refine
from ._results import Table
from ._timing import Contestant, Effort, race

_DOUBLE, _SINGLE = "float64", "float32"
_THRESHOLDS = np.logspace(-3, 0, 300)
_SETTINGS = hj.regression.STLSQ  # made in each precision


@dataclass(frozen=True)
class _Data:
    """A record in NumPy's double precision, from which each precision takes its own.

    **Attributes:** `t`, `u`, `w`; the slopes `du` and `dw`; and a `law`, by term.
    """

    t: np.ndarray
    u: np.ndarray
    w: np.ndarray
    du: np.ndarray
    dw: np.ndarray
    law: Mapping[str, float]

    @property
    def record(self) -> hj.Recording:
        return hj.Recording(self.t, self.u, self.w)


@dataclass(frozen=True)
class _Part:
    """A stage by itself.

    **Attributes:**

    - `title`: what it does.
    - `prepared`: called with the data, gives the call that is timed.
    - `loss`: how far what it gives is from what double precision gives.
    """

    title: str
    prepared: Callable[[_Data], Callable[[], Any]]
    loss: Callable[[Any, Any], float]


def run(effort: Effort) -> tuple[Table, ...]:
    """A table for each stage."""
    datas = {"multisine": _simulated(), "piezo": _measured()}
    with warnings.catch_warnings():  # hystjax says that float32 rounds derivatives
        warnings.simplefilter("ignore", UserWarning)
        return tuple(_table(part, datas, effort) for part in _PARTS)


def _table(part: _Part, datas: Mapping[str, _Data], effort: Effort) -> Table:
    timings = {}
    losses: dict[str, dict[str, float]] = {_DOUBLE: {}, _SINGLE: {}}
    for name, data in datas.items():
        timings[name] = race(
            {p: _contestant(part, data, p) for p in (_DOUBLE, _SINGLE)}, effort
        )
        exact = timings[name][_DOUBLE].result
        for precision, timing in timings[name].items():
            found = part.loss(timing.result, exact)
            losses[precision][f"loss, {name}"] = found
    notes = ("loss: relative difference from float64; times are of the multisine",)
    return Table(part.title, _DOUBLE, timings["multisine"], notes, losses)


def _contestant(part: _Part, data: _Data, precision: str) -> Contestant:
    double = precision == _DOUBLE
    with jax.enable_x64(double):
        call = part.prepared(data)

    def in_precision():
        with jax.enable_x64(double):
            return jax.device_get(call())

    return Contestant(in_precision)


def _relative(found: Any, exact: Any) -> float:
    exact = np.asarray(exact, float)
    return float(np.linalg.norm(found - exact) / np.linalg.norm(exact))


def _share_unlike(found: Any, exact: Any) -> float:
    return float(np.mean(np.any(found != exact, axis=-1)))


def _differentiation(how) -> Callable[[_Data], Callable]:
    def prepared(data):
        slope, (t, w) = jax.jit(how), map(jnp.asarray, (data.t, data.w))
        return lambda: slope(t, w)

    return prepared


def _regression(fitted: Callable) -> Callable[[_Data], Callable]:
    """A regression of slopes that are given."""

    def prepared(data):
        columns = [jnp.asarray(x) for x in (data.w, data.u, data.du, data.dw)]

        @jax.jit
        def call(w, u, du, dw):
            regressors = _problem.LIBRARY(w, u, du)
            return fitted(regressors, hj.regression.compress(regressors, dw))

        return lambda: call(*columns)

    return prepared


def _slope(regressors, problem):
    return regressors @ hj.regression.LeastSquares().fit(problem).coefficients


def _coefficients(regressors, problem):
    return _SETTINGS().fit(problem).coefficients


def _supports(regressors, problem):
    path = hj.regression.threshold_path(_SETTINGS(), problem, jnp.asarray(_THRESHOLDS))
    return path.support


def _identified(data: _Data):
    record = data.record
    return lambda: hj.identify(record, _problem.LIBRARY).value.coefficients


def _simulation(method) -> Callable[[_Data], Callable]:
    def prepared(data):
        law, record = hj.models.SparseModel.from_terms(data.law), data.record
        return lambda: hj.simulate(law, record, method=method).w

    return prepared


def _refined(data: _Data):
    law, record = hj.models.SparseModel.from_terms(data.law), data.record
    return lambda: hj.refine(law, record, throw=False).value.coefficients


_PARTS = (
    _Part(
        "Differentiate, FiniteDifference",
        _differentiation(hj.differentiation.FiniteDifference()),
        _relative,
    ),
    _Part(
        "Differentiate, SavitzkyGolay(31)",
        _differentiation(hj.differentiation.SavitzkyGolay(31)),
        _relative,
    ),
    _Part("Library and QR, the slope fitted", _regression(_slope), _relative),
    _Part("Library, QR and STLSQ, coefficients", _regression(_coefficients), _relative),
    _Part(
        "300 thresholds, share of other supports",
        _regression(_supports),
        _share_unlike,
    ),
    _Part("hystjax.identify, coefficients", _identified, _relative),
    _Part(
        "Simulate, FixedStep, output",
        _simulation(hj.simulation.FixedStep(1)),
        _relative,
    ),
    _Part(
        "Simulate, Adaptive, output", _simulation(hj.simulation.Adaptive()), _relative
    ),
    _Part("Refine, coefficients", _refined, _relative),
)


def _simulated() -> _Data:
    """With noise of 1 % of the output's deviation."""
    record = _multisine.recording(10_000)
    noise = np.random.default_rng(0).normal(size=len(record))
    w = np.asarray(record.w) + 0.01 * np.std(record.w) * noise
    law = dict(zip(refine.NAMES, refine.TRUTH.tolist(), strict=True))
    return _data(np.asarray(record.t), np.asarray(record.u), w, law)


def _measured() -> _Data:
    record = _problem.recording()
    law = _problem.identified(record).value.terms()
    return _data(*(np.asarray(x) for x in (record.t, record.u, record.w)), law)


def _data(t, u, w, law) -> _Data:
    difference, at = hj.differentiation.FiniteDifference(), jnp.asarray(t)
    slopes = (np.asarray(difference(at, jnp.asarray(x))) for x in (u, w))
    return _Data(t, u, w, *slopes, law)
