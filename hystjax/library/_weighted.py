"""Weighted sums of plays along a whole input, by few operations a sample and play.

Samples are taken in blocks. Where the input turns at most once inside of each, a block
has two pieces over which the input goes one way: a loop over blocks finds the plays
where pieces begin, and the sums at all samples follow from these at once. Where it
turns more often, a loop over samples does it.
"""

from functools import partial
from math import prod
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.custom_batching import custom_vmap
from jaxtyping import Array, Bool, Float, Int

from ..signals import Signals
from ._memory import largest

_BLOCK = 32  # samples, for each of which there is a bit
_FEW = 1000  # samples up to which a loop over all is short, and sooner compiled
_GROUP = 8  # plays: XLA makes one kernel of a loop that moves less than a kilobyte
_GROUPS = 4  # whose part is added in one go


class Weighted(eqx.Module):
    """What is seen of plays where it is no more than their sum.

    **Attributes:** `weights`, shape (k,), of the plays; and `offset`, a scalar.
    """

    weights: Float[Array, " k"]
    offset: Float[Array, ""]

    def __call__(self, m: Float[Array, " k"], now: Signals) -> Float[Array, ""]:
        return self.offset + self.weights @ m


class Stack(NamedTuple):
    """Plays side by side, of shape (k,) each, or in groups, (..., 8)."""

    first: Float[Array, "*k"]
    radii: Float[Array, "*k"]
    weights: Float[Array, "*k"]


class _Ends(NamedTuple):
    """Where pieces end, one for each block: what pulls plays up and down there, and
    which way the input has gone, 1 up or -1 down."""

    rising: Float[Array, " b"]
    falling: Float[Array, " b"]
    way: Float[Array, " b"]


def pulled(
    p: Float[Array, " k"], low: Float[Array, " k"], high: Float[Array, " k"]
) -> Float[Array, " k"]:
    """Plays `p` after their edges have moved to `low` and `high`."""
    # Not `clip`, whose derivative is a mean of both sides where they meet, which at
    # radius 0 is always: the side that pulls tells the change with the radius.
    p = jnp.where(p > high, high, p)
    return jnp.where(p < low, low, p)


def weighted(
    stack: Stack,
    u: Float[Array, " n"],
    envelopes: tuple[Float[Array, " n"], Float[Array, " n"]],
) -> Float[Array, " n"]:
    """The weighted sum of plays at n inputs, between which they go one way.

    **Arguments:** the plays, at the first input; the inputs; and what pulls plays up
    and what pulls them down there.

    **Returns:** what a loop over the samples gives, but for rounding. It has no
    derivatives of its own.
    """
    if len(u) <= _FEW:
        return _looped(stack, *envelopes)
    inputs, rising, falling = (_blocks(x) for x in (u, *envelopes))
    before = jnp.concatenate([inputs[:1, 0], inputs[:-1, -1]])
    turn, once = _turns(inputs, before)

    at_turn = (jnp.arange(len(turn)), turn)
    first = jnp.where(inputs[at_turn] < before, -1.0, 1.0).astype(u.dtype)
    last = jnp.where(inputs[:, -1] < inputs[at_turn], -1.0, 1.0).astype(u.dtype)
    ends = (
        _Ends(rising[at_turn], falling[at_turn], first),
        _Ends(rising[:, -1], falling[:, -1], last),
    )
    later = jnp.arange(_BLOCK) > turn[:, None]
    way = jnp.where(later, last[:, None], first[:, None])
    edge = jnp.where(way > 0, rising, -falling)

    def by_pieces():
        return way * _summed(stack, ends, later, edge)

    def one_by_one():
        return _blocks(_looped(stack, *envelopes))

    several = largest(jnp.sum(~once, dtype=jnp.int32))
    sums = jax.lax.cond(several == 0, by_pieces, one_by_one)
    return sums.reshape(-1)[: len(u)]


