"""Local polynomial smoothing."""

import equinox as eqx
import jax
import jax.numpy as jnp

from .. import _checks
from .._errors import InputError
from ._base import AbstractDifferentiation


class SavitzkyGolay(AbstractDifferentiation):
    """Least-squares polynomials over a moving window of samples.

    Fitted in actual time, so uneven sampling is treated rightly; on even grids it is
    the classical filter. Near the ends the outermost window is used off its centre.

    **Attributes:**

    - `window`: number of samples, odd, more than `order`.
    - `order`: degree of the polynomial.

    **Source:** Savitzky and Golay (1964), doi 10.1021/ac60214a047.
    """

    window: int = eqx.field(static=True, default=15)
    order: int = eqx.field(static=True, default=3)

    def __check_init__(self):
        if self.window % 2 == 0 or not 1 <= self.order < self.window:
            raise InputError(
                "`window` must be odd and larger than `order`, which must be at least "
                f"1; got window={self.window}, order={self.order}."
            )

    @property
    def reach(self):
        return self.window // 2

    def estimate(self, t, y):
        n = t.shape[0]
        _checks.enough_samples(f"`SavitzkyGolay(window={self.window})`", n, self.window)
        start = jnp.clip(jnp.arange(n) - self.window // 2, 0, n - self.window)
        rows = start[:, None] + jnp.arange(self.window)
        return jax.vmap(self._local)(t, t[rows], y[rows])

    def _local(self, now, times, values):
        # Times in units of the window's width keep the powers well conditioned.
        width = times[-1] - times[0]
        powers = jnp.vander((times - now) / width, self.order + 1, increasing=True)
        orthogonal, triangle = jnp.linalg.qr(powers)
        fit = jax.scipy.linalg.solve_triangular(triangle, orthogonal.T @ values)
        return fit[0], fit[1] / width
