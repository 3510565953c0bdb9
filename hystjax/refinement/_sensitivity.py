"""Simulated states of a batch of segments."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float

from ..interpolation import Grid, Signals
from ..models import AbstractModel
from ..simulation import flow, march


class Pull(NamedTuple):
    """What draws trajectories to the measured output before each of m steps: by which
    share of the distance, and to where."""

    gain: Float[Array, "*batch m"]
    target: Float[Array, "*batch m"]


class Drive(NamedTuple):
    """What m steps need to know besides the state: the input, the pull if there is one,
    and the memory at the start, the middle and the end of each."""

    grid: Grid
    pull: Pull | None
    memory: tuple[Any, Any, Any]


def states(
    model: AbstractModel,
    starts: Float[Array, "segments d"],
    drive: Drive,
    substeps: int,
) -> Float[Array, "segments n d"]:
    """Flowing states at the sample times of a batch of segments.

    **Arguments:** the model; states at the start of each segment, flattened to d
    numbers; what drives the segments, along the first axis of its arrays; and steps a
    sample interval.
    """

    def run(start, drive):
        path = march(_step, model, state_like(model, start), drive)
        return jax.vmap(flat)(path)[::substeps]

    return _each_segment(run, starts, drive)


def _step(model: AbstractModel, x: Any, row: Drive) -> Any:
    """The state after a step, drawn to the measured output before it."""
    if row.pull is not None:
        x = _drawn(model, x, row.pull, row.memory[0], row.grid.start)
    return flow(model, x, row.memory, row.grid)


def _drawn(model: AbstractModel, x: Any, pull: Pull, m: Any, now: Signals) -> Any:
    """A state moved along the outputs that a start may have, towards a measured one; or
    a new start there, where the state has been lost."""
    kept = jnp.all(jnp.isfinite(flat(x)))
    return jax.tree.map(
        lambda leaf, there, here: jnp.where(
            kept, leaf + pull.gain * (there - here), there
        ),
        x,
        model.start(m, now, pull.target),
        model.start(m, now, model.output(x, m, now)),
    )


def flat(x: Any) -> Float[Array, " d"]:
    """A state as d numbers."""
    return ravel_pytree(x)[0]


def state_like(model: AbstractModel, row: Float[Array, " d"]) -> Any:
    """A flattened state in the model's own structure."""
    zero = jnp.zeros((), row.dtype)
    now = Signals(zero, zero, zero)
    return ravel_pytree(model.start(model.memory.start(now), now, zero))[1](row)


def _each_segment(function: Callable, starts, drive: Drive):
    """`vmap`, but for a lone segment, whose loop over scalars is faster than one over
    arrays of length 1."""
    if starts.shape[0] > 1:
        return jax.vmap(function)(starts, drive)
    lone = jax.tree.map(lambda leaf: leaf[0], (starts, drive))
    return jax.tree.map(lambda leaf: leaf[None], function(*lone))
