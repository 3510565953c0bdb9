"""The regression that all benchmarks share, as hystjax and as PySINDy put it.

The measured piezo actuator of experiment 6 of Chandra et al. (2023), doi
10.1063/5.0146134, with their settings.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import pysindy as ps
from scipy.integrate import odeint

import hystjax as hj

FITTED, UNSEEN = (35001, 45001), (17500, 35000)
THRESHOLD, RIDGE = 0.01, 0.05
LIBRARY = hj.library.Polynomial(2)
REGRESSION = hj.regression.STLSQ(THRESHOLD, RIDGE, normalise=False)
TERMS = ("1", "w", "u", "du", "w*|w|")  # what is left of the library

ON_TWINS = (
    "w^2 and |w|^2 are one function, and count as one: PySINDy shares a coefficient "
    "between them, hystjax keeps the first"
)
_TWINS = {"|du|^2": "du^2", "|w|^2": "w^2"}

_FREQUENCY, _PHASE = 6.28318530724, -46.2178545458  # rad/s, rad: of the paper's script

Input = Callable[[float], tuple[float, float]]


@dataclass(frozen=True)
class Columns:
    """The recording as PySINDy takes it: NumPy arrays, n rows.

    **Attributes:**

    - `t`: times, shape (n,), s.
    - `w`: output, the only state, shape (n, 1).
    - `controls`: u, du, |du| and |w|, shape (n, 4).
    """

    t: np.ndarray
    w: np.ndarray
    controls: np.ndarray

    @property
    def all(self) -> np.ndarray:
        """w and the controls, shape (n, 5)."""
        return np.column_stack([self.w, self.controls])


def recording() -> hj.Recording:
    """The fitted rows."""
    return hj.datasets.load("piezo_ayala").window(*FITTED)


def identified(record: hj.Recording) -> hj.Solution:
    """hystjax's fit."""
    return hj.identify(record, LIBRARY, REGRESSION)


def columns(record: hj.Recording) -> Columns:
    """The recording for PySINDy, with its own derivative of the input."""
    t, u, w = (np.asarray(x) for x in (record.t, record.u, record.w))
    du = np.asarray(ps.FiniteDifference()(u[:, None], t))[:, 0]
    controls = np.column_stack([u, du, np.abs(du), np.abs(w)])
    return Columns(t, w[:, None], controls)


def sindy(threshold: float = THRESHOLD, degree: int = 2) -> ps.SINDy:
    """PySINDy's model, not fitted."""
    return ps.SINDy(
        optimizer=ps.STLSQ(threshold=threshold, alpha=RIDGE),
        feature_library=ps.PolynomialLibrary(degree=degree),
    )


def fitted_sindy(data: Columns, threshold: float = THRESHOLD) -> ps.SINDy:
    """PySINDy's fit of the same problem: one target, w, and 21 terms in the order of
    `LIBRARY`. It gets the input's derivative ready, while hystjax takes it itself."""
    return sindy(threshold).fit(data.w, data.t, u=data.controls)


def functions(supports: np.ndarray) -> np.ndarray:
    """Supports with terms of equal value joined, shape (m, 19)."""
    names = LIBRARY.names
    joined = supports.copy()
    for name, twin in _TWINS.items():
        joined[:, names.index(twin)] |= joined[:, names.index(name)]
    return joined[:, [name not in _TWINS for name in names]]


def sine(t: float) -> tuple[float, float]:
    """u and du as in the paper's script."""
    angle = _FREQUENCY * t + _PHASE
    return 150 * np.sin(angle), 150 * _FREQUENCY * np.cos(angle)


def interpolated(data: Columns) -> Input:
    """The recorded u and its derivative, linear between samples."""
    u, du = data.controls[:, 0], data.controls[:, 1]
    return lambda t: (np.interp(t, data.t, u), np.interp(t, data.t, du))


def integrated(
    coefficients: Sequence[float], w0: float, t: np.ndarray, signal: Input
) -> np.ndarray:
    """The law of `TERMS` by `odeint`, written out as in the paper's script."""
    constant, of_w, of_u, of_du, of_ww = coefficients

    def rate(w, t):
        u, du = signal(t)
        return constant + of_w * w + of_u * u + of_du * du + of_ww * w * abs(w)

    return odeint(rate, w0, t)[:, 0]
