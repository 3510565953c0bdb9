"""A hundred thousand fits in one call: a thousand bootstraps, a hundred thresholds."""

import warnings

import jax
import numpy as np
import xarray

import hystjax as hj

from . import _problem
from ._agreement import agreed
from ._alone import peak
from ._results import Table
from ._timing import FULL, Contestant, Effort, race
from ._units import spaced

_THRESHOLDS = np.logspace(-4, 1, 100)
_BLOCKS = 100  # of 100 rows: neighbouring rows have no errors of their own
_MANY, _FEW = 1000, 50  # bootstraps
# Bootstrap and threshold of the fits that are compared, from 2e-3 on: below, terms stay
# in PySINDy's laws that rounding in its normal equations has made up.
_SAMPLED = [(seed, 26 + 7 * seed) for seed in range(10)]


def run(effort: Effort) -> tuple[Table]:
    """Every fit of the sweep, beside some of them."""
    count = _MANY if effort is FULL else _FEW
    ours = f"hystjax.sweep, {count} bootstraps of {len(_THRESHOLDS)} thresholds"
    theirs = f"pysindy.SINDy.fit, {len(_SAMPLED)} of them"
    record = _problem.recording()
    data = _problem.columns(record)
    slope = np.asarray(hj.differentiation.FiniteDifference()(record.t, record.w))
    contestants = {
        ours: Contestant(lambda: _swept(record, count), count * len(_THRESHOLDS)),
        theirs: Contestant(lambda: _sindy(data, slope), len(_SAMPLED)),
    }
    with warnings.catch_warnings():  # PySINDy says when nothing survives a threshold
        warnings.simplefilter("ignore")
        timings = race(contestants, effort)
    found = timings[ours].result["support"].values
    found = np.stack([found[seed, place] for seed, place in _SAMPLED])
    reference = np.stack([fit.coefficients()[0] != 0 for fit in timings[theirs].result])
    unlike = np.any(_problem.functions(found) != _problem.functions(reference), axis=1)
    notes = (
        agreed(f"of {len(_SAMPLED)} supports, those that", float(np.sum(unlike)), 0.0),
        _problem.ON_TWINS,
        f"peak memory of a process of its own: {peak(_alone, count):.0f} MiB",
        f"a bootstrap draws {_BLOCKS} of {_BLOCKS} blocks of 100 rows; PySINDy gets "
        "the same rows and their derivatives, and fits one target",
        "compared are thresholds from 2e-3 on: below, PySINDy keeps terms that "
        "rounding in its normal equations has made up",
        "times are a fit's; hystjax's call differentiates, builds the library and "
        "factors the blocks once for all",
    )
    title = f"{spaced(count * len(_THRESHOLDS))} STLSQ fits (10 000 rows, 21 terms)"
    return (Table(title, ours, timings, notes),)


def _swept(record: hj.Recording, count: int) -> xarray.Dataset:
    """All fits."""
    return hj.sweep(
        _path,
        hj.sweeping.Grid(bootstrap=range(count)),
        shared={"blocks": _factored(record), "thresholds": _THRESHOLDS},
        dims={name: ("threshold", "term") for name in ("coefficients", "support")},
        coords={"threshold": _THRESHOLDS, "term": list(_problem.LIBRARY.names)},
    )


def _path(bootstrap, blocks: hj.regression.LeastSquaresProblem, thresholds):
    """One fit a threshold, of blocks drawn with replacement."""
    drawn = jax.random.randint(jax.random.key(bootstrap), (_BLOCKS,), 0, _BLOCKS)
    problem = hj.regression.merged(jax.tree.map(lambda leaf: leaf[drawn], blocks))
    stlsq = hj.regression.STLSQ(0.0, _problem.RIDGE, normalise=False)
    fit = hj.regression.threshold_path(stlsq, problem, thresholds)
    return {"coefficients": fit.coefficients, "support": fit.support}


@jax.jit
def _factored(record: hj.Recording) -> hj.regression.LeastSquaresProblem:
    """The problem of each block of rows."""
    difference = hj.differentiation.FiniteDifference()
    w, dw = difference.estimate(record.t, record.w)
    u, du = difference.estimate(record.t, record.u)
    regressors = _problem.LIBRARY(w, u, du)
    return jax.vmap(hj.regression.compress)(
        regressors.reshape(_BLOCKS, -1, regressors.shape[1]), dw.reshape(_BLOCKS, -1)
    )


def _sindy(data: _problem.Columns, slope: np.ndarray) -> list:
    """Some of the fits, by PySINDy."""
    fits = []
    for seed, place in _SAMPLED:
        drawn = jax.random.randint(jax.random.key(seed), (_BLOCKS,), 0, _BLOCKS)
        rows = np.arange(len(data.t)).reshape(_BLOCKS, -1)[np.asarray(drawn)].ravel()
        model = _problem.sindy(_THRESHOLDS[place])
        slopes = slope[rows][:, None]
        fits.append(
            model.fit(data.w[rows], data.t, x_dot=slopes, u=data.controls[rows])
        )
    return fits


def _alone(count: int) -> None:
    _swept(_problem.recording(), count)
