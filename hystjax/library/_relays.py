"""Relays on the half-plane of their thresholds, one by one and as a staircase."""

from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Bool, Float, Int

from .._core.checks import InputError, is_concrete
from ..signals import AbstractInputPath, Signals
from ._memory import AbstractMemory, along_turns

_TIE = 1e-6  # share of the range of levels by which thresholds count as equal

INITIAL = ("demagnetised", "up", "down")


def check_initial(initial: str) -> None:
    """Raise `InputError` for a past that has no name."""
    if initial not in INITIAL:
        raise InputError(
            f"`initial` must be one of {', '.join(INITIAL)}; got {initial!r}."
        )


def _thresholds(values: ArrayLike | Sequence[ArrayLike]) -> Array:
    return jnp.asarray(values, jnp.result_type(float))


class Relays(AbstractMemory):
    """Relays: switches that the input turns up at one value and down at a lower one.

    For teaching and for tests: `models.Preisach` gives the sum of a whole half-plane of
    them for the work of its edge.

    **Attributes:**

    - `up`, `down`: thresholds, shape (k,), input units; `up` above `down`. A relay is
        up from where the input comes to `up` until it comes back to `down`.
    - `initial`: how they stand before the first input: all `"up"` or `"down"`, or
        `"demagnetised"`, those up whose thresholds have a mean below 0.

    **Source:** Preisach (1935), doi 10.1007/BF01349418.
    """

    up: Float[Array, " k"] = eqx.field(converter=_thresholds)
    down: Float[Array, " k"] = eqx.field(converter=_thresholds)
    initial: str = eqx.field(static=True, default="demagnetised")

    def __check_init__(self):
        check_initial(self.initial)
        if is_concrete(self.up, self.down) and not jnp.all(self.up > self.down):
            raise InputError(
                "each relay must turn up at a higher input than it turns down: `up` "
                "must be above `down` everywhere."
            )

    def start(self, now: Signals) -> Bool[Array, " k"]:
        stand = {
            "up": jnp.ones(self.up.shape, bool),
            "down": jnp.zeros(self.up.shape, bool),
            "demagnetised": self.up + self.down < 0,
        }
        return self.after(stand[self.initial], now, now)

    def after(self, m, before, now):
        return jnp.where(
            now.u >= self.up, True, jnp.where(now.u <= self.down, False, m)
        )

    def values(self, m, now):
        return {f"relay {i}": jnp.where(up, 1.0, -1.0) for i, up in enumerate(m)}


class Staircase(AbstractMemory):
    """What all relays of a grid of thresholds remember: the edge between those that are
    up and those that are down, as one height for each column.

    The relay (i, j), i >= j, turns up at `levels[i + 1]` and down at `levels[j]`. Of a
    column j those up to some i are up, and no others: as many as the highest input
    since it was last at `levels[j]` or below has come to.

    **Attributes:**

    - `levels`: thresholds, shape (L + 1,), input units, rising.
    - `initial`: how relays stand before the first input: all `"up"` or `"down"`, or
        `"demagnetised"`, those up whose thresholds have a mean below that of the first
        and the last level.

    **Source:** Mayergoyz (1991), doi 10.1007/978-1-4612-3028-1.
    """

    levels: Float[Array, " n"]
    initial: str = eqx.field(static=True)

    @property
    def empty(self):
        return False

    def start(self, now: Signals) -> Int[Array, " L"]:
        """Heights: how many of the levels after the first are below them."""
        columns, up = self.levels[:-1], self.levels[1:]
        centre = (self.levels[0] + self.levels[-1]) / 2
        # Relays whose mean is that of the levels stand down, whatever the rounding.
        edge = 2 * centre - columns - _TIE * (self.levels[-1] - self.levels[0])
        stand = {
            "up": jnp.full(columns.shape, len(up)),
            "down": jnp.zeros(columns.shape, int),
            "demagnetised": jnp.searchsorted(up, edge, side="right"),
        }
        heights = stand[self.initial].astype(jnp.int32)
        return self.after(heights, now, now)

    def after(self, m, before, now):
        reached = jnp.searchsorted(self.levels[1:], now.u, side="right")
        heights = jnp.maximum(m, reached.astype(m.dtype))
        return jnp.where(now.u <= self.levels[:-1], 0, heights)

    def values(self, m, now):
        return {f"height {j}": height.astype(float) for j, height in enumerate(m)}

    def along(self, m, grid):
        # Heights are numbers of levels, which have no derivatives.
        u = jnp.concatenate([grid.start.u[:1], grid.end.u])
        nodes = self._along(m, u)
        middles = jax.vmap(self.after)(nodes[:-1], grid.start, grid.middle)
        return nodes[:-1], middles, nodes[1:]

    def _along(self, m: Int[Array, " L"], u: Float[Array, " n"]) -> Int[Array, "n L"]:
        memory, u = jax.lax.stop_gradient((self, u))

        def after(m, u):
            now = Signals(u, u, u)  # of which it looks at the input
            return memory.after(m, now, now)

        return along_turns(after, m, u, u)

    def seen(self, see: Any, path: AbstractInputPath) -> Float[Array, " n"]:
        if not path.kinked:
            return super().seen(see, path)
        memory = jax.lax.stop_gradient(self)
        now = path.signals()

        def after(m, row):
            return memory.after(m, row, jax.lax.stop_gradient(row))

        return along_turns(after, self.first(path), now, now.u, see)
