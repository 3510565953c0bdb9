"""The inverse of relays that stand as a staircase: which level the input has to come
to."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ..library import Staircase
from ..library._memory import along_turns
from ..models import AbstractModel
from ..signals import Signals
from ._follow import Task

_ROUNDING = 1e-9  # of what the output can change by


class _Standing(NamedTuple):
    """A state on the way: the heights of the staircase, the input, and what the output
    is and was to be; the outputs to which each level would lead from here; and whether
    until here these rose with the levels, or fell."""

    heights: Any
    u: Float[Array, ""]
    w: Float[Array, ""]
    target: Float[Array, ""]
    ahead: Float[Array, " n"]
    one_way: Bool[Array, ""]


def switched(
    model: AbstractModel, memory: Staircase, task: Task
) -> tuple[Float[Array, " n"], Float[Array, " n"], Bool[Array, ""]]:
    """The inputs that bring the output as close to the reference as it comes on the way
    there, and the outputs; and whether outputs rose with the levels all along, or all
    along fell, without which the way there need not be the shortest.

    As long as the reference goes one way so does the input, and which level it has to
    come to can be told for all samples at once from the outputs that lay ahead where
    the reference turned.
    """
    levels = memory.levels
    x = model.start(task.m, _at(task.u), task.reference[0])

    def output(heights):
        return model.output(x, heights, _at(task.u))  # whatever the input is

    def outputs_ahead(heights):
        return jax.vmap(lambda u: output(memory.after(heights, _at(u), _at(u))))(levels)

    ahead = outputs_ahead(task.m)
    span = ahead[-1] - ahead[0]
    sign = jnp.sign(span)

    def after(state: _Standing, target):
        onward = sign * (target - state.target) * (levels - state.u) > 0
        off = jnp.where(onward, jnp.abs(state.ahead - target), jnp.inf)
        # Of levels that do as well the one that is least far.
        far = jnp.where(off == jnp.min(off), jnp.abs(levels - state.u), jnp.inf)
        level = jnp.argmin(far)
        moves = off[level] < jnp.abs(state.w - target)
        u = jnp.where(moves, levels[level], state.u)
        w = jnp.where(moves, state.ahead[level], state.w)
        heights = memory.after(state.heights, _at(u), _at(u))
        rises = jnp.min(sign * jnp.diff(state.ahead)) >= -_ROUNDING * jnp.abs(span)
        one_way = state.one_way & rises
        return _Standing(heights, u, w, target, outputs_ahead(heights), one_way)

    def seen(state: _Standing, target):
        return state.u, state.w, state.one_way

    w = output(task.m)
    before = _Standing(task.m, task.u, w, w, ahead, jnp.array(True))
    reference = task.reference
    first = after(before, reference[0])
    u, w, one_way = along_turns(after, first, reference, reference, seen)
    return u, w, jnp.all(one_way)


def _at(u: Float[Array, ""]) -> Signals:
    """An input that stands still, of which relays see nothing else."""
    return Signals(jnp.zeros_like(u), u, jnp.zeros_like(u))
