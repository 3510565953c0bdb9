"""One fit of the piezo problem: 10 000 rows, 21 terms."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pysindy as ps

import hystjax as hj

from . import _numpy, _problem
from ._agreement import agreed, relative_difference
from ._results import Table
from ._timing import Contestant, Effort, race

_SETTINGS = {"threshold": _problem.THRESHOLD, "ridge": _problem.RIDGE}


def run(effort: Effort) -> tuple[Table, Table]:
    """The whole fit, and the regression alone."""
    record = _problem.recording()
    data = _problem.columns(record)
    return _whole(record, data, effort), _stlsq(data, effort)


def _whole(record: hj.Recording, data: _problem.Columns, effort: Effort) -> Table:
    ours, by_hand, theirs, script = (
        "hystjax.identify",
        "NumPy by hand",
        "pysindy.SINDy.fit, one target",
        "pysindy.SINDy.fit, five targets",
    )
    everything = data.all
    columns = data.t, data.controls[:, 0], data.w[:, 0]
    calls = {
        ours: lambda: _problem.identified(record),
        by_hand: lambda: _numpy.identified(*columns, 2, **_SETTINGS),
        theirs: lambda: _problem.fitted_sindy(data),
        script: lambda: _problem.sindy().fit(everything, data.t),
    }
    timings = race({name: Contestant(call) for name, call in calls.items()}, effort)
    law = timings[ours].result.value.coefficients
    return Table(
        "One fit: differentiate, build the library, regress (10 000 rows, 21 terms)",
        ours,
        timings,
        (
            _same("by hand", law, timings[by_hand].result),
            _same("one target", law, timings[theirs].result.coefficients()[0]),
            _same("five targets", law, timings[script].result.coefficients()[0]),
            "by hand: one QR factorisation; normal equations find another law here",
            "one target: w is the state; u, du, |du| and |w| are controls, ready made",
            "five targets: the fit of the paper's script, which also finds laws for u, "
            "du, |du| and |w|, and drops them",
        ),
    )


def _stlsq(data: _problem.Columns, effort: Effort) -> Table:
    ours, by_hand, theirs = "hystjax STLSQ", "NumPy by hand", "pysindy.STLSQ.fit"
    regressors = np.asarray(ps.PolynomialLibrary(degree=2).fit_transform(data.all))
    target = np.asarray(ps.FiniteDifference()(data.w, data.t))
    ready = jnp.asarray(regressors), jnp.asarray(target[:, 0])

    @eqx.filter_jit
    def regress(regression, theta, y):
        return regression.fit(hj.regression.compress(theta, y)).coefficients

    def pysindy():
        optimizer = ps.STLSQ(threshold=_problem.THRESHOLD, alpha=_problem.RIDGE)
        return optimizer.fit(regressors, target)

    calls = {
        ours: lambda: regress(_problem.REGRESSION, *ready),
        by_hand: lambda: _numpy.stlsq(regressors, target[:, 0], **_SETTINGS),
        theirs: pysindy,
    }
    timings = race({name: Contestant(call) for name, call in calls.items()}, effort)
    found, reference = timings[ours].result, timings[theirs].result.coef_[0]
    return Table(
        "STLSQ alone, on the same matrix of regressors",
        ours,
        timings,
        (
            _same("by hand", found, timings[by_hand].result),
            _same("one target", found, reference),
        ),
    )


def _same(what: str, ours, theirs) -> str:
    error = relative_difference(ours, theirs)
    return agreed(f"{what}: coefficients", error, 1e-6)
