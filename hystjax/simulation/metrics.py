"""How far a simulated output is from a measured one. Ratios, not per cent.

All take a third argument: `weights` of the samples, shape (n,), of which those that are
0 are not looked at; by default all samples count alike. What JAX's arrays are given for
is computed by JAX, and by NumPy what NumPy's are, which compiles nothing. Whole
numbers, as converters give them, count as floats. All raise `InputError` for signals
and weights that are not equally long, for what is no array of numbers or an empty one,
and for weights that are negative or all zero.
"""

from typing import Any

import jax
import numpy as np
from jaxtyping import Array, Float, Shaped

from .._core import checks
from .._core.checks import InputError, described

__all__ = [
    "max_error",
    "nrmse",
    "r2",
    "relative_error",
    "relative_squared_error",
    "rmse",
]


def __dir__() -> list[str]:
    return __all__


Signal = Shaped[Array | np.ndarray, " n"]
Scalar = Float[Any, ""]  # of the kind of the signals


def rmse(w: Signal, w_hat: Signal, weights: Signal | None = None) -> Scalar:
    """Root mean square of `w_hat - w`, in output units; both of shape (n,)."""
    return _mean_square(_off(w, w_hat), weights) ** 0.5


def nrmse(w: Signal, w_hat: Signal, weights: Signal | None = None) -> Scalar:
    """`rmse` over the range max(w) - min(w)."""
    w = _floats("w", w)
    high, low = _largest(w, weights), -_largest(-w, weights)
    return rmse(w, w_hat, weights) / (high - low)


def max_error(w: Signal, w_hat: Signal, weights: Signal | None = None) -> Scalar:
    """Largest magnitude of `w_hat - w`, in output units."""
    return _largest(abs(_off(w, w_hat)), weights)


def relative_error(w: Signal, w_hat: Signal, weights: Signal | None = None) -> Scalar:
    """|w_hat - w| / |w| in the Euclidean norm: the formula printed by Chandra et al.
    (2023), doi 10.1063/5.0146134."""
    return relative_squared_error(w, w_hat, weights) ** 0.5


def relative_squared_error(
    w: Signal, w_hat: Signal, weights: Signal | None = None
) -> Scalar:
    """mean((w_hat - w)^2) / mean(w^2): what the tables of Chandra et al. (2023) list,
    the square of `relative_error`."""
    w = _floats("w", w)
    return _mean_square(_off(w, w_hat), weights) / _mean_square(w, weights)


def r2(w: Signal, w_hat: Signal, weights: Signal | None = None) -> Scalar:
    """Coefficient of determination: 1 for a perfect output, 0 for a constant mean."""
    w = _floats("w", w)
    around = _mean_square(w - _mean(w, weights), weights)
    return 1 - _mean_square(_off(w, w_hat), weights) / around


def _floats(name: str, x: Signal) -> Signal:
    values = x if isinstance(x, jax.Array) else np.asarray(x)
    if values.dtype.kind in "OSU":
        raise InputError(
            f"`{name}` must be an array of numbers, such as `recording.w`; got "
            f"{described(x)}."
        )
    if not values.size:
        raise InputError(f"`{name}` has no samples.")
    # Squares and differences of whole numbers of few bits would leave what these hold.
    return 1.0 * values


def _off(w: Signal, w_hat: Signal) -> Signal:
    w, w_hat = _floats("w", w), _floats("w_hat", w_hat)
    if w.shape != w_hat.shape:
        raise InputError(
            f"`w` and `w_hat` must be equally long, one value a sample, got shapes "
            f"{w.shape} and {w_hat.shape}."
        )
    return w_hat - w


def _mean(x: Signal, weights: Signal | None, power: int = 1) -> Scalar:
    if weights is None:
        return (x**power).mean()
    weights = _for(x, weights)
    # What has no weight may be NaN, which in a square would be in derivatives.
    known = _where(weights > 0, x, 0.0)
    return (weights * known**power).sum() / weights.sum()


def _mean_square(x: Signal, weights: Signal | None) -> Scalar:
    return _mean(x, weights, 2)


def _largest(x: Signal, weights: Signal | None) -> Scalar:
    if weights is None:
        return x.max()
    return _where(_for(x, weights) > 0, x, -np.inf).max()


def _where(known: Signal, x: Signal, otherwise: float) -> Signal:
    """By JAX where either array is JAX's: weights may be traced where signals are
    not."""
    library = known if isinstance(known, jax.Array) else x
    return library.__array_namespace__().where(known, x, otherwise)


def _for(x: Signal, weights: Signal) -> Signal:
    weights = _floats("weights", weights)
    if weights.shape != x.shape:
        raise InputError(
            f"`weights` must have one value for each of the {x.size} samples, got "
            f"shape {weights.shape}."
        )
    checks.positive("weights", weights, zero=True)
    if checks.is_concrete(weights) and not np.any(np.asarray(weights)):
        raise InputError("`weights` are all 0: no sample is left to be looked at.")
    return weights
