"""What classical models share: how their numbers are taken, and the Bouc-Wen knee."""

import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from .. import _checks


def number(value: ArrayLike) -> Array:
    """A parameter as an array of floats."""
    value = jnp.asarray(value)
    return value.astype(jnp.result_type(float, value))


def exponent(n: ArrayLike) -> Array:
    """The exponent of a knee, which must be positive."""
    n = number(n)
    _checks.positive("n", n)
    return n


def knee(
    z: Float[Array, "*s"],
    dx: Float[Array, "*s"],
    beta: Float[Array, ""],
    gamma: Float[Array, ""],
    n: Float[Array, ""],
) -> Float[Array, "*s"]:
    """What bends the loop of a Bouc-Wen law: beta |dx| z |z|^(n-1) + gamma dx |z|^n."""
    # |z|^n with a derivative at 0: the logarithm must not see the zero.
    moved = z != 0
    size = jnp.where(moved, jnp.abs(z), 1.0)
    power = jnp.where(moved, jnp.exp(n * jnp.log(size)), 0.0)
    return (beta * jnp.abs(dx) * jnp.sign(z) + gamma * dx) * power
