"""Memory of what is known only as it moves: a state, and not the input."""

from typing import Any

import jax.numpy as jnp

from ..signals import Signals
from ._memory import AbstractMemory
from ._operators import cubic, within


def followed(memory: AbstractMemory, m: Any, before: Signals, now: Signals) -> Any:
    """The state of a memory `now`, of the state `m` that was there `before`, where what
    drives it has gone in between as the cubic of its values and rates at both ends. It
    may have turned, once."""
    turn = _turn(before, now)
    return memory.after(memory.after(m, before, turn), turn, now)


def _turn(before: Signals, now: Signals) -> Signals:
    """Where it turns; at the end if it does not."""
    _, first, bend, curl = cubic(before, now, now.t - before.t)
    # Of other signs at the ends, its rate has one zero in between.
    turns = before.du * now.du < 0
    root = jnp.sqrt(jnp.where(turns, bend**2 - 3 * first * curl, 1.0))
    below = jnp.where(turns, jnp.sign(first) * root - bend, 1.0)
    return within(before, now, jnp.where(turns, first / below, 1.0))
