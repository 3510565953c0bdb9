"""Differentiation with a penalty on the total variation of the derivative."""

import equinox as eqx
import numpy as np
from scipy.linalg import solveh_banded

from .. import _checks
from .._errors import ComputationError
from ._base import AbstractDifferentiation
from ._host import on_host

_MAX_STEPS = 100
_GAP = 1e-9  # duality gap, relative to the signal's sum of squares


class TotalVariation(AbstractDifferentiation):
    """The derivative with the fewest and smallest jumps that explains the samples.

    Minimises half the sum of squared residuals plus `penalty` times the total variation
    of the slopes between samples: the smoothed signal is piecewise linear, and corners
    at turning points stay sharp. Solved on the host by an interior-point method on the
    dual; it has no derivative with respect to the samples.

    **Attributes:**

    - `penalty`: in units of signal times s.

    **Source:** Chartrand (2011), doi 10.5402/2011/164564; in this form, l1 trend
    filtering, Kim, Koh, Boyd and Gorinevsky (2009), doi 10.1137/070690274.
    """

    penalty: float = eqx.field(static=True)

    def __check_init__(self):
        _checks.positive("penalty", self.penalty)

    def estimate(self, t, y):
        _checks.enough_samples("`TotalVariation`", t.shape[0], 4)
        return on_host(_smooth, t, y, self.penalty)


def _smooth(t, y, penalty):
    # Unit steps and unit signal on average, for the arithmetic's sake.
    step, scale = np.mean(np.diff(t)), np.std(y) or 1.0
    bends = _SlopeChanges(np.diff(t) / step)
    dual = _solve_dual(bends, y / scale, penalty / (scale * step))
    signal = y - scale * bends.transposed(dual)
    return signal, np.gradient(signal, t, edge_order=1)


class _SlopeChanges:
    """The operator D that takes a signal to the changes of its slope."""

    def __init__(self, steps):
        self.left, self.right = 1 / steps[:-1], 1 / steps[1:]
        self.middle = -(self.left + self.right)

    def __call__(self, x):
        return self.left * x[:-2] + self.middle * x[1:-1] + self.right * x[2:]

    def transposed(self, z):
        x = np.zeros(len(z) + 2)
        x[:-2] += self.left * z
        x[1:-1] += self.middle * z
        x[2:] += self.right * z
        return x

    def gram(self):
        """D times its transpose, the upper bands as SciPy wants them."""
        bands = np.zeros((3, len(self.left)))
        bands[2] = self.left**2 + self.middle**2 + self.right**2
        bands[1, 1:] = (
            self.middle[:-1] * self.left[1:] + self.right[:-1] * self.middle[1:]
        )
        bands[0, 2:] = self.right[:-2] * self.left[2:]
        return bands


def _solve_dual(bends, y, bound):
    """Minimise |D'z|^2 / 2 - z'Dy over |z| <= bound by a primal-dual method."""
    gram, target = bends.gram(), bends(y)
    z = np.zeros_like(target)
    upper, lower = np.ones_like(z), np.ones_like(z)  # multipliers of the two bounds
    for _ in range(_MAX_STEPS):
        above, below = z - bound, -z - bound
        gap = -(above @ upper + below @ lower)
        gradient = bends(bends.transposed(z)) - target
        if gap < _GAP * len(y) and np.max(np.abs(gradient + upper - lower)) < 1e-6:
            return z
        centre = gap / (20 * len(z))
        bands = gram.copy()
        bands[2] -= upper / above + lower / below
        dz = solveh_banded(bands, -gradient + centre * (1 / above - 1 / below))
        du = -upper - centre / above - upper * dz / above
        dl = -lower - centre / below + lower * dz / below
        step = _longest_step((above, dz), (below, -dz), (-upper, -du), (-lower, -dl))
        z, upper, lower = z + step * dz, upper + step * du, lower + step * dl
    raise ComputationError(
        f"`TotalVariation` did not converge in {_MAX_STEPS} steps (gap {gap:.1e}); the "
        f"penalty may be far too large or small for this signal: change it tenfold."
    )


def _longest_step(*moves):
    """The step that keeps every (negative) value negative, with a margin."""
    step = 1.0
    for value, change in moves:
        rising = change > 0
        if rising.any():
            step = min(step, 0.99 * np.min(-value[rising] / change[rising]))
    return step
