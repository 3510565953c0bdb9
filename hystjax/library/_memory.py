"""What a device remembers of its input alone."""

from abc import abstractmethod
from collections.abc import Callable, Mapping
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

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
        every = path.least_substeps
        starts, _, ends = self.along(self.first(path), path.grid(every))
        states = jax.tree.map(
            lambda a, b: jnp.concatenate([a[::every], b[-1:]]), starts, ends
        )
        return jax.vmap(see)(states, path.signals())

    def first(self, path: AbstractInputPath) -> Any:
        """The state at the first sample of a path: what its past made of it, or if that
        is not known, of a device that starts there."""
        past = path.past
        if past is None:
            return self.start(at(path.signals(), 0))
        m = self.start(at(past.signals(), 0))
        *_, ends = self.along(m, past.grid(past.least_substeps))
        return at(ends, -1)


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


def at(rows: Any, index: Any) -> Any:
    """One row of a PyTree of arrays."""
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
        t = self.path.t
        interval = jnp.searchsorted(t, time, side="right") - 1
        interval = jnp.clip(interval, 0, t.shape[0] - 2)
        half = (time > self.signals.t[interval, 1]).astype(int)
        m, before = at((self.states, self.signals), (interval, half))
        return self.memory.after(m, before, Signals(time, *self.path.at(time)))

    def values(self, times: Float[Array, " m"]) -> Mapping[str, Float[Array, " m"]]:
        """Its signals at several times."""
        if self.memory.empty:
            return {}

        def one(time):
            return self.memory.values(self.at(time), Signals(time, *self.path.at(time)))

        return jax.vmap(one)(times)
