"""What a device remembers of its input alone, and inputs that turn seldom.

What is remembered of an input that goes one way does not depend on the stops it makes
on its way. So the states at the turning points, one after the other, are all that has
to wait for each other; those in between follow from the last turning point, all at
once.
"""

from abc import abstractmethod
from collections.abc import Callable, Mapping
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from .._core.compiling import largest, launched
from ..saving import Storable
from ..signals import AbstractInputPath, Grid, Signals


class AbstractMemory(Storable):
    """A state that the input decides, whatever the output does.

    It is advanced over stretches of time on which the input is monotone, exactly: it
    has no step size and no error of one. The state is any PyTree of arrays.
    """

    @abstractmethod
    def start(self, now: Signals) -> Any:
        """The state at a first time, of a device of whose past nothing is known."""

    @abstractmethod
    def after(self, m: Any, before: Signals, now: Signals) -> Any:
        """The state `now`, of the state `m` that was there `before`; the input was
        monotone in between."""

    @abstractmethod
    def values(self, m: Any, now: Signals) -> Mapping[str, Float[Array, ""]]:
        """What terms and rates may use of it, by name."""

    def kinks(self, m: Any, now: Signals) -> tuple[Array, ...]:
        """Numbers at whose zeros a state that stood still starts to move with the
        input, such as how far that is from what pulls a play; of a state that has not
        followed `now` yet."""
        return ()

    @property
    def empty(self) -> bool:
        """Whether there is nothing in it."""
        zero = jnp.zeros(())
        return not jax.tree.leaves(
            jax.eval_shape(self.start, Signals(zero, zero, zero))
        )

    @property
    def needs_past(self) -> bool:
        """Whether what the input was before a recording has a say."""
        return not self.empty

    def along(self, m: Any, grid: Grid) -> tuple[Any, Any, Any]:
        """The states at the start, the middle and the end of every step of a grid, on
        leading axes, of the state `m` at its first start."""
        return scanned(self.after, m, grid)

    def seen(
        self, see: Callable[[Any, Signals], Array], path: AbstractInputPath
    ) -> Float[Array, " n"]:
        """What is seen of it at the samples of a path: one number each, made of the
        state and the input by `see`, a PyTree."""
        return jax.vmap(see)(self.at_samples(path), path.signals())

    def at_samples(self, path: AbstractInputPath) -> Any:
        """The states at the samples of a path, on leading axes."""
        every = path.least_substeps
        return sampled(self.along(self.first(path), path.grid(every)), every)

    def first(self, path: AbstractInputPath) -> Any:
        """The state at the first sample of a path: what its past made of it, or if that
        is not known, of a device that starts there."""
        past, now = path.past, at(path.signals(), 0)
        if past is None:
            return self.start(now)
        m = self.start(at(past.signals(), 0))
        *_, ends = self.along(m, past.grid(past.least_substeps))
        return self.resumed(at(ends, -1), now)

    def resumed(self, m: Any, now: Signals) -> Any:
        """The state at the first sample of a recording, of what the input before that
        made of it: that itself, but where another state is given."""
        return m


def scanned(
    after: Callable[[Any, Signals, Signals], Any], m: Any, grid: Grid
) -> tuple[Any, Any, Any]:
    """States at the start, the middle and the end of every step, one after the other,
    of the state `m` at the first start."""

    def advance(m, step: Grid):
        middle = after(m, step.start, step.middle)
        end = after(middle, step.middle, step.end)
        return end, (m, middle, end)

    return jax.lax.scan(advance, m, grid)[1]


def sampled(steps: tuple[Any, Any, Any], every: int) -> Any:
    """Of what is known at the start, the middle and the end of every step that at the
    samples, which so many steps are between."""

    def picked(starts, ends):
        return jnp.concatenate([starts[::every], ends[-1:]])

    return jax.tree.map(picked, steps[0], steps[2])


def at(rows: Any, index: Any) -> Any:
    """One row of a PyTree of arrays, or some."""
    return jax.tree.map(lambda leaf: leaf[index], rows)


class NoMemory(AbstractMemory):
    """Of a device whose flow is all of its state."""

    @property
    def empty(self):
        return True

    def start(self, now):
        return ()

    def after(self, m, before, now):
        return ()

    def values(self, m, now):
        return {}

    def along(self, m, grid):
        return (), (), ()

    def seen(self, see, path):
        return jax.vmap(lambda now: see((), now))(path.signals())

    def first(self, path):
        return ()


