"""Rate independence: the loop does not depend on how fast it is traversed."""

from collections.abc import Sequence

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._jit import jit
from ..models import AbstractModel
from ._drive import Drive, run


@jit
def rate_dependence(
    model: AbstractModel, drive: Drive, speeds: Sequence[float] = (0.25, 1.0, 4.0)
) -> Float[Array, ""]:
    """How far apart loops at several speeds are.

    0 for a rate independent model. A law is one when all of its terms are of degree one
    in u' and |u'| together.

    **Arguments:** any `model`; the `drive`; `speeds` as multiples of the drive's.

    **Returns:** the largest distance between outputs at equal inputs of the last
    cycles, over the range of all these outputs.

    **Source:** Visintin (1994), doi 10.1007/978-3-662-11557-2; for Duhem laws Oh and
    Bernstein (2005), doi 10.1109/TAC.2005.847035.
    """
    w = jax.vmap(lambda speed: run(model, drive, speed=speed).w)(jnp.array(speeds))
    return jnp.max(jnp.ptp(w, axis=0)) / jnp.ptp(w)
