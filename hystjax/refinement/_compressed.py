"""Residuals for a least-squares solver: as many numbers as there are unknowns, and one.

All that Gauss-Newton methods know of residuals r and their Jacobian J is
[J r]'[J r]. Its Cholesky factor has the same product: the last column takes the place
of r, the others that of J, and whatever a solver does with them no longer depends on
the number of samples. The condition number is squared, which does no harm to
coordinates in which the first Jacobian is orthogonal.
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._jit import jit
from ._columns import value_and_columns
from ._objective import Objective, Unknowns


class Problem(eqx.Module):
    """A fit as least squares over one vector x: unbounded values and, when x is longer
    than these, the starts.

    **Attributes:** the `objective`; the `starts` where they are not fitted; and the
    `stage`, which are the further arguments of `Objective.residuals`.
    """

    objective: Objective
    starts: Float[Array, "r pieces d"]
    stage: tuple

    def unknowns(self, x: Float[Array, " q"]) -> Unknowns:
        """What is fitted, in natural units."""
        parameters = self.objective.parameters
        values, rest = jnp.split(x, [len(parameters.names)])
        starts = rest.reshape(self.starts.shape) if len(rest) else self.starts
        return Unknowns(parameters.bounded(values), starts)

    def residuals(self, x: Float[Array, " q"]) -> Float[Array, " m"]:
        """What is squared and summed."""
        parts = self.objective.residuals(self.unknowns(x), *self.stage)
        return jnp.concatenate([part.ravel() for part in parts])


class Whitened(eqx.Module):
    """A problem in other coordinates z, where x = origin + spread z."""

    problem: Problem
    origin: Float[Array, " q"]
    spread: Float[Array, "q q"]

    def residuals(self, z: Float[Array, " q"]) -> Float[Array, " m"]:
        """The problem's residuals."""
        return self.problem.residuals(self.origin + self.spread @ z)


@eqx.filter_custom_jvp
def compressed(z: Float[Array, " q"], whitened: Whitened) -> Float[Array, " q+1"]:
    """q + 1 numbers with the sum of squares of the residuals at z, and the same
    products of their derivatives with them and with each other."""
    return factor(z, whitened)[:, -1]


@compressed.def_jvp
def _(primals, tangents):
    # A solver's derivatives, by z. The derivative of what it ends at is one of
    # J'r = triangle[:, :-1]' triangle[:, -1], and gets here with `factor` itself.
    z, whitened = primals
    triangle = factor(z, whitened)
    return triangle[:, -1], triangle[:, :-1] @ tangents[0]


# A program has several of these: this traces them once.
@jit
def factor(z: Float[Array, " q"], whitened: Whitened) -> Float[Array, "q+1 q+1"]:
    """The triangle with the product [J r]'[J r], where columns of J that are not finite
    count as zero."""
    value, columns = value_and_columns(whitened.residuals, z)
    rows = jnp.concatenate([columns, value[None]])
    squares = jnp.sum(rows**2, axis=1)
    usable = jnp.isfinite(squares)
    product = jnp.where(usable & usable[:, None], rows @ rows.T, 0.0)
    lengths = jnp.sqrt(jnp.where(usable & (squares > 0), squares, 1.0))
    # Columns that depend on each other to rounding still have a factor.
    least = 10 * len(lengths) * jnp.finfo(product.dtype).eps
    scaled = product / lengths / lengths[:, None] + least * jnp.eye(
        len(lengths), dtype=z.dtype
    )
    return jnp.linalg.cholesky(scaled).T * lengths
