"""PySINDy's sparse regressions, each with a small grid of settings."""

import itertools
import warnings
from collections.abc import Callable, Mapping, Sequence
from functools import partial

import numpy as np
import pysindy as ps

from ._noisy import Noisy
from ._problem import RIDGE

Fit = Callable[[Noisy], np.ndarray]

_WINDOWS = (None, 11, 31)  # samples that derivatives are smoothed over
_LONG = _WINDOWS[-1]  # does best under noise
_RELAXATIONS = (1.0, 0.01)
_RESAMPLING = ("bagging", "library_ensemble")
_HALF_WIDTHS = (0.6, 1.26)  # s, of the weak form's subdomains
_SUBDOMAINS = 200
_ITERATIONS = 1000  # SR3 does not converge in its default of 30
_WEAK_RIDGE = 1e-5  # columns are integrals here, for which PySINDy's default is large


def rivals(
    t: np.ndarray, degree: int, thresholds: Sequence[float]
) -> dict[str, dict[str, Fit]]:
    """Fits by method and setting; each gives the coefficients of all terms.

    **Arguments:** the times of the records, the degree of the library, and thresholds
    around the smallest coefficient that is to be found. What is drawn at random,
    resamples and subdomains, is the same after every such call.
    """
    np.random.seed(0)
    return {
        "pysindy STLSQ": {
            f"threshold {h}, {_said(window)}": _strong(degree, _stlsq(h), window)
            for h, window in itertools.product(thresholds, _WINDOWS)
        },
        "pysindy SR3": {
            f"threshold {h}, nu {nu:g}, {_said(_LONG)}": _strong(
                degree, _sr3(h, nu), _LONG
            )
            for h, nu in itertools.product(thresholds, _RELAXATIONS)
        },
        "pysindy ensemble STLSQ": {
            f"threshold {h}, {how}, {_said(_LONG)}": _strong(
                degree, _ensemble(h, how), _LONG
            )
            for h, how in itertools.product(thresholds, _RESAMPLING)
        },
        "pysindy weak form, STLSQ": {
            f"threshold {h}, half width {width} s": fit
            for width in _HALF_WIDTHS
            for h, fit in _weak(t, degree, width, thresholds).items()
        },
    }


def _said(window: int | None) -> str:
    return "plain differences" if window is None else f"smoothed over {window}"


def _stlsq(threshold: float, ridge: float = RIDGE) -> Callable:
    return partial(ps.STLSQ, threshold=threshold, alpha=ridge)


def _sr3(threshold: float, nu: float) -> Callable:
    weight = ps.SR3.calculate_l0_weight(threshold, nu)
    return partial(
        ps.SR3, reg_weight_lam=weight, relax_coeff_nu=nu, max_iter=_ITERATIONS
    )


def _ensemble(threshold: float, how: str) -> Callable:
    """The median of twenty fits."""
    return lambda: ps.EnsembleOptimizer(_stlsq(threshold)(), **{how: True})


def _strong(degree: int, optimizer: Callable, window: int | None) -> Fit:
    """A fit of the differentiated output."""
    if window is None:
        difference = ps.FiniteDifference()
    else:
        smoother = {"window_length": window, "polyorder": 3}
        difference = ps.SmoothedFiniteDifference(smoother_kws=smoother)
    return lambda noisy: _fitted(
        noisy,
        optimizer=optimizer(),
        feature_library=ps.PolynomialLibrary(degree=degree),
        differentiation_method=difference,
    )


def _weak(
    t: np.ndarray, degree: int, half_width: float, thresholds: Sequence[float]
) -> Mapping[float, Fit]:
    """Fits by threshold on subdomains that are drawn and weighed once."""
    library = ps.WeakPDELibrary(
        function_library=ps.PolynomialLibrary(degree=degree, include_bias=False),
        spatiotemporal_grid=t,
        include_bias=True,
        K=_SUBDOMAINS,
        H_xt=half_width,
    )

    def fit(optimizer, noisy):
        return _fitted(noisy, optimizer=optimizer(), feature_library=library)

    return {h: partial(fit, _stlsq(h, _WEAK_RIDGE)) for h in thresholds}


def _fitted(noisy: Noisy, **settings) -> np.ndarray:
    data = noisy.columns
    with warnings.catch_warnings():  # PySINDy says when no term survives
        warnings.simplefilter("ignore")
        model = ps.SINDy(**settings).fit(data.w, data.t, u=data.controls)
    return np.asarray(model.coefficients()[0])
