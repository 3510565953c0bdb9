"""Dissipation: the area of the loop."""

from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._jit import jit
from ..models import AbstractModel
from ._drive import Drive, run


class Dissipation(NamedTuple):
    """Work of cycles at a amplitudes and s speeds.

    **Attributes:** each of shape (a, s).

    - `work`: the integral of w du over the cycle, input times output units.
    - `share`: the work as a share of the rectangle about the loop.
    - `closure`: how far the output is from where the cycle began, over its range:
        work is that of a steady loop where this is almost 0.
    """

    work: Float[Array, "a s"]
    share: Float[Array, "a s"]
    closure: Float[Array, "a s"]


@jit
def dissipation(
    model: AbstractModel,
    drive: Drive,
    amplitudes: Sequence[float] = (0.25, 0.5, 1.0),
    speeds: Sequence[float] = (1.0,),
) -> Dissipation:
    """The integral of w du over the drive's last cycle.

    Positive where the output is higher while the input rises (a clockwise loop, a force
    over a position: work done on the device); negative where the output lags behind the
    input (a displacement over a voltage, an induction over a field: there the work done
    on the device is the integral of u dw, which over a closed loop is minus this).

    **Arguments:**

    - `model`: any.
    - `drive`: the input.
    - `amplitudes`: shares of the drive's range, about its middle.
    - `speeds`: multiples of the drive's.

    **Returns:** a `Dissipation`.

    **Source:** Brokate and Sprekels (1996), Hysteresis and Phase Transitions, doi
    10.1007/978-1-4612-4048-8.
    """

    def cycle(amplitude, speed):
        return _cycle(run(model, drive.shrunk(amplitude), speed=speed))

    every = jax.vmap(jax.vmap(cycle, in_axes=(None, 0)), in_axes=(0, None))
    return every(jnp.array(amplitudes), jnp.array(speeds))


def _cycle(loop):
    work = jnp.sum(_simpson(loop.u, loop.w))
    closure = jnp.abs(loop.w[1, -1] - loop.w[0, 0]) / loop.range
    return Dissipation(work, work / (jnp.ptp(loop.u) * loop.range), closure)


def _simpson(u, w):
    """Integrals of w du over each line, whose inputs are evenly spaced."""
    steps = u.shape[1] - 1
    weights = np.ones(steps + 1)
    weights[1:-1:2], weights[2:-1:2] = 4, 2
    return w @ weights * (u[:, -1] - u[:, 0]) / (3 * steps)
