"""How plays and stops of an input go over a stretch on which the input goes one way.

Such a signal rests, then goes along with the input, and then rests again; and so does a
play or a stop of such a signal. That is why a signal behind others is exact too.
"""

from collections.abc import Iterator
from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from ..signals import Signals

_STEPS = 5  # of Newton's method, from where a straight line would be; of a cubic


class Travel(NamedTuple):
    """A signal over one stretch.

    **Attributes:** input units, of one shape.

    - `before`, `now`: its values at the ends.
    - `wait`: by how much the input changes before the signal goes along with it.
    """

    before: Float[Array, "*s"]
    now: Float[Array, "*s"]
    wait: Float[Array, "*s"]

    @property
    def change(self) -> Float[Array, "*s"]:
        """By how much it goes along."""
        return self.now - self.before


def stretches(
    before: Signals, now: Signals, travel: Travel
) -> Iterator[tuple[Signals, Signals]]:
    """The signal as an input of its own: at rest, on its way, and at rest, each with
    both of its ends."""
    start = _when(before, now, travel.wait)
    stop = _when(before, now, travel.wait + travel.change)
    zero = jnp.zeros_like(before.u)
    yield Signals(before.t, travel.before, zero), Signals(start.t, travel.before, zero)
    yield start._replace(u=travel.before), stop._replace(u=travel.now)
    yield Signals(stop.t, travel.now, zero), Signals(now.t, travel.now, zero)


def _when(before: Signals, now: Signals, change: Float[Array, "*s"]) -> Signals:
    """The input where it has changed by so much: at once where it is straight, and by
    Newton's method where it is a cubic of time."""
    h, rise = now.t - before.t, now.u - before.u
    moves = rise != 0
    first, last = h * before.du, h * now.du
    bend = (3 * rise - 2 * first - last, first + last - 2 * rise)
    share = jnp.where(moves, change / jnp.where(moves, rise, 1.0), 0.0)
    straight = share
    for _ in range(_STEPS):
        gone = share * (first + share * (bend[0] + share * bend[1]))
        slope = first + share * (2 * bend[0] + share * 3 * bend[1])
        # The slope has the sign of the rise but at a turn, where a step would be long.
        steep = jnp.where(jnp.abs(slope) > 1e-3 * jnp.abs(rise), slope, rise)
        step = jnp.where(moves, (gone - change) / jnp.where(moves, steep, 1.0), 0.0)
        share = jnp.clip(share - step, 0.0, 1.0)
    share = jnp.where(jnp.isfinite(share), share, straight)
    slope = first + share * (2 * bend[0] + share * 3 * bend[1])
    unit = jnp.where(h > 0, h, 1.0)
    return Signals(before.t + share * h, before.u + change, slope / unit)
