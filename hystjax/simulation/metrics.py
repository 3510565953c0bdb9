"""How far a simulated output is from a measured one. Ratios, not per cent.

All take a third argument: `weights` of the samples, shape (n,), of which those that are
0 are not looked at; by default all samples count alike.
"""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Shaped

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
Scalar = Float[Array, ""]


def rmse(w: Signal, w_hat: Signal, weights: Signal | None = None) -> Scalar:
    """Root mean square of `w_hat - w`, in output units; both of shape (n,)."""
    return jnp.sqrt(_mean((w_hat - w) ** 2, weights))


def nrmse(w: Signal, w_hat: Signal, weights: Signal | None = None) -> Scalar:
    """`rmse` over the range max(w) - min(w)."""
    high, low = _largest(w, weights), -_largest(-w, weights)
    return rmse(w, w_hat, weights) / (high - low)


def max_error(w: Signal, w_hat: Signal, weights: Signal | None = None) -> Scalar:
    """Largest magnitude of `w_hat - w`, in output units."""
    return _largest(jnp.abs(w_hat - w), weights)


def relative_error(w: Signal, w_hat: Signal, weights: Signal | None = None) -> Scalar:
    """|w_hat - w| / |w| in the Euclidean norm: the formula printed by Chandra et al.
    (2023), doi 10.1063/5.0146134."""
    return jnp.sqrt(relative_squared_error(w, w_hat, weights))


def relative_squared_error(
    w: Signal, w_hat: Signal, weights: Signal | None = None
) -> Scalar:
    """mean((w_hat - w)^2) / mean(w^2): what the tables of Chandra et al. (2023) list,
    the square of `relative_error`."""
    return _mean((w_hat - w) ** 2, weights) / _mean(w**2, weights)


def r2(w: Signal, w_hat: Signal, weights: Signal | None = None) -> Scalar:
    """Coefficient of determination: 1 for a perfect output, 0 for a constant mean."""
    around = _mean((w - _mean(w, weights)) ** 2, weights)
    return 1 - _mean((w_hat - w) ** 2, weights) / around


def _mean(x: Signal, weights: Signal | None) -> Scalar:
    if weights is None:
        return jnp.mean(x)
    # What has no weight may be NaN.
    return jnp.sum(jnp.where(weights > 0, weights * x, 0.0)) / jnp.sum(weights)


def _largest(x: Signal, weights: Signal | None) -> Scalar:
    return jnp.max(x if weights is None else jnp.where(weights > 0, x, -jnp.inf))
