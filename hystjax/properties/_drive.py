"""What a model is driven by: straight lines between turning points."""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from .. import _checks
from .._errors import InputError
from .._recording import Recording
from ..interpolation import Grid, Signals
from ..library import at
from ..models import AbstractModel
from ..models._numbers import number
from ..simulation import from_start, march, outputs, stepped


class Drive(eqx.Module):
    """An input that goes up and down between two values at one speed.

    **Attributes:**

    - `low`, `high`: ends of the input's range, input units.
    - `rate`: its speed, input units/s, positive.
    - `w0`: output at the start, where the input is `low`; output units, 0 by default.
    - `cycles`: how many precede what is looked at, so that the model settles; from 1.
    - `steps`: Runge-Kutta steps of fourth order on each straight line; an even number.
    """

    low: Float[Array, ""] = eqx.field(converter=number)
    high: Float[Array, ""] = eqx.field(converter=number)
    rate: Float[Array, ""] = eqx.field(converter=number)
    w0: Float[Array, ""] = eqx.field(converter=number, default=0.0)
    cycles: int = eqx.field(static=True, default=20)
    steps: int = eqx.field(static=True, default=400)

    def __check_init__(self):
        _checks.positive("rate", self.rate)
        _checks.positive("cycles", self.cycles)
        known = _checks.is_concrete(self.low, self.high)
        if known and not self.low < self.high:
            raise InputError(
                f"`low` must lie below `high`, got {self.low} and {self.high}."
            )
        if self.steps < 2 or self.steps % 2:
            raise InputError(
                f"`steps` must be even, for Simpson's rule, got {self.steps}."
            )

    @classmethod
    def like(cls, recording: Recording, **fields: int) -> "Drive":
        """Over the input range of a recording, at its mean speed, from its output where
        the input is lowest; `fields` are `cycles` and `steps`."""
        t, u = recording.t, recording.u
        rate = recording.path.variation()[-1] / (t[-1] - t[0])
        return cls(jnp.min(u), jnp.max(u), rate, recording.w[jnp.argmin(u)], **fields)

    def shrunk(self, share: Float[ArrayLike, ""]) -> "Drive":
        """Over a share of the range, about the same middle."""
        middle, half = (self.low + self.high) / 2, (self.high - self.low) / 2
        ends = middle - share * half, middle + share * half
        return eqx.tree_at(lambda drive: (drive.low, drive.high), self, ends)


MINOR = (0.25, 0.75)
"""Between which shares of the range minor loops and excursions lie."""


class Run(NamedTuple):
    """Inputs and outputs along straight lines, each with both of its ends.

    **Attributes:** `u` and `w`, shape (lines, steps + 1). The first two lines are the
    last of the drive's cycles, up and down; the others follow from there.
    """

    u: Float[Array, "lines n"]
    w: Float[Array, "lines n"]

    @property
    def range(self) -> Float[Array, ""]:
        """Largest less smallest output of that cycle, output units."""
        return jnp.ptp(self.w[:2])


def run(
    model: AbstractModel, drive: Drive, *turns: float, speed: ArrayLike = 1.0
) -> Run:
    """Drive a model through the drive's cycles and then through further turning points.

    **Arguments:**

    - `model`: any.
    - `drive`: the input.
    - `turns`: where the input turns after the cycles, which end at its lowest value: 0
        there, 1 at its highest.
    - `speed`: as a multiple of the drive's.

    **Returns:** a `Run`; not finite from where the model diverges.
    """
    shares = jnp.array([*(0.0, 1.0) * drive.cycles, 0.0, *turns])
    ends = drive.low + shares * (drive.high - drive.low)
    fractions = jnp.linspace(0, 1, drive.steps + 1)
    u = ends[:-1, None] + fractions * jnp.diff(ends)[:, None]
    w = _outputs(model, u, drive.rate * speed, drive.w0)
    return Run(u[-len(turns) - 2 :], w[-len(turns) - 2 :])


def _outputs(model, u, rate, w0):
    """Outputs at the inputs of every line, shape (lines, steps + 1)."""
    lines, points = u.shape
    start, end = u[:, :-1].ravel(), u[:, 1:].ravel()
    steps = jnp.abs(end - start) / rate
    du = jnp.sign(end - start) * rate
    t = from_start(jnp.zeros(()), jnp.cumsum(steps))
    stages = (t[:-1], start), (t[:-1] + steps / 2, (start + end) / 2), (t[1:], end)
    grid = Grid(steps, *(Signals(time, value, du) for time, value in stages))
    first = at(grid.start, 0)
    m = model.memory.start(first)
    memory = model.memory.along(m, grid)
    x = march(stepped, model, model.start(m, first, w0), (memory, grid))
    w = outputs(model, x, from_start(m, memory[2]), from_start(first, grid.end))
    later = w[1:].reshape(lines, points - 1)
    before = jnp.concatenate([w[:1], later[:-1, -1]])
    return jnp.concatenate([before[:, None], later], axis=1)
