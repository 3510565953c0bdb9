"""Thousands of refinements in one call."""

from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import xarray

import hystjax as hj

from . import refine
from ._agreement import agreed
from ._alone import peak
from ._results import Table
from ._timing import FULL, Contestant, Effort, race
from ._units import spaced

_SAMPLES, _LANES, _SOLVED = 1000, 4096, 4


def run(effort: Effort) -> tuple[Table]:
    """Each lane a record of its own."""
    count = _LANES if effort is FULL else 128
    ours = f"hystjax.sweep, {count} lanes"
    theirs = f"scipy least_squares over odeint, {_SOLVED} of them"
    records = noisy(_SOLVED)
    contestants = {
        ours: Contestant(lambda: swept(count), count),
        theirs: Contestant(lambda: [by_scipy(w) for w in records], _SOLVED),
    }
    timings = race(contestants, effort)
    found = timings[ours].result
    reference = np.array(timings[theirs].result)
    rmse = found["rmse"].values[:_SOLVED, 0]
    failed = float(np.sum(found["result"].values != "successful"))
    # Ever fewer lanes, but still several chunks of them.
    peaks = [peak(swept, count // times, times * _SAMPLES) for times in (1, 10, 100)]
    few, more, most = (f"{each:.0f} MiB" for each in peaks)
    notes = (
        agreed(
            f"of {_SOLVED} fits, root mean square residuals",
            float(np.max(np.abs(reference / rmse - 1))),
            refine.SAME,
        ),
        agreed(f"of {count} fits, those that fail", failed, 0.0),
        "times are a fit's; a Duhem law from coefficients 30 % off, 5 % of noise, "
        "drawn in the lane; SciPy as in `refine`",
        f"peak memory of a process of its own: {few}; for {spaced(10 * _SAMPLES)} "
        f"samples {more}, for {spaced(100 * _SAMPLES)} {most}",
    )
    title = f"Refine three coefficients over {_SAMPLES} samples, {count} lanes"
    return (Table(title, ours, timings, notes),)


def swept(
    count: int, samples: int = _SAMPLES, devices: Sequence[Any] | None = None
) -> xarray.Dataset:
    """All fits in one call, within 256 MiB for the lanes that go side by side."""
    t, clean = _clean(samples)
    shared = {"t": t, "u": np.sin(t), "clean": clean}
    space = hj.sweeping.Grid(seed=range(count))
    return hj.sweep(_fit, space, shared=shared, memory=2**28, devices=devices)


def noisy(count: int) -> list[np.ndarray]:
    """The outputs of the first lanes, shape (1000,) each."""
    _, clean = _clean(_SAMPLES)
    return [np.asarray(_drawn(seed, clean)) for seed in range(count)]


def by_scipy(w: np.ndarray) -> float:
    """The root mean square residual of a lane's record, by SciPy."""
    t, start = times(_SAMPLES), np.append(1.3 * refine.TRUTH, w[0])
    return refine.by_scipy(lambda x: refine.duhem(x, t), w, start, refine.SHORT)[1]


def _fit(seed, t, u, clean) -> hj.Solution:
    law = hj.models.SparseModel.from_terms(
        dict(zip(refine.NAMES, 1.3 * refine.TRUTH, strict=True))
    )
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
    t = times(samples)
    return t, refine.duhem([*refine.TRUTH, 0.0], t)


def times(samples: int) -> np.ndarray:
    """Times of a record, s."""
    return np.linspace(0, 20, samples)