class Track(eqx.Module):
    """A memory along a path, known at any time.

    **Attributes:** the `memory`; the `path`; and of each sample interval the `states`
    and `signals` at its start, and at its turning point or else its middle, shape
    (n - 1, 2, ...).
    """

    memory: AbstractMemory
    path: AbstractInputPath
    states: Any
    signals: Signals

    def __init__(self, memory: AbstractMemory, path: AbstractInputPath):
        grid = path.grid(2)
        states, _, _ = memory.along(memory.first(path), grid)
        self.memory, self.path = memory, path
        self.states, self.signals = jax.tree.map(
            lambda leaf: leaf.reshape(-1, 2, *leaf.shape[1:]), (states, grid.start)
        )

    def at(self, time: Float[Array, ""]) -> Any:
        """The state of the memory at a time, s."""
        return self.at_elapsed(time - self.path.t[0])[0]

    def at_elapsed(self, elapsed: Float[Array, ""]) -> tuple[Any, Signals]:
        """The state of the memory and the input at a time since the first sample, s: as
        exact as the input's `at_elapsed`."""
        t, first = self.path.t, self.path.t[0]
        interval = jnp.searchsorted(t - first, elapsed, side="right") - 1
        interval = jnp.clip(interval, 0, t.shape[0] - 2)
        half = (elapsed > self.signals.t[interval, 1] - first).astype(int)
        m, before = at((self.states, self.signals), (interval, half))
        now = Signals(first + elapsed, *self.path.at_elapsed(elapsed))
        return self.memory.after(m, before, now), now

    def values(self, times: Float[Array, " m"]) -> Mapping[str, Float[Array, " m"]]:
        """Its signals at several times."""
        if self.memory.empty:
            return {}

        def one(elapsed):
            return self.memory.values(*self.at_elapsed(elapsed))

        return jax.vmap(one)(times - self.path.t[0])


_SHARE = 16  # samples for each turning point from which on the short way is taken
FEW = 1000  # samples up to which a loop over all is short, and sooner compiled
_BLOCK = 500  # samples whose states a cache holds


def along_turns(
    after: Callable[[Any, Any], Any],
    first: Any,
    rows: Any,
    u: Float[Array, " n"],
    seen: Callable[[Any, Any], Any] | None = None,
    at_once: Callable[[], Any] | None = None,
) -> Any:
    """States at n samples, or what is seen of them, with leading axis n.

    A loop over turning points where they are few, and over samples where they are not;
    how many there are is counted, under `jit` too. Of what is done at turning points
    there is no derivative in reverse. Where steps of loops are launched one by one, no
    loop is run.

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
    - `at_once`: gives the states of all samples by `composed`.
    """
    if at_once is not None and launched():
        states = at_once()
        return states if seen is None else jax.vmap(seen)(states, rows)

    def one_by_one():
        def to_sample(m, row):
            m = after(m, row)
            return m, m if seen is None else seen(m, row)

        return jax.lax.scan(to_sample, first, rows)[1]

    if len(u) <= FEW:
        return one_by_one()
    most = len(u) // _SHARE
    turned = _turned(u)
    # A count for each sample is all that has to be known: a sample finds the last
    # turning point before it by its own count.
    counts = jnp.cumsum(turned, dtype=jnp.int32)
    count = largest(counts[-1])

    def by_turns():
        places = jnp.searchsorted(counts, jnp.arange(1, most + 1, dtype=jnp.int32))
        table = _at_turns(after, first, rows, places, count)
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


def _at_turns(after: Callable[[Any, Any], Any], first: Any, rows: Any, places, count):
    """The first state, and those at so many of these places, in a table that has room
    for all of them."""
    most = len(places)
    table = jax.tree.map(
        lambda leaf: jnp.zeros((most + 1, *leaf.shape), leaf.dtype).at[0].set(leaf),
        first,
    )

    def to_turn(i, carry):
        m, table = carry
        m = after(m, at(rows, places[i]))
        table = jax.tree.map(lambda all, one: all.at[i + 1].set(one), table, m)
        return m, table

    # As many steps as there are turning points, and not as many as there may be.
    return jax.lax.fori_loop(0, count, to_turn, (first, table))[1]


def composed(both: Callable[[Any, Any], Any], maps: Any) -> Any:
    """What the first sample does to a state, what the first two do to it, and so on to
    all n of them.

    Twice as many are put together in each of log n rounds, all at once: more work than
    that of a loop over samples, and a thousandth of its steps.

    **Arguments:**

    - `both`: what two do one after the other, of what each does, with leading axis n.
    - `maps`: what each does to a state, a PyTree of arrays with leading axis n.

    **Source:** Hillis and Steele (1986), doi 10.1145/7902.7903.
    """
    n = len(jax.tree.leaves(maps)[0])

    def twice(round_, maps):
        reach = jnp.left_shift(1, round_)
        before = jax.tree.map(lambda leaf: jnp.roll(leaf, reach, axis=0), maps)

        def where_any_is_before(one, other):
            there = jnp.arange(n).reshape(-1, *[1] * (other.ndim - 1)) >= reach
            return jnp.where(there, one, other)

        return jax.tree.map(where_any_is_before, both(before, maps), maps)

    return jax.lax.fori_loop(0, (n - 1).bit_length(), twice, maps)


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
