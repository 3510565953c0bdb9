"""Least squares over the unknowns, scaled so that units do not matter."""

from typing import TypeAlias

import equinox as eqx
import jax
import jax.numpy as jnp
import optimistix as optx
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float, Int

from .._solution import RESULTS
from ..regression import compress
from ._objective import Objective, Unknowns

_SHORTEST = 1e-6  # smallest singular value that is divided by, relative

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
    free_starts: bool,
    solver: Solver,
    max_steps: int,
    horizon: Float[Array, ""] | float = 1.0,
    gap_weight: Float[Array, ""] | float = 0.0,
) -> Minimum:
    """Fit the unknowns, from the first ones.

    Unbounded coordinates are whitened by the first Jacobian, so that neither units nor
    correlations matter to damping and tolerances.
    """
    parameters = objective.parameters
    origin, restore = ravel_pytree((parameters.unbounded(first.values), first.starts))
    free = (
        jnp.ones_like(origin)
        .at[len(first.values) :]
        .set(_free_starts(first.starts, free_starts).ravel())
    )

    def unknowns(x) -> Unknowns:
        values, starts = restore(origin + x)
        return Unknowns(parameters.bounded(values), starts)

    def residuals(x):
        return objective.residuals(unknowns(x), horizon, gap_weight)

    spread = free[:, None] * _whitening(residuals, jnp.zeros_like(origin))
    solution = optx.least_squares(
        lambda z, _: residuals(spread @ z),
        solver,
        jnp.zeros_like(origin),
        max_steps=max_steps,
        throw=False,
    )
    end = spread @ solution.value
    loss = sum(jnp.sum(part**2) for part in residuals(end)) / 2
    return Minimum(
        unknowns(end),
        jnp.asarray(loss),
        RESULTS.promote(solution.result),
        jnp.asarray(solution.stats["num_steps"]),
    )


def _free_starts(starts, free_starts: bool):
    """The first start only if asked for; the others always, or pieces cannot move."""
    free = jnp.ones_like(starts)
    return free if free_starts else free.at[:, 0].set(0.0)


def _whitening(residuals, x) -> Float[Array, "q q"]:
    """Directions in which the residuals change by their whole size, independently of
    each other: the inverse of the Jacobian's triangle.

    In these coordinates a damped step is a shortened Gauss-Newton step, however
    correlated the unknowns are. Directions that hardly matter are left short.
    """
    _, push = jax.linearize(residuals, x)
    parts = jax.vmap(push, out_axes=-1)(jnp.eye(len(x), dtype=x.dtype))
    jacobian = jnp.concatenate([part.reshape(-1, len(x)) for part in parts])
    usable = jnp.all(jnp.isfinite(jacobian), axis=0)
    lengths = jnp.linalg.norm(jnp.where(usable, jacobian, 0.0), axis=0)
    lengths = jnp.where(lengths > 0, lengths, 1.0)
    scaled = jnp.where(usable, jacobian / lengths, 0.0)
    problem = compress(scaled, jnp.zeros_like(scaled[:, 0]))
    _, sizes, directions = jnp.linalg.svd(problem.triangle)
    sizes = jnp.maximum(sizes, _SHORTEST * jnp.maximum(sizes[0], 1e-3))
    # The minimum does not depend on coordinates: neither do its derivatives.
    return jax.lax.stop_gradient(directions.T / sizes / lengths[:, None])
