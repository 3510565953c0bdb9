"""Least squares over the unknowns, scaled so that units do not matter, and compressed:
as many residuals as there are unknowns, and one.

All that Gauss-Newton methods know of residuals r and their Jacobian J is
[J r]'[J r]. Its Cholesky factor has the same product: the last column takes the place
of r, the others that of J, and whatever a solver does with them no longer depends on
the number of samples. The condition number is squared, which does no harm to
coordinates in which the first Jacobian is orthogonal.
"""

from collections.abc import Callable
from typing import TypeAlias, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import optimistix as optx
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float, Int

from .._core.jit import jit
from .._core.solution import RESULTS
from ..library import at
from ._objective import Objective, Unknowns
from ._parameters import Parameters

Values = TypeVar("Values")


def value_and_columns(
    function: Callable[[Float[Array, " q"]], Values], x: Float[Array, " q"]
) -> tuple[Values, Values]:
    """f(x), and the q columns of its Jacobian along a first axis."""

    # Compiles faster than `jax.linearize` does, which splits the program in two.
    def along(direction):
        return jax.jvp(function, (x,), (direction,))

    return jax.vmap(along, out_axes=(None, 0))(jnp.eye(len(x), dtype=x.dtype))


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


_SHORTEST = 1e-6  # smallest singular value that is divided by, relative
_FIRMNESS = 0.1  # residual, over the output's spread, that doubling a parameter is

Solver: TypeAlias = optx.AbstractLeastSquaresSolver | optx.AbstractMinimiser


class Minimum(eqx.Module):
    """Where a fit ended.

    **Attributes:** the `unknowns` there; the `loss`, half the squared residuals; the
    `result`; and how many steps it took.
    """

    unknowns: Unknowns
    loss: Float[Array, ""]
    result: RESULTS
    num_steps: Int[Array, ""]


def minimise(
    objective: Objective,
    first: Unknowns,
    solver: Solver,
    max_steps: int,
    horizon: Float[Array, ""] | float = 1.0,
    gap_weight: Float[Array, ""] | float = 0.0,
    gain: Float[Array, ""] | None = None,
) -> Minimum:
    """Fit the unknowns, from the first ones.

    Unbounded coordinates are whitened by the first Jacobian, so that neither units nor
    correlations matter to damping and tolerances.
    """
    parameters = objective.parameters
    values = parameters.unbounded(first.values)
    free_starts = objective.free_starts
    starts_too = free_starts or first.starts.shape[1] > 1
    starts = first.starts if starts_too else None
    origin, _ = ravel_pytree((values, starts))
    free, _ = ravel_pytree((jnp.ones_like(values), _free_starts(starts, free_starts)))
    firm = jnp.zeros_like(origin).at[: len(values)].set(_firmness(parameters, values))
    problem = Problem(objective, first.starts, (horizon, gap_weight, gain))

    def descend(x, pin):
        pinned = x.at[: len(values)].set(parameters.pinned(x[: len(values)]))
        x = jnp.where(pin, pinned, x) if parameters.limited else x
        x, end = _descend(problem, x, free, firm, solver, max_steps)
        return x, (x, end)

    if parameters.limited:
        # Towards a bound the steps get ever shorter: on it, the rest is fitted fast.
        # One program for both.
        ends = jax.lax.scan(descend, origin, jnp.array([False, True]))[1]
        first, on_bounds = at(ends, 0), at(ends, 1)
        x, end = _better(on_bounds, first)
    else:
        x, end = descend(origin, False)[1]
    loss, result, num_steps = end
    return Minimum(problem.unknowns(x), loss, result, num_steps)


def _descend(problem: Problem, origin, free, firm, solver: Solver, max_steps: int):
    """Where least squares lead to from a point; the loss, result and steps."""
    unscaled = Whitened(problem, origin, jnp.eye(len(origin), dtype=origin.dtype))
    triangle = factor(jnp.zeros_like(origin), unscaled)
    spread = free[:, None] * _whitening(triangle[:, :-1], firm)
    solution = optx.least_squares(
        compressed,
        solver,
        jnp.zeros_like(origin),
        Whitened(problem, origin, spread),
        # What our own solver would otherwise look at once more.
        options={"residuals": triangle[:, -1], "jacobian": triangle[:, :-1] @ spread},
        max_steps=max_steps,
        throw=False,
    )
    x = origin + spread @ solution.value
    loss = jnp.sum(problem.residuals(x) ** 2) / 2
    result = RESULTS.promote(solution.result)
    return x, (loss, result, jnp.asarray(solution.stats["num_steps"]))


def _better(later, before):
    """The end with the lesser loss, the later one if they are equal but for rounding;
    and the steps of both."""
    x, (loss, result, steps) = later
    old_x, (old_loss, old_result, old_steps) = before
    good = loss <= old_loss * (1 + 1e-9)
    result = RESULTS.where(good, result, old_result)  # pyright: ignore
    loss = jnp.where(good, loss, old_loss)
    return jnp.where(good, x, old_x), (loss, result, steps + old_steps)


def _free_starts(starts, free_starts: bool):
    """The first start only if asked for; the others always, or pieces cannot move."""
    if starts is None:
        return None
    free = jnp.ones_like(starts)
    return free if free_starts else free.at[:, 0].set(0.0)


def _firmness(parameters: Parameters, values) -> Float[Array, " p"]:
    """What keeps a damped step from changing parameters many times over in directions
    that hardly matter where it starts."""
    limited = jnp.isfinite(parameters.lower) | jnp.isfinite(parameters.upper)
    size = jnp.where(limited, 1.0, jnp.abs(values))
    return jnp.where(size > 0, _FIRMNESS / jnp.where(size > 0, size, 1.0), 0.0)


def _whitening(triangle, firm) -> Float[Array, "q q"]:
    """Directions in which the residuals, with those of changing the unknowns, change by
    their whole size, independently of each other: the inverse of the Jacobian's
    triangle.

    In these coordinates a damped step is a shortened Gauss-Newton step, however
    correlated the unknowns are. Directions that hardly matter are left short.
    """
    jacobian = jnp.concatenate([triangle, jnp.diag(firm)])
    lengths = jnp.linalg.norm(jacobian, axis=0)
    lengths = jnp.where(lengths > 0, lengths, 1.0)
    _, sizes, directions = jnp.linalg.svd(jacobian / lengths, full_matrices=False)
    sizes = jnp.maximum(sizes, _SHORTEST * jnp.maximum(sizes[0], 1e-3))
    # The minimum does not depend on coordinates: neither do its derivatives.
    return jax.lax.stop_gradient(directions.T / sizes / lengths[:, None])
