"""How far a simulated output is from a measured one. Ratios, not per cent."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Shaped

Signal = Shaped[Array | np.ndarray, " n"]
Scalar = Float[Array, ""]


def rmse(w: Signal, w_hat: Signal) -> Scalar:
    """Root mean square of `w_hat - w`, in output units; both of shape (n,)."""
    return jnp.sqrt(jnp.mean((w_hat - w) ** 2))


def nrmse(w: Signal, w_hat: Signal) -> Scalar:
    """`rmse` over the range max(w) - min(w)."""
    return rmse(w, w_hat) / (jnp.max(w) - jnp.min(w))


def max_error(w: Signal, w_hat: Signal) -> Scalar:
    """Largest magnitude of `w_hat - w`, in output units."""
    return jnp.max(jnp.abs(w_hat - w))


def relative_error(w: Signal, w_hat: Signal) -> Scalar:
    """|w_hat - w| / |w| in the Euclidean norm: the formula printed by Chandra et al.
    (2023), doi 10.1063/5.0146134."""
    return jnp.sqrt(relative_squared_error(w, w_hat))


def relative_squared_error(w: Signal, w_hat: Signal) -> Scalar:
    """mean((w_hat - w)^2) / mean(w^2): what the tables of Chandra et al. (2023) list,
    the square of `relative_error`."""
    return jnp.mean((w_hat - w) ** 2) / jnp.mean(w**2)


def r2(w: Signal, w_hat: Signal) -> Scalar:
    """Coefficient of determination: 1 for a perfect output, 0 for a constant mean."""
    return 1 - jnp.sum((w_hat - w) ** 2) / jnp.sum((w - jnp.mean(w)) ** 2)
