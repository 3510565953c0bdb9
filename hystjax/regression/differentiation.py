"""Derivatives of sampled signals."""

import functools
from abc import abstractmethod
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._core import checks
from .._core.checks import ComputationError, InputError, is_concrete

__all__ = [
    "AbstractDifferentiation",
    "FiniteDifference",
    "SavitzkyGolay",
    "SmoothingSpline",
    "TotalVariation",
]


def __dir__() -> list[str]:
    return __all__


class AbstractDifferentiation(eqx.Module):
    """Estimates a signal and its time derivative from samples."""

    @property
    def reach(self) -> int | None:
        """Samples on either side that an estimate looks at; None for all."""
        return None

    @abstractmethod
    def estimate(
        self, t: Float[Array, " n"], y: Float[Array, " n"]
    ) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
        """The signal with this method's smoothing, and its derivative.

        **Arguments:** times `t` in s, increasing strictly, evenly spaced or not; values
        `y` in any unit.

        **Returns:** both of shape (n,); the derivative in units of `y` a second.

        **Raises:** `InputError` when there are too few samples, or `t` and `y` are no
        columns of numbers of one length; `ComputationError` where no estimate is found.
        Under `jit` and `vmap`, where others would be stopped, that is NaN.
        """

    def __call__(
        self, t: Float[Array, " n"], y: Float[Array, " n"]
    ) -> Float[Array, " n"]:
        """The derivative alone."""
        return self.estimate(t, y)[1]


def _columns(
    what: str, least: int, t: Any, y: Any, instead: str = "a wider window"
) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
    """Times and values as columns of floats, of at least so many samples."""
    t, y = checks.vector("t", t), checks.vector("y", y)
    checks.same_length(t=t, y=y)
    checks.enough_samples(what, len(t), least, instead)
    return t, y


def on_host(
    function: Callable, t: jax.Array, y: jax.Array, penalty: float | None
) -> tuple[jax.Array, jax.Array]:
    """`function(t, y, penalty)` -> (signal, derivative) by NumPy, under `jit` and
    `vmap` too, where an error would stop all that runs beside it: NaN comes instead.

    The result has no derivative with respect to `t` and `y`. The call has the name of
    `function` and closes over nothing else, so that a program that holds it, and its
    numbers, tell all.
    """
    t, y = jax.lax.stop_gradient((t, y))

    @functools.wraps(function)
    def call(t, y, penalty):
        number = None if penalty is None else float(penalty)
        try:
            found = function(np.asarray(t, float), np.asarray(y, float), number)
        except (ComputationError, ValueError):  # the latter of SciPy, for what is NaN
            found = np.full((2, len(y)), np.nan)
        value, slope = found
        return value.astype(y.dtype), slope.astype(y.dtype)

    if is_concrete(t, y):
        checks.finite("t", t)
        checks.finite("y", y)
        checks.increasing("t", t)
        found = function(np.asarray(t, float), np.asarray(y, float), penalty)
        return jnp.asarray(found[0], y.dtype), jnp.asarray(found[1], y.dtype)
    shapes = (jax.ShapeDtypeStruct(jnp.shape(y), y.dtype),) * 2
    return jax.pure_callback(call, shapes, t, y, penalty, vmap_method="sequential")


class FiniteDifference(AbstractDifferentiation):
    """Three-point differences, second order on uneven grids and at the ends too.

    The derivative of the parabola through three neighbouring samples. Right for clean
    simulated records only: noise is amplified by one over the step.
    """

    @property
    def reach(self):
        return 1

    def estimate(self, t, y):
        t, y = _columns("`FiniteDifference`", 3, t, y)
        step = jnp.diff(t)
        slope = jnp.diff(y) / step
        before, after = step[:-1], step[1:]
        middle = (after * slope[:-1] + before * slope[1:]) / (before + after)
        # The parabola's slope is linear in time, so the ends follow by extrapolation.
        first = 2 * slope[:1] - middle[:1]
        last = 2 * slope[-1:] - middle[-1:]
        return y, jnp.concatenate([first, middle, last])


