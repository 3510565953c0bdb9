"""Many samples, few turning points: memory along an input that turns seldom.

What is remembered of an input that goes one way does not depend on the stops it makes
on its way. So the states at the turning points, one after the other, are all that has
to wait for each other; those in between follow from the last turning point, all at
once.
"""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jax.custom_batching import custom_vmap
from jaxtyping import Array, Float, Int

_SHARE = 16  # samples for each turning point from which on the short way is taken
_FEW = 1000  # samples up to which a loop over all is short, and sooner compiled
_BLOCK = 500  # samples whose states a cache holds


def along_turns(
    after: Callable[[Any, Any], Any],
    first: Any,
    rows: Any,
    u: Float[Array, " n"],
    seen: Callable[[Any, Any], Any] | None = None,
) -> Any:
    """States at n samples, or what is seen of them, with leading axis n.

    A loop over turning points where they are few, and over samples where they are not;
    how many there are is counted, under `jit` too. Of what is done at turning points
    there is no derivative in reverse.

    **Arguments:**

    - `after`: the state at a sample, of a state before it from which on the input went
        one way, and of the sample's row. Both `after(after(m, a), b)` and `after(m, b)`
        must be the same for an input that goes from a to b one way.
    - `first`: the state at the first sample, which that sample's row does not change.
    - `rows`: what `after` needs to know of each sample, a PyTree of arrays with leading
        axis n.
    - `u`: the input, which tells where it turns.
    - `seen`: what is wanted of a state and its row, if not all of the state: the states
        of all samples then are never in memory together.
    """

    def one_by_one():
        def to_sample(m, row):
            m = after(m, row)
            return m, m if seen is None else seen(m, row)

        return jax.lax.scan(to_sample, first, rows)[1]

    if len(u) <= _FEW:
        return one_by_one()
    most = len(u) // _SHARE
    turned = _turned(u)
    # A count for each sample is all that has to be known: a sample finds the last
    # turning point before it by its own count.
    counts = jnp.cumsum(turned, dtype=jnp.int32)
    count = _largest(counts[-1])

    def by_turns():
        places = jnp.searchsorted(counts, jnp.arange(1, most + 1, dtype=jnp.int32))
        table = jax.tree.map(
            lambda leaf: jnp.zeros((most + 1, *leaf.shape), leaf.dtype).at[0].set(leaf),
            first,
        )

        def to_turn(i, carry):
            m, table = carry
            m = after(m, _row(rows, places[i]))
            table = jax.tree.map(lambda all, one: all.at[i + 1].set(one), table, m)
            return m, table

        # As many steps as there are turning points, and not as many as there may be.
        _, table = jax.lax.fori_loop(0, count, to_turn, (first, table))
        # A turning point is the end of the stretch that leads to it.
        before = counts - turned

        def filled(before, rows):
            last = jax.tree.map(
                lambda leaf: leaf.at[before].get(mode="promise_in_bounds"), table
            )
            m = jax.vmap(after)(last, rows)
            return m if seen is None else jax.vmap(seen)(m, rows)

        return filled(before, rows) if seen is None else _blocks(filled, before, rows)

    # On the way back what is kept of one branch would take its place in both.
    return jax.lax.cond(
        count <= most, jax.checkpoint(by_turns), jax.checkpoint(one_by_one)
    )


def _blocks(function: Callable, *rows: Any) -> Any:
    """A function of many rows, of some at a time."""
    n = len(jax.tree.leaves(rows)[0])
    extra = -n % _BLOCK

    def parts(leaf):
        width = ((0, extra),) + ((0, 0),) * (leaf.ndim - 1)
        return jnp.pad(leaf, width).reshape(-1, _BLOCK, *leaf.shape[1:])

    # Made again on the way back, block by block, instead of being kept.
    once = jax.checkpoint(lambda block: function(*block))
    out = jax.lax.map(once, jax.tree.map(parts, rows))
    return jax.tree.map(lambda leaf: leaf.reshape(-1, *leaf.shape[2:])[:n], out)


def _turned(u: Float[Array, " n"]) -> Int[Array, " n"]:
    """1 at samples after which the input goes another way, 0 elsewhere."""
    ways = jnp.sign(jnp.diff(u))
    # Where it has stood still it may have been on its way in either direction: the end
    # of a rest counts, its beginning need not.
    other = (ways[1:] != ways[:-1]) & (ways[1:] != 0)
    return jnp.pad(other, 1).astype(jnp.int32)


def _row(rows: Any, index: Any) -> Any:
    return jax.tree.map(lambda leaf: leaf[index], rows)


@custom_vmap
def _largest(count: Int[Array, ""]) -> Int[Array, ""]:
    """The count; of a batch the largest, one number for all of it.

    A loop whose length or a branch whose condition differs along a batch would be
    turned into one that selects between whole results at every step.
    """
    return count


@_largest.def_vmap
def _(size, batched, counts):
    return _largest(jnp.max(counts)), False
