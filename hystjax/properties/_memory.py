"""Return-point memory: a minor excursion leaves no trace."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from .._jit import jit
from ..models import AbstractModel
from ._drive import MINOR, Drive, run

_LOW, _HIGH = MINOR


@jit
def memory_loss(model: AbstractModel, drive: Drive) -> Float[Array, ""]:
    """How far from its return point a minor excursion ends.

    From the settled major loop the input turns back over the middle half of its range,
    and then comes to the turning point again: once from the rising branch, once from
    the falling. With return-point memory (wiping-out) the output is there what it was:
    0.

    **Arguments:** any `model`; the `drive`.

    **Returns:** the larger of the two distances, over the range of the output in the
    major loop.

    **Source:** Mayergoyz (2003), Mathematical Models of Hysteresis and Their
    Applications, ISBN 978-0-12-480873-7.
    """
    rising = run(model, drive, _HIGH, _LOW, _HIGH)
    falling = run(model, drive, 1.0, _LOW, _HIGH, _LOW)
    gaps = [each.w[-1, -1] - each.w[-2, 0] for each in (rising, falling)]
    return jnp.max(jnp.abs(jnp.stack(gaps))) / rising.range
