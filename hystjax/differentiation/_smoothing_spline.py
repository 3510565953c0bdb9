"""Cubic smoothing splines."""

import equinox as eqx

from .. import _checks
from ._base import AbstractDifferentiation
from ._host import on_host


class SmoothingSpline(AbstractDifferentiation):
    """The natural cubic spline that minimises squared residuals plus
    `penalty` times the integral of the squared second derivative.

    Computed by SciPy on the host; it has no derivative with respect to the samples.

    **Attributes:**

    - `penalty`: in units of s^3; `None` chooses it by generalised cross-validation.

    **Source:** Woltring (1986), doi 10.1016/0141-1195(86)90098-7.
    """

    penalty: float | None = eqx.field(static=True, default=None)

    def __check_init__(self):
        if self.penalty is not None:
            _checks.positive("penalty", self.penalty, zero=True)

    def estimate(self, t, y):
        _checks.enough_samples("`SmoothingSpline`", t.shape[0], 5)
        return on_host(_smooth, t, y, self.penalty)


def _smooth(t, y, penalty):
    # Slow to import, and rarely needed.
    from scipy.interpolate import make_smoothing_spline

    spline = make_smoothing_spline(t, y, lam=penalty)
    return spline(t), spline.derivative()(t)
