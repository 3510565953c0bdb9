"""Plays along a whole input, and their derivative.

Where an input goes one way, a play of it rests, then goes along with it, and then rests
again; and so does a play or a stop of such a signal. That is why a signal behind others
is exact too.
"""

from collections.abc import Iterator
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Shaped

from .._core.checks import InputError
from ..signals import Signals
from ._memory import AbstractMemory, along_turns
from ._weighted import Stack, Weighted, pulled, weighted

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


def plays(
    u: Float[Array, " n"], radii: Float[Array, " k"], first: Float[Array, " k"]
) -> Float[Array, "n k"]:
    """Plays of n inputs, between which they go one way.

    **Arguments:** the inputs; the radii; and the plays at the first input.

    **Returns:** bit for bit what a loop over the samples gives, see `along_turns`. Its
    derivatives in all arguments are exact, in both directions.
    """
    return enveloped(u, (u, u), radii, first)


@eqx.filter_custom_jvp
def enveloped(
    u: Float[Array, " n"],
    envelopes: tuple[Float[Array, "n *_k"], Float[Array, "n *_k"]],
    radii: Float[Array, " k"],
    first: Float[Array, " k"],
) -> Float[Array, "n k"]:
    """Plays between two functions of the input.

    **Arguments:** the inputs; what pulls plays up and what pulls them down there, both
    rising with the input, for all plays or for each; the radii; and the plays at the
    first input.
    """

    def after(p, row):
        rising, falling = row
        return pulled(p, rising - radii, falling + radii)

    return along_turns(after, first, envelopes, u)


@enveloped.def_jvp
def _(primals, tangents):
    u, envelopes, radii, first = primals
    _, d_envelopes, d_radii, d_first = tangents
    last = _last_pulls(*jax.lax.stop_gradient(primals))
    # Not together with what pulled: XLA would fuse two results into one slow loop.
    p = enveloped(u, envelopes, radii, first)
    return p, _change(last, d_envelopes, d_radii, d_first)


@eqx.filter_custom_jvp
def summed(
    see: Any,
    u: Float[Array, " n"],
    envelopes: tuple[Float[Array, " n"], Float[Array, " n"]],
    radii: Float[Array, " k"],
    first: Float[Array, " k"],
    rows: Any,
) -> Float[Array, " n"]:
    """A number made of the plays at each sample, which are never in memory together.

    **Arguments:** `see(p, row)`, a PyTree whose arrays may have derivatives, that makes
    the number; inputs, envelopes, radii and first plays as for `enveloped`; and what
    else `see` needs of each sample, a PyTree of arrays with leading axis n.
    """
    if isinstance(see, Weighted):
        return see.offset + weighted(Stack(first, radii, see.weights), u, envelopes)

    def after(p, row):
        rising, falling = row[0]
        return pulled(p, rising - radii, falling + radii)

    def seen(p, row):
        return see(p, row[1])

    return along_turns(after, first, (envelopes, rows), u, seen)


@summed.def_jvp
def _(primals, tangents):
    see, u, envelopes, radii, first, rows = primals
    d_see, _, d_envelopes, d_radii, d_first, d_rows = tangents
    w = summed(*primals)
    u, envelopes, radii, first = _still((u, envelopes, radii, first))

    def change(d_see, d_envelopes, d_radii, d_first, d_rows):
        def seen(m, row):
            p, last = m
            here, d_here = row[1:]
            d_p = _change(last, d_envelopes, d_radii, d_first)
            moved = eqx.filter_jvp(
                lambda see, p, row: see(p, row), (see, p, here), (d_see, d_p, d_here)
            )
            return moved[1]

        after, start, marked = _marking(u, envelopes, radii, first)
        return along_turns(after, start, (marked, rows, d_rows), u, seen)

    return w, change(d_see, d_envelopes, d_radii, d_first, d_rows)


def _last_pulls(u, envelopes, radii, first) -> Shaped[Array, "n k"]:
    """Which sample, counted from 1, has last pulled each play: positive where down,
    negative where up, 0 where none has."""
    after, start, marked = _marking(u, envelopes, radii, first)
    return along_turns(after, start, (marked,), u, lambda m, row: m[1])


def _marking(u, envelopes, radii, first):
    """What `along_turns` needs for plays and their last pulls."""

    def after(m, row):
        p, last = m
        rising, falling, number = row[0]
        low, high = rising - radii, falling + radii
        last = jnp.where(p < low, -number, jnp.where(p > high, number, last))
        return pulled(p, low, high), last

    numbers = jnp.arange(1, len(u) + 1, dtype=jnp.int32)
    start = first, jnp.zeros(first.shape, jnp.int32)
    return after, start, (*envelopes, numbers)


def _change(last: Shaped[Array, "*n k"], d_envelopes, d_radii, d_first):
    """What becomes of plays that these samples have pulled last, where `None` stands
    for no change.

    A play is what it was when it was last pulled: an edge at that sample, so that it
    changes with the radius by -1, 1, or if it has never been pulled not at all.
    """
    change = []
    if d_radii is not None:
        change.append(jnp.sign(last).astype(d_radii.dtype) * d_radii)
    if d_first is not None:
        change.append(jnp.where(last == 0, d_first, 0.0))
    for side, moved in zip((-1, 1), d_envelopes, strict=True):
        if moved is not None:
            # One envelope for all plays, or one for each.
            own = () if moved.ndim == 1 else (jnp.arange(moved.shape[1]),)
            at_pull = moved[(jnp.abs(last) - 1, *own)]
            change.append(jnp.where(side * last > 0, at_pull, 0.0))
    return sum(change[1:], change[0]) if change else None


@jax.custom_jvp
def _still(numbers: Any) -> Any:
    """Numbers that a first derivative takes for constants."""
    return numbers


@_still.defjvp
def _(primals, tangents):
    raise InputError(
        "simulated plays have first derivatives only; take second ones of "
        "`model.memory.along`, which keeps what they need."
    )


class Plays(AbstractMemory):
    """Plays as one array: exact, and fast where the input turns seldom.

    **Attributes:**

    - `radii`: shape (k,), input units, or those of the envelopes.
    - `rising`, `falling`: what pulls them up, and down: functions of the input that
        rise with it, `rising` nowhere above `falling`; the input itself by default.

    Plays start from 0, or as close to 0 as the first input lets them.
    """

    radii: Float[Array, " k"]
    rising: Any = None
    falling: Any = None

    @property
    def empty(self):
        return False

    def start(self, now):
        return self.after(jnp.zeros_like(self.radii), now, now)

    def after(self, m, before, now):
        low, high = self._envelopes(now.u)
        return pulled(m, low - self.radii, high + self.radii)

    def values(self, m, now):
        return {f"play {i}": each for i, each in enumerate(m)}

    def kinks(self, m, now):
        low, high = self._envelopes(now.u)
        return *(low - self.radii - m), *(high + self.radii - m)

    def along(self, m, grid):
        u = jnp.concatenate([grid.start.u[:1], grid.end.u])
        nodes = enveloped(u, self._envelopes(u), self.radii, m)
        middles = jax.vmap(self.after)(nodes[:-1], grid.start, grid.middle)
        return nodes[:-1], middles, nodes[1:]

    def seen(self, see, path):
        if not path.kinked:
            return super().seen(see, path)
        now = path.signals()
        envelopes = self._envelopes(now.u)
        return summed(see, now.u, envelopes, self.radii, self.first(path), now)

    def _envelopes(self, u):
        rising, falling = self.rising, self.falling
        return (
            u if rising is None else rising(u),
            u if falling is None else falling(u),
        )