def _turns(
    inputs: Float[Array, "b s"], before: Float[Array, " b"]
) -> tuple[Int[Array, " b"], Bool[Array, " b"]]:
    """The sample of each block at which its first piece may end, and whether there are
    no more than two; of inputs in blocks, and of those before each block."""
    change = inputs - jnp.concatenate([before[:, None], inputs[:, :-1]], axis=1)
    # All that has to be known of a block are two numbers: bits where the input rises,
    # and bits where it falls.
    none = jnp.uint32(0)
    bits = jnp.left_shift(jnp.uint32(1), jnp.arange(_BLOCK, dtype=jnp.uint32))
    rises, falls = (
        jnp.sum(jnp.where(moves, bits, none), axis=1, dtype=jnp.uint32)
        for moves in (change > 0, change < 0)
    )

    def comes_first(one, other):
        lowest = other & (~other + 1)
        return (other == 0) | (one < lowest)

    peak, valley = comes_first(rises, falls), comes_first(falls, rises)
    highest = 31 - jax.lax.clz(jnp.where(peak, rises, falls)).astype(jnp.int32)
    return jnp.maximum(highest, 0), peak | valley


def _summed(
    stack: Stack,
    ends: tuple[_Ends, _Ends],
    later: Bool[Array, "b s"],
    edge: Float[Array, "b s"],
) -> Float[Array, "b s"]:
    """Weighted sums of plays at the samples of blocks, times the way that the input
    goes, of the edges that pull plays that way, times the way.

    Times its way, a play is the larger of what it was at the end of the piece before
    and of its edge, less its radius: two operations and a product.
    """

    def held(group: Stack):
        """Plays where the pieces of each block begin, times their way and with their
        radii."""
        r = group.radii

        def over(p, ends: tuple[_Ends, _Ends]):
            before = []
            for end in ends:
                before.append(end.way * p + r)
                p = pulled(p, end.rising - r, end.falling + r)
            return p, before

        return jax.lax.scan(over, group.first, ends)[1]

    def add(total, groups: Stack):
        first, second = jax.lax.map(held, groups)
        for i, weights in enumerate(groups.weights):
            for j, weight in enumerate(weights):
                p = jnp.where(later, second[i, :, j, None], first[i, :, j, None])
                # Not `maximum`, which looks for NaN and takes twice as long.
                total += weight * jnp.where(p > edge, p, edge)
        return total, None

    total = jnp.full_like(edge, -stack.radii @ stack.weights)
    return jax.lax.scan(add, total, _grouped(stack, _GROUPS, _GROUP))[0]


@custom_vmap
def _looped(
    stack: Stack, rising: Float[Array, " n"], falling: Float[Array, " n"]
) -> Float[Array, " n"]:
    """Weighted sums of plays, sample after sample."""
    return _looped_by(_GROUP, stack, rising, falling)


@_looped.def_vmap
def _(size, batched, *rows):
    # XLA makes no kernels of loops over batches, and all plays at once are fewer steps.
    plays = rows[0].radii.shape[-1]
    axes = jax.tree.map(lambda along: 0 if along else None, tuple(batched))
    return jax.vmap(partial(_looped_by, plays), axes)(*rows), True


def _looped_by(size: int, stack: Stack, rising, falling) -> Float[Array, " n"]:
    def add(total, group: Stack):
        def to_sample(p, edges):
            low, high = edges
            p = pulled(p, low - group.radii, high + group.radii)
            return p, jnp.sum(group.weights * p)

        sums = jax.lax.scan(to_sample, group.first, (rising, falling))[1]
        return total + sums, None

    return jax.lax.scan(add, jnp.zeros_like(rising), _grouped(stack, size))[0]


def _blocks(x: Float[Array, " n"]) -> Float[Array, "b s"]:
    """Samples in blocks, the last of which rests at its end."""
    return jnp.pad(x, (0, -len(x) % _BLOCK), mode="edge").reshape(-1, _BLOCK)


def _grouped(stack: Stack, *shape: int) -> Stack:
    """Plays in groups, and some of no weight to fill the last."""
    extra = -len(stack.radii) % prod(shape)
    return Stack(*(jnp.pad(x, (0, extra)).reshape(-1, *shape) for x in stack))
