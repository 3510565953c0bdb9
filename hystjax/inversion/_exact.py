"""Inverses that are known: that of plays in parallel, which is plays in parallel
again; and that of relays that stand as a staircase, of which the input has to come
to a level."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from .._core.checks import is_concrete
from ..library import Plays, Staircase
from ..library._memory import along_turns
from ..library._operators import Play, Stop
from ..models import AbstractModel
from ..signals import Linear, Signals
from ._follow import Task

_NOTHING = 1e-12  # of the steepest slope


class Stack(NamedTuple):
    """w = offset + sum of weights[i] play(u, radii[i]).

    **Attributes:** radii, rising from 0; `slopes`, sums of the weights up to each: of a
    first loading, and of every branch after a turn; and the offset. Of NumPy, until
    they are part of a program.
    """

    radii: Any
    slopes: Any
    offset: Any

    @property
    def margin(self) -> float:
        """The least slope, negative if not all have one sign; 0 for rounding of 0."""
        least = float(np.min(np.sign(self.slopes[0]) * self.slopes))
        return 0.0 if abs(least) < _NOTHING * np.max(np.abs(self.slopes)) else least


def stack_of(model: AbstractModel) -> Stack | None:
    """The model as plays in parallel, where it says that it is: a sum of the input,
    plays and stops of it, and a constant."""
    if not is_concrete(*jax.tree.leaves(model)) or model.target != "value":
        return None
    with jax.ensure_compile_time_eval():  # known numbers stay known under `jit`
        addends = model.settled().addends()
    if addends is None:
        return None
    weights: dict[float, float] = {0.0: 0.0}
    offset = 0.0
    for value, term in addends:
        (variable, power), *others = term.factors or ((None, 1),)
        if others or power != 1:
            return None
        if variable is None:
            offset += value
        elif variable.name == "u":
            weights[0.0] += value
        elif isinstance(variable, Play) and variable.of == "u":
            radius = float(variable.radius)
            if isinstance(variable, Stop):  # the input less a play
                weights[0.0] += value
                value = -value
            weights[radius] = weights.get(radius, 0.0) + value
        else:
            return None
    radii = np.array(sorted(weights))
    slopes = np.cumsum([weights[r] for r in radii])
    return Stack(radii, slopes, offset)


def unstacked(
    stack: Stack,
    plays: Float[Array, " k"],
    t: Float[Array, " n"],
    w: Float[Array, " n"],
) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
    """The inputs at which the stack has the outputs w, exactly, and its outputs there.

    A branch of the stack bends where the input has gone twice a radius from its turn;
    at that output the branch of the inverse does. Its radii so are the outputs of a
    first loading, and its slopes the inverse ones.

    **Arguments:** the stack; its plays before; and times and outputs.

    **Source:** Krejčí and Kuhnen (2001), doi 10.1049/ip-cta:20010375.
    """
    stack = jax.tree.map(lambda x: jnp.asarray(x, w.dtype), stack)
    sign, own = jnp.sign(stack.slopes[0]), jnp.diff(stack.slopes, prepend=0.0)
    loading = jnp.cumsum(jnp.abs(stack.slopes[:-1]) * jnp.diff(stack.radii))
    radii = jnp.concatenate([jnp.zeros(1, w.dtype), loading])
    weights = sign * jnp.diff(1 / jnp.abs(stack.slopes), prepend=0.0)
    # Where the inverse's plays stand: what the output would be if all plays of smaller
    # radii had come no further than this one.
    beyond = own @ plays - jnp.cumsum(own * plays)
    first = sign * (stack.slopes * plays + beyond)
    u = _run(radii, first, t, sign * (w - stack.offset)) @ (sign * weights)
    forward = _run(stack.radii, plays, t, u)
    return u, forward @ own + stack.offset


def _run(radii, before, t, u) -> Float[Array, "n k"]:
    """Plays at samples, from where they were before the first."""
    memory = Plays(radii)
    now = Signals(t[0], u[0], jnp.zeros_like(u[0]))
    m = memory.after(before, now, now)
    _, _, ends = memory.along(m, Linear().path(t, u).grid(1))
    return jnp.concatenate([m[None], ends])


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
