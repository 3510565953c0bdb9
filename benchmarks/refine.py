"""Laws matched to measured trajectories: one long record, and many short ones."""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import xarray
from scipy.integrate import odeint
from scipy.optimize import least_squares

import hystjax as hj

from . import _problem
from ._agreement import agreed
from ._memory import peak
from ._results import Table, spaced
from ._timing import FULL, Contestant, Effort, race

# With its default differences SciPy stops short of the minimum, misled by odeint's own
# error. These settings are about the fastest that get there: of both methods, with and
# without scaling by the Jacobian, steps from 1e-6 to 1e-4, and odeint's tolerances from
# its default to 1e-12.
_LONG = {"x_scale": "jac", "diff_step": 3e-5}
_SHORT = {"x_scale": "jac", "diff_step": 1e-4}
_TOLERANCE = 1e-10  # of odeint along the short records
_SAME = 1e-4  # difference of root mean squares that counts as the same minimum
_RECORDS, _SAMPLES, _TOGETHER, _SOLVED = 256, 1000, 32, 4
_LANES = 4096
_NAMES = ("du", "u*|du|", "w*|du|")
_TRUTH = np.array([0.25, 0.4, -0.5])


def run(effort: Effort) -> tuple[Table, ...]:
    """One record with the first output fitted and as measured, many, and very many."""
    tables = _long(effort, True), _long(effort, False), _many(effort)
    return *tables, _very_many(effort)


def _long(effort: Effort, free: bool) -> Table:
    record = _problem.recording()
    data = _problem.columns(record)
    law = _problem.identified(record).value.compact()
    t, w = data.t, data.w[:, 0]
    terms = law.terms()
    first = np.array([terms[name] for name in _problem.TERMS])
    unknowns = np.append(first, w[0]) if free else first

    def simulated(x):
        w0 = x[5] if free else w[0]
        return _problem.integrated(x[:5], w0, t, _problem.sine)

    ours, theirs = "hystjax.refine", "scipy least_squares over odeint"
    calls = {
        ours: lambda: hj.refine(law, record, free_start=free),
        theirs: lambda: _scipy(simulated, w, unknowns, _LONG),
    }
    timings = race({name: Contestant(call) for name, call in calls.items()}, effort)
    rms = float(timings[ours].result.stats["rmse"][0])
    apart = abs(timings[theirs].result[1] / rms - 1)
    notes = (
        agreed(f"root mean square residuals ({rms:.5f} µm)", apart, _SAME),
        "SciPy knows that u is a sine, as in the paper's script: with the recorded u, "
        "interpolated by NumPy, it takes minutes; hystjax uses the recorded u",
        f"SciPy: method trf with {_said(_LONG)}, the fastest found that gets to the "
        "minimum: by default it stops short",
        "refine also gives standard errors, a band of the output, fading and whiteness",
    )
    start = "the first output fitted too" if free else "from the first measured output"
    return Table(
        f"Refine five coefficients over 10 000 samples, {start}", ours, timings, notes
    )


def _many(effort: Effort) -> Table:
    t, records = _noisy()
    alike, whole = f"hystjax.refine, {_TOGETHER} at a time", "hystjax.refine, jax.vmap"
    theirs = f"scipy least_squares over odeint, {_SOLVED} of them"
    start = 1.3 * _TRUTH

    def scipy():
        return [
            _scipy(lambda x: _duhem(x, t), w, np.append(start, w[0]), _SHORT)
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
        agreed(f"of {_SOLVED} fits, root mean square residuals", apart, _SAME),
        agreed(f"of {_RECORDS} fits, those that fail", float(np.sum(failed)), 0.0),
        "times are a fit's; a Duhem law from coefficients 30 % off, 5 % of noise, the "
        "first output fitted too; u is a sine, which SciPy knows in closed form",
        f"SciPy: method trf with {_said(_SHORT)}, tolerances of {_TOLERANCE:g}",
        "hystjax's call also gives standard errors",
    )
    title = f"Refine three coefficients over {_SAMPLES} samples, {_RECORDS} records"
    return Table(title, alike, timings, notes)


