"""Which terms an excitation cannot tell apart."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Bool, Float

from .._jit import jit
from ._problem import LeastSquaresProblem


def rank_tolerance(dtype) -> float:
    """Share of a column below which what is left of it counts as rounding."""
    return 0.01 * float(jnp.finfo(dtype).eps) ** 0.5


@jit
def novelty(
    problem: LeastSquaresProblem,
    candidates: Bool[Array, " k"] | None = None,
    tolerance: Float[ArrayLike, ""] | None = None,
) -> tuple[Float[Array, " k"], Bool[Array, " k"]]:
    """What each column adds to the columns before it.

    Goes through the columns in order, so that of several that cannot be told apart the
    first is kept: with the lowest degree, in a library that lists low degrees first.

    **Arguments:**

    - `problem`: the factored problem.
    - `candidates`: columns to look at; all by default.
    - `tolerance`: a column of which a smaller share is new is not kept; rounding by
        default.

    **Returns:** the share of each column's norm that no kept column before it explains
    (0 to 1), and which columns are kept. Both of shape (k,).
    """
    triangle = jax.lax.stop_gradient(problem.triangle)
    k = triangle.shape[0]
    limit = rank_tolerance(triangle.dtype) if tolerance is None else tolerance
    candidates = jnp.ones(k, bool) if candidates is None else candidates

    def look(basis, column):
        vector, candidate = column
        size = jnp.linalg.norm(vector)
        left = vector - basis @ (basis.T @ vector)
        left = left - basis @ (basis.T @ left)  # again, or rounding stays behind
        length = jnp.linalg.norm(left)
        share = jnp.where(size > 0, length / jnp.where(size > 0, size, 1), 0.0)
        keep = candidate & (share > limit)
        direction = jnp.where(keep, left / jnp.where(length > 0, length, 1), 0.0)
        return basis, share, keep, direction

    def step(carry, column):
        basis, index = carry
        basis, share, keep, direction = look(basis, column)
        return (basis.at[:, index].set(direction), index + 1), (share, keep)

    start = (jnp.zeros_like(triangle), 0)
    _, (shares, kept) = jax.lax.scan(step, start, (triangle.T, candidates))
    return shares, kept
