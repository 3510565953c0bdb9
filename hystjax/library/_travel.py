"""The input over one step, as a cubic of time, and signals that travel along with it.

Where an input goes one way, a play of it rests, then goes along with it, and then rests
again; and so does a play or a stop of such a signal. That is why a signal behind others
is exact too.
"""

from collections.abc import Iterator
from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from ..signals import Signals


def cubic(before: Signals, now: Signals, h):
    """Coefficients, lowest power first, of the input over a step as a cubic of the
    share of the step: the one of its values and derivatives at both ends."""
    rise, first, last = now.u - before.u, h * before.du, h * now.du
    return (
        before.u,
        first,
        3 * rise - 2 * first - last,
        first + last - 2 * rise,
    )


def within(before: Signals, now: Signals, share: ArrayLike) -> Signals:
    """The input at a share of a step, as that cubic."""
    h = now.t - before.t
    a, b, c, d = cubic(before, now, h)
    slope = b + share * (2 * c + share * 3 * d)
    return Signals(
        before.t + share * h,
        a + share * (b + share * (c + share * d)),
        jnp.where(h > 0, slope / jnp.where(h > 0, h, 1.0), before.du),
    )


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


_STEPS = 5  # of Newton's method, from where a straight line would be; of a cubic


def _when(before: Signals, now: Signals, change: Float[Array, "*s"]) -> Signals:
    """The input where it has changed by so much: at once where it is straight, and by
    Newton's method where it is a cubic of time."""
    h, rise = now.t - before.t, now.u - before.u
    moves = rise != 0
    _, first, bend, curl = cubic(before, now, h)
    share = jnp.where(moves, change / jnp.where(moves, rise, 1.0), 0.0)
    straight = share
    for _ in range(_STEPS):
        gone = share * (first + share * (bend + share * curl))
        slope = first + share * (2 * bend + share * 3 * curl)
        # The slope has the sign of the rise but at a turn, where a step would be long.
        steep = jnp.where(jnp.abs(slope) > 1e-3 * jnp.abs(rise), slope, rise)
        step = jnp.where(moves, (gone - change) / jnp.where(moves, steep, 1.0), 0.0)
        share = jnp.clip(share - step, 0.0, 1.0)
    share = jnp.where(jnp.isfinite(share), share, straight)
    slope = first + share * (2 * bend + share * 3 * curl)
    unit = jnp.where(h > 0, h, 1.0)
    return Signals(before.t + share * h, before.u + change, slope / unit)