class SavitzkyGolay(AbstractDifferentiation):
    """Least-squares polynomials over a moving window of samples.

    Fitted in actual time, so uneven sampling is treated rightly; on even grids it is
    the classical filter. Near the ends the outermost window is used off its centre.

    **Attributes:**

    - `window`: number of samples, odd, more than `order`.
    - `order`: degree of the polynomial.

    **Source:** Savitzky and Golay (1964), doi 10.1021/ac60214a047.
    """

    window: int = eqx.field(
        converter=functools.partial(checks.whole, "window"), static=True, default=15
    )
    order: int = eqx.field(
        converter=functools.partial(checks.whole, "order"), static=True, default=3
    )

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
        what = f"`SavitzkyGolay(window={self.window})`"
        t, y = _columns(what, self.window, t, y, "a smaller `window`")
        n = len(t)
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


def _check_penalty(penalty: float, *, zero: bool = False) -> None:
    """Raise `InputError` unless it is one number, positive (or zero) and finite."""
    checks.positive("penalty", penalty, zero=zero)
    if np.ndim(penalty) or not np.isfinite(penalty):
        raise InputError(
            f"`penalty` must be one finite number, got {checks.described(penalty)}."
        )


class SmoothingSpline(AbstractDifferentiation):
    """The natural cubic spline that minimises squared residuals plus
    `penalty` times the integral of the squared second derivative.

    Computed on the host; it has no derivative with respect to the samples.

    **Attributes:**

    - `penalty`: in units of s^3; `None` chooses it by generalised cross-validation, up
        to 1e13 times the cube of the mean step.

    **Source:** Reinsch (1967), doi 10.1007/BF02162161; for the choice Woltring (1986),
    doi 10.1016/0141-1195(86)90098-7.
    """

    penalty: float | None = eqx.field(static=True, default=None)

    def __check_init__(self):
        if self.penalty is not None:
            _check_penalty(self.penalty, zero=True)

    def estimate(self, t, y):
        t, y = _columns("`SmoothingSpline`", 5, t, y)
        return on_host(_by_spline, t, y, self.penalty)


def _by_spline(t, y, penalty):
    # In steps, for the arithmetic's sake.
    step = np.mean(np.diff(t))
    bent = _Bent(np.diff(t) / step, y)
    alpha = bent.cross_validated() if penalty is None else penalty / step**3
    curvature = bent.curvature(alpha)
    signal = y - alpha * bent.bends.transposed(curvature)
    left, right = np.pad(curvature, (1, 0)), np.pad(curvature, (0, 1))
    rise, sixth = np.diff(signal) / bent.steps, bent.steps / 6
    slope = rise - sixth * (2 * left + right)
    last = rise[-1] + sixth[-1] * (left[-1] + 2 * right[-1])
    return signal, np.append(slope, last) / step


_DECADES = np.arange(-8.0, 13.5, 0.5)  # of penalties, in cubes of steps
_CHANGE = 0.01  # of their logarithms, over which determinants are differenced


class _Bent:
    """Reinsch's equations for the curvature g of a smoothing spline at inner samples:
    (R + alpha D D') g = D y, with D the changes of slope, R the Gram matrix of hat
    functions, and the spline y - alpha D' g."""

    def __init__(self, steps, y):
        self.steps, self.y, self.bends = steps, y, _SlopeChanges(steps)
        self._gram, self._hats = self.bends.gram(), np.zeros((3, len(y) - 2))
        self._hats[2] = (steps[:-1] + steps[1:]) / 3
        self._hats[1, 1:] = steps[1:-1] / 6

    def _bands(self, alpha):
        return self._hats + alpha * self._gram

    def curvature(self, alpha):
        from scipy.linalg import solve_banded  # slow to import, and rarely needed

        upper = self._bands(alpha)
        lower = np.zeros((2, upper.shape[1]))
        lower[0, :-1], lower[1, :-2] = upper[1, 1:], upper[0, 2:]
        # By pivots: of penalties that leave a straight line rounding may make the
        # matrix indefinite.
        return solve_banded((2, 2), np.vstack([upper, lower]), self.bends(self.y))

    def cross_validated(self):
        """The penalty of the least generalised cross-validation score: of a grid, for
        there may be several minima, and of what is beside the best of that."""
        from scipy.optimize import minimize_scalar

        scores = [self._score(decade) for decade in _DECADES]
        best = _DECADES[np.argmin(scores)]
        bounds = np.clip([best - 0.5, best + 0.5], _DECADES[0], _DECADES[-1])
        near: Any = minimize_scalar(self._score, bounds=bounds, method="bounded")
        return 10.0 ** (near.x if near.fun < min(scores) else best)

    def _score(self, decade):
        """The squared residuals over the square of the trace of what makes them of y,
        which is how log det(R + alpha D D') changes with log alpha; infinite where
        rounding leaves no determinant."""
        alpha = 10.0**decade
        more, less = alpha * np.exp([_CHANGE, -_CHANGE])
        try:
            change = self._determinant(more) - self._determinant(less)
        except np.linalg.LinAlgError:
            return np.inf
        residual = alpha * self.bends.transposed(self.curvature(alpha))
        return (residual @ residual) / (change / (2 * _CHANGE)) ** 2

    def _determinant(self, alpha):
        """Its logarithm."""
        from scipy.linalg import cholesky_banded

        return 2 * np.sum(np.log(cholesky_banded(self._bands(alpha))[2]))


