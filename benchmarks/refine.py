"""Laws matched to measured trajectories: one long record, and many short ones."""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from scipy.integrate import odeint
from scipy.optimize import least_squares

import hystjax as hj

from . import _problem
from ._agreement import agreed
from ._results import Table
from ._timing import Contestant, Effort, race

# With its default differences SciPy stops short of the minimum, misled by odeint's own
# error; so does its trf along the long record, with steps that depend on the machine.
# These settings are about the fastest that get there: of both methods, with and without
# scaling by the Jacobian, and steps from 1e-6 to 1e-3.
_LONG = {"method": "lm", "diff_step": 1e-4}
SHORT = {"method": "trf", "x_scale": "jac", "diff_step": 1e-4}
_TOLERANCE = 1e-10  # of odeint along the short records
SAME = 1e-4  # difference of root mean squares that counts as the same minimum
_RECORDS, _SAMPLES, _TOGETHER, _SOLVED = 256, 1000, 32, 4
NAMES = ("du", "u*|du|", "w*|du|")
TRUTH = np.array([0.25, 0.4, -0.5])


def run(effort: Effort) -> tuple[Table, ...]:
    """One record with the first output fitted and as measured, and many records."""
    return _long(effort, True), _long(effort, False), _many(effort)


def _long(effort: Effort, free: bool) -> Table:
    record = _problem.recording()
    law = _problem.identified(record).value.compact()
    ours, theirs = "hystjax.refine", "scipy least_squares over odeint"
    calls = {
        ours: lambda: hj.refine(law, record, free_start=free),
        theirs: lambda: long_by_scipy(record, free),
    }
    timings = race({name: Contestant(call) for name, call in calls.items()}, effort)
    rms = float(timings[ours].result.stats["rmse"][0])
    apart = abs(timings[theirs].result[1] / rms - 1)
    notes = (
        agreed(f"root mean square residuals ({rms:.5f} µm)", apart, SAME),
        "SciPy knows that u is a sine, as in the paper's script: with the recorded u, "
        "interpolated by NumPy, it takes minutes; hystjax uses the recorded u",
        f"SciPy: {_said(_LONG)}, the fastest found that gets to the "
        "minimum: by default it stops short",
        "refine also gives standard errors, a band of the output, fading and whiteness",
    )
    start = "the first output fitted too" if free else "from the first measured output"
    return Table(
        f"Refine five coefficients over 10 000 samples, {start}", ours, timings, notes
    )


def long_by_scipy(record: hj.Recording, free: bool):
    """The five terms of the paper's law matched to its record, with the first output
    too where that is free."""
    data = _problem.columns(record)
    t, w = data.t, data.w[:, 0]
    terms = _problem.identified(record).value.terms()
    first = np.array([terms[name] for name in _problem.TERMS])
    unknowns = np.append(first, w[0]) if free else first

    def simulated(x):
        w0 = x[5] if free else w[0]
        return _problem.integrated(x[:5], w0, t, _problem.sine)

    return by_scipy(simulated, w, unknowns, _LONG)


def _many(effort: Effort) -> Table:
    t, records = _noisy()
    alike, whole = f"hystjax.refine, {_TOGETHER} at a time", "hystjax.refine, jax.vmap"
    theirs = f"scipy least_squares over odeint, {_SOLVED} of them"
    start = 1.3 * TRUTH

    def scipy():
        return [
            by_scipy(lambda x: duhem(x, t), w, np.append(start, w[0]), SHORT)
            for w in records[:_SOLVED]
        ]

    contestants = {
        alike: Contestant(_batch(start, t, records, _TOGETHER), _RECORDS),
        whole: Contestant(_batch(start, t, records, _RECORDS), _RECORDS),
        theirs: Contestant(scipy, _SOLVED),
    }
    timings = race(contestants, effort)
    rmse, failed = (np.asarray(x) for x in timings[alike].result[2:])
    found = np.array([rms for _, rms in timings[theirs].result])
    apart = float(np.max(np.abs(found / rmse[:_SOLVED, 0] - 1)))
    notes = (
        agreed(f"of {_SOLVED} fits, root mean square residuals", apart, SAME),
        agreed(f"of {_RECORDS} fits, those that fail", float(np.sum(failed)), 0.0),
        "times are a fit's; a Duhem law from coefficients 30 % off, 5 % of noise, the "
        "first output fitted too; u is a sine, which SciPy knows in closed form",
        f"SciPy: {_said(SHORT)}, tolerances of {_TOLERANCE:g}",
        "hystjax's call also gives standard errors",
    )
    title = f"Refine three coefficients over {_SAMPLES} samples, {_RECORDS} records"
    return Table(title, alike, timings, notes)


def _said(settings: dict) -> str:
    return ", ".join(f"{name}={value!r}" for name, value in settings.items())


def by_scipy(simulated: Callable, w: np.ndarray, first: np.ndarray, settings: dict):
    """What least squares end at, and the root mean square residual there."""
    fit = least_squares(lambda x: simulated(x) - w, first, **settings)
    return fit.x, float(np.sqrt(np.mean(fit.fun**2)))


def _batch(start, t, records, together: int):
    """A call that refines all records, some of them side by side in the cache."""
    law = hj.models.SparseModel.from_terms(dict(zip(NAMES, start, strict=True)))

    def fit(t, u, w):
        solution = hj.refine(law, hj.Recording(t, u, w), throw=False)
        stats = solution.stats
        failed = solution.result != hj.RESULTS.successful
        errors = stats["standard_errors"]
        return solution.value.coefficients, errors, stats["rmse"], failed

    @eqx.filter_jit
    def fits(t, u, w):
        return jax.lax.map(lambda row: fit(t, u, row), w, batch_size=together)

    ready = [jnp.asarray(x) for x in (t, np.sin(t), records)]
    return lambda: fits(*ready)


def _noisy() -> tuple[np.ndarray, np.ndarray]:
    """Times, and outputs that differ by their noise, shape (256, 1000)."""
    t = np.linspace(0, 20, _SAMPLES)
    w = duhem([*TRUTH, 0.0], t)
    noise = np.random.default_rng(0).normal(size=(_RECORDS, _SAMPLES))
    return t, w + 0.05 * np.std(w) * noise


def duhem(x, t: np.ndarray, tolerance: float | None = _TOLERANCE) -> np.ndarray:
    """By odeint; without a tolerance, with its own."""
    of_du, of_u, of_w, w0 = x

    def rate(w, t):
        u, du = np.sin(t), np.cos(t)
        return of_du * du + (of_u * u + of_w * w) * abs(du)

    return odeint(rate, w0, t, rtol=tolerance, atol=tolerance)[:, 0]
