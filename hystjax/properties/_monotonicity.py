"""Piecewise monotonicity: the output rises with the input, and falls with it."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from .._jit import jit
from ..models import AbstractModel
from ._drive import Drive, run


class Steepness(NamedTuple):
    """Smallest dw/du on the branches of a loop, over the loop's mean steepness, which
    is its range in w over its range in u.

    **Attributes:** `rising`, `falling`: scalars; a model is piecewise monotone on this
    loop where neither is negative.
    """

    rising: Float[Array, ""]
    falling: Float[Array, ""]


@jit
def steepness(model: AbstractModel, drive: Drive) -> Steepness:
    """Where the loop is least steep.

    **Arguments:** any `model`; the `drive`, to whose steps steepness refers.

    **Returns:** a `Steepness`.

    **Source:** Visintin (1994), doi 10.1007/978-3-662-11557-2.
    """
    loop = run(model, drive)
    slopes = jnp.diff(loop.w) / jnp.diff(loop.u)
    rising, falling = jnp.min(slopes, axis=1) * (drive.high - drive.low) / loop.range
    return Steepness(rising, falling)
