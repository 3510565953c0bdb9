"""The law of the piezo along 10 000 samples."""

from collections.abc import Sequence

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pysindy as ps

import hystjax as hj

from . import _numpy, _problem
from ._agreement import agreed
from ._results import Table
from ._timing import QUICK, Contestant, Effort, race

_OURS = "hystjax.simulate, FixedStep(1)"
_SHARE = 1e-4  # of a number, of which differences are taken
_NOTES = (
    "a sine: u and du in the closed form of the paper's script",
    "interpolated: the recorded u and its derivative, by numpy.interp; hystjax uses "
    "the recorded u, linear between samples",
    "PySINDy with odeint: its default integrator takes minutes",
)


def run(effort: Effort) -> tuple[Table, ...]:
    """Our ways beside SciPy's and PySINDy's, and derivatives of our default."""
    return _outputs(effort), _gradients(effort)


def _outputs(effort: Effort) -> Table:
    record = _problem.recording()
    data = _problem.columns(record)
    law = _problem.identified(record).value
    model = _law_of_sindy(data)
    fixed = hj.simulation.FixedStep(1)
    recorded = _problem.interpolated(data)
    terms = law.terms()
    coefficients = [terms[name] for name in _problem.TERMS]

    def odeint(signal: _problem.Input):
        return _problem.integrated(coefficients, data.w[0, 0], data.t, signal)

    calls = {
        _OURS: lambda: hj.simulate(law, record, method=fixed).w,
        "NumPy by hand, steps as FixedStep(1)": lambda: _by_hand(coefficients, data),
        "hystjax.simulate, the default": lambda: hj.simulate(law, record).w,
        "hystjax.simulate, Adaptive": lambda: (
            hj.simulate(law, record, method=hj.simulation.Adaptive()).w
        ),
        "scipy odeint, u a sine": lambda: odeint(_problem.sine),
        "scipy odeint, u interpolated": lambda: odeint(recorded),
        "pysindy simulate, u a sine": lambda: _free_run(model, data, _problem.sine),
    }
    if effort != QUICK:  # a call takes a minute
        name = "pysindy simulate, u interpolated"
        calls[name] = lambda: _free_run(model, data, recorded)
    timings = race({name: Contestant(call) for name, call in calls.items()}, effort)
    ours = timings[_OURS].result
    apart = max(float(hj.metrics.nrmse(ours, t.result)) for t in timings.values())
    notes = (agreed("outputs (NRMSE)", apart, 1e-3), *_NOTES)
    return Table("Simulate a law over 10 000 samples", _OURS, timings, notes)


def _gradients(effort: Effort) -> Table:
    """Of the squares that a free run misses, in the five coefficients."""
    record = _problem.recording()
    data = _problem.columns(record)
    law = _problem.identified(record).value
    terms = law.terms()
    at = {name: jnp.asarray(terms[name]) for name in _problem.TERMS}

    def by_odeint(coefficients: np.ndarray) -> float:
        run = _problem.integrated(
            coefficients.tolist(), data.w[0, 0], data.t, _problem.sine
        )
        return float(np.sum((run - data.w[:, 0]) ** 2))

    def differences() -> np.ndarray:
        start = np.array([terms[name] for name in _problem.TERMS])
        steps = np.diag(_SHARE * start)
        both = [(by_odeint(start + h), by_odeint(start - h)) for h in steps]
        return np.array([ahead - behind for ahead, behind in both]) / (2 * _SHARE)

    def gradient(method: hj.simulation.AbstractSimulation):
        @eqx.filter_jit
        def squares(values):
            run = hj.simulate(law.with_parameters(values), record, method=method)
            return jnp.sum((run.w - record.w) ** 2)

        @eqx.filter_jit
        def slopes(values):
            found = jax.grad(squares)(values)
            return jnp.stack([found[k] * values[k] for k in _problem.TERMS])

        return lambda: slopes(at)

    ours = "gradient of the default"
    calls = {
        "hystjax.simulate, the default": lambda: hj.simulate(law, record).w,
        ours: gradient(hj.simulation.Automatic()),
        "gradient of FixedStep(1)": gradient(hj.simulation.FixedStep(1)),
        "gradient of Adaptive": gradient(hj.simulation.Adaptive()),
        "gradient of Adaptive, RecursiveCheckpointAdjoint": gradient(
            hj.simulation.Adaptive(adjoint=diffrax.RecursiveCheckpointAdjoint())
        ),
        "differences of scipy odeint, u a sine": differences,
    }
    contestants = {name: Contestant(call) for name, call in calls.items()}
    timings = race(contestants, effort)
    _, *slopes = (np.asarray(timing.result) for timing in timings.values())
    default, *others, by_hand = (each / np.max(np.abs(slopes[0])) for each in slopes)
    apart = max(float(np.max(np.abs(default - each))) for each in others)
    notes = (
        agreed("all gradients", apart, 1e-6),
        agreed("differences", float(np.max(np.abs(by_hand - default))), 1e-2),
        "gradients are times each number, and agree relative to the largest of them",
        f"differences: ten runs, each number larger and less by {_SHARE:g} of itself",
    )
    title = "The gradient of what a free run misses, in five coefficients"
    return Table(title, ours, timings, notes)


def _by_hand(coefficients: Sequence[float], data: _problem.Columns) -> np.ndarray:
    constant, of_w, of_u, of_du, of_ww = coefficients

    def rate(w, u, du):
        return constant + of_w * w + of_u * u + of_du * du + of_ww * w * abs(w)

    return _numpy.marched(rate, data.t, data.controls[:, 0], float(data.w[0, 0]))


def _law_of_sindy(data: _problem.Columns) -> ps.SINDy:
    """PySINDy's model of the law's five terms.

    In the model of all 21 terms |w| is a control, so that its simulation would follow
    the measured output instead of running free.
    """
    library = ps.CustomLibrary(
        [
            lambda w, u, du: np.ones_like(w),
            lambda w, u, du: w,
            lambda w, u, du: u,
            lambda w, u, du: du,
            lambda w, u, du: w * np.abs(w),
        ]
    )
    optimizer = ps.STLSQ(threshold=0, alpha=_problem.RIDGE)
    model = ps.SINDy(optimizer=optimizer, feature_library=library)
    return model.fit(data.w, data.t, u=data.controls[:, :2])


def _free_run(model: ps.SINDy, data: _problem.Columns, signal: _problem.Input):
    output = model.simulate(
        data.w[0], data.t, u=lambda t: np.array(signal(t)), integrator="odeint"
    )
    return np.asarray(output)[:, 0]