_MAX_STEPS = 100
_GAP = 1e-9  # duality gap, relative to the signal's sum of squares


class TotalVariation(AbstractDifferentiation):
    """The derivative with the fewest and smallest jumps that explains the samples.

    Minimises half the sum of squared residuals plus `penalty` times the total variation
    of the slopes between samples: the smoothed signal is piecewise linear, and corners
    at turning points stay sharp. Solved on the host by an interior-point method on the
    dual; it has no derivative with respect to the samples.

    **Attributes:**

    - `penalty`: in s, for a signal whose standard deviation about the straight line
        through its ends is 1, to which each is scaled: one number then serves output
        and input, whatever their units.

    **Source:** Chartrand (2011), doi 10.5402/2011/164564; in this form, l1 trend
    filtering, Kim, Koh, Boyd and Gorinevsky (2009), doi 10.1137/070690274.
    """

    penalty: float = eqx.field(static=True)

    def __check_init__(self):
        _check_penalty(self.penalty)

    def estimate(self, t, y):
        t, y = _columns("`TotalVariation`", 4, t, y)
        return on_host(_by_variation, t, y, self.penalty)


def _by_variation(t, y, penalty):
    # A straight line costs nothing, and would hide what is beside it.
    line = y[0] + (y[-1] - y[0]) * (t - t[0]) / (t[-1] - t[0])
    y = y - line
    # The unit of a signal must not decide how much of it is noise. Unit steps on
    # average, for the arithmetic's sake.
    step, scale = np.mean(np.diff(t)), np.std(y) or 1.0
    bends = _SlopeChanges(np.diff(t) / step)
    dual = _solve_dual(bends, y / scale, penalty / step)
    signal = line + y - scale * bends.transposed(dual)
    return signal, np.gradient(signal, t, edge_order=1)


class _SlopeChanges:
    """The operator D that takes a signal to the changes of its slope."""

    def __init__(self, steps):
        self.left, self.right = 1 / steps[:-1], 1 / steps[1:]
        self.middle = -(self.left + self.right)
        self.uneven = np.max(steps) / np.min(steps)

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
    from scipy.linalg import solveh_banded  # slow to import, and rarely needed

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
        try:
            dz = solveh_banded(bands, -gradient + centre * (1 / above - 1 / below))
        except ValueError:  # singular: a step so short that others are rounding of it
            break
        du = -upper - centre / above - upper * dz / above
        dl = -lower - centre / below + lower * dz / below
        step = _longest_step((above, dz), (below, -dz), (-upper, -du), (-lower, -dl))
        z, upper, lower = z + step * dz, upper + step * du, lower + step * dl
    raise ComputationError(
        f"`TotalVariation` did not converge (gap {gap:.1e}); the penalty may be far "
        "too large or small for this signal: change it tenfold. Or times are too "
        f"uneven, of which the longest step is {bends.uneven:.1g} times the shortest: "
        "leave out samples that are hardly apart, or resample."
    )


def _longest_step(*moves):
    """The step that keeps every (negative) value negative, with a margin."""
    step = 1.0
    for value, change in moves:
        rising = change > 0
        if rising.any():
            step = min(step, 0.99 * np.min(-value[rising] / change[rising]))
    return step
