"""The inverse of plays in parallel: plays in parallel again."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._core.checks import is_concrete
from ..library import Plays
from ..library._operators import Play, Stop
from ..models import AbstractModel
from ..signals import Linear, Signals

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
