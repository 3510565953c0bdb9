"""Congruency: minor loops between the same inputs have the same shape."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from .._jit import jit
from ..models import AbstractModel
from ._drive import MINOR, Drive, run

_LOW, _HIGH = MINOR


@jit
def incongruency(model: AbstractModel, drive: Drive) -> Float[Array, ""]:
    """How much minor loops over the middle half of the input's range differ in shape.

    Congruent loops are equal up to a shift of the output: 0. One loop is entered from
    the rising branch of the settled major loop, the other from its falling branch. Each
    is taken after ONE cycle between the minor loop's ends; in a model that forgets,
    such as a Duhem law, the difference shrinks with further cycles.

    **Arguments:** any `model`; the `drive`.

    **Returns:** the largest distance between the two loops, each less its mean, over
    the range of the output in the first.

    **Source:** Mayergoyz (2003), Mathematical Models of Hysteresis and Their
    Applications, ISBN 978-0-12-480873-7.
    """
    from_below = run(model, drive, _HIGH, *(_LOW, _HIGH) * 2).w[-2:]
    from_above = run(model, drive, 1.0, _LOW, *(_HIGH, _LOW) * 2).w[-2:]
    one, other = _shape(from_below), _shape(from_above[::-1])
    return jnp.max(jnp.abs(one - other)) / jnp.ptp(one)


def _shape(w):
    return w - jnp.mean(w)
