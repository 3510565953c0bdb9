"""A thousand thresholds in one call."""

import warnings

import equinox as eqx
import jax.numpy as jnp
import numpy as np

import hystjax as hj

from . import _problem
from ._agreement import agreed
from ._parallel import JOBLIB, in_parallel
from ._results import Table
from ._timing import Contestant, Effort, race

_THRESHOLDS = np.logspace(-4, 1, 1000)
_SAMPLED = slice(50, None, 100)


def run(effort: Effort) -> tuple[Table]:
    """The path of laws from the densest to the empty one."""
    ours, theirs = "hystjax, 1000 thresholds", "pysindy.SINDy.fit, 10 of them"
    shared_out = f"{theirs}, {JOBLIB}"
    record = _problem.recording()
    data = _problem.columns(record)
    sampled = _THRESHOLDS[_SAMPLED]

    contestants = {
        ours: Contestant(lambda: _path(record, _THRESHOLDS), len(_THRESHOLDS)),
        theirs: Contestant(
            lambda: [_supported(data, threshold) for threshold in sampled], len(sampled)
        ),
        shared_out: Contestant(
            in_parallel(_supported, [(data, each) for each in sampled]), len(sampled)
        ),
    }
    timings = race(contestants, effort)
    found = np.asarray(timings[ours].result.support)[_SAMPLED]
    unlike = sum(
        np.any(_problem.functions(found) != _problem.functions(reference), axis=1)
        for reference in (np.stack(timings[n].result) for n in (theirs, shared_out))
    )
    notes = (
        agreed(f"of {len(sampled)} supports, those that", float(np.sum(unlike)), 0.0),
        _problem.ON_TWINS,
        "times are a fit's; hystjax's call differentiates, builds the library and "
        "factors once for all; PySINDy fits one target",
    )
    title = "STLSQ for 1000 thresholds from 1e-4 to 10 (10 000 rows, 21 terms)"
    return (Table(title, ours, timings, notes),)


def _supported(data: _problem.Columns, threshold: float) -> np.ndarray:
    with warnings.catch_warnings():  # PySINDy says when nothing survives a threshold
        warnings.simplefilter("ignore")
        return _problem.fitted_sindy(data, threshold).coefficients()[0] != 0


@eqx.filter_jit
def _path(record: hj.Recording, thresholds) -> hj.regression.Fit:
    """One fit a threshold, of one factored problem."""
    difference = hj.differentiation.FiniteDifference()
    w, dw = difference.estimate(record.t, record.w)
    u, du = difference.estimate(record.t, record.u)
    problem = hj.regression.compress(_problem.LIBRARY(w, u, du), dw)

    stlsq = hj.regression.STLSQ(0.0, _problem.RIDGE, normalise=False)
    return hj.regression.threshold_path(stlsq, problem, jnp.asarray(thresholds))
