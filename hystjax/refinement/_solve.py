"""Least squares over the unknowns, scaled so that units do not matter."""

from typing import TypeAlias

import equinox as eqx
import jax
import jax.numpy as jnp
import optimistix as optx
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float, Int

from .._solution import RESULTS
from ..library import at
from ._compressed import Problem, Whitened, compressed, factor
from ._objective import Objective, Unknowns
from ._parameters import Parameters

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