def _very_many(effort: Effort) -> Table:
    count = _LANES if effort is FULL else 4 * _TOGETHER
    ours = f"hystjax.sweep, {count} lanes"
    theirs = f"scipy least_squares over odeint, {_SOLVED} of them"
    t, clean = _clean(_SAMPLES)
    records = [np.asarray(_drawn(seed, clean)) for seed in range(_SOLVED)]

    def scipy():
        return [
            _scipy(lambda x: _duhem(x, t), w, np.append(1.3 * _TRUTH, w[0]), _SHORT)
            for w in records
        ]

    contestants = {
        ours: Contestant(lambda: _swept(count, _SAMPLES), count),
        theirs: Contestant(scipy, _SOLVED),
    }
    timings = race(contestants, effort)
    found = timings[ours].result
    reference = np.array([rms for _, rms in timings[theirs].result])
    rmse = found["rmse"].values[:_SOLVED, 0]
    failed = float(np.sum(found["result"].values != "successful"))
    few, many = (peak(_swept, count, n) for n in (_SAMPLES, 10 * _SAMPLES))
    notes = (
        agreed(
            f"of {_SOLVED} fits, root mean square residuals",
            float(np.max(np.abs(reference / rmse - 1))),
            _SAME,
        ),
        agreed(f"of {count} fits, those that fail", failed, 0.0),
        "times are a fit's; as above, each record drawn in its lane",
        f"peak memory of a process of its own: {few:.0f} MiB, and {many:.0f} MiB for "
        f"{spaced(10 * _SAMPLES)} samples",
    )
    title = f"Refine three coefficients over {_SAMPLES} samples, {count} lanes"
    return Table(title, ours, timings, notes)


def _swept(count: int, samples: int) -> xarray.Dataset:
    """All fits in one call, within 256 MiB for the lanes that go side by side."""
    t, clean = _clean(samples)
    shared = {"t": t, "u": np.sin(t), "clean": clean}
    space = hj.sweeping.Grid(seed=range(count))
    return hj.sweep(_fit, space, shared=shared, memory=2**28)


def _fit(seed, t, u, clean) -> hj.Solution:
    law = hj.models.SparseModel.from_terms(dict(zip(_NAMES, 1.3 * _TRUTH, strict=True)))
    record = hj.Recording(t, u, _drawn(seed, clean))
    found = hj.refine(law, record, throw=False)
    kept = {name: found.stats[name] for name in ("rmse", "standard_errors")}
    return hj.Solution(found.value, found.result, kept)


def _drawn(seed, clean):
    """An output with noise."""
    noise = jax.random.normal(jax.random.key(seed), clean.shape)
    return clean + 0.05 * jnp.std(clean) * noise


def _clean(samples: int) -> tuple[np.ndarray, np.ndarray]:
    """Times and the output."""
    t = np.linspace(0, 20, samples)
    return t, _duhem([*_TRUTH, 0.0], t)


def _said(settings: dict) -> str:
    return ", ".join(f"{name}={value!r}" for name, value in settings.items())


def _scipy(simulated: Callable, w: np.ndarray, first: np.ndarray, settings: dict):
    """What least squares end at, and the root mean square residual there."""
    fit = least_squares(lambda x: simulated(x) - w, first, **settings)
    return fit.x, float(np.sqrt(np.mean(fit.fun**2)))


def _batch(start, t, records, together: int):
    """A call that refines all records, some of them side by side in the cache."""
    law = hj.models.SparseModel.from_terms(dict(zip(_NAMES, start, strict=True)))

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
    t, w = _clean(_SAMPLES)
    noise = np.random.default_rng(0).normal(size=(_RECORDS, _SAMPLES))
    return t, w + 0.05 * np.std(w) * noise


def _duhem(x, t: np.ndarray) -> np.ndarray:
    of_du, of_u, of_w, w0 = x

    def rate(w, t):
        u, du = np.sin(t), np.cos(t)
        return of_du * du + (of_u * u + of_w * w) * abs(du)

    return odeint(rate, w0, t, rtol=_TOLERANCE, atol=_TOLERANCE)[:, 0]
