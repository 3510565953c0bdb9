"""A function and its derivatives, forward."""

from collections.abc import Callable
from typing import TypeVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

Values = TypeVar("Values")


def value_and_columns(
    function: Callable[[Float[Array, " q"]], Values], x: Float[Array, " q"]
) -> tuple[Values, Values]:
    """f(x), and the q columns of its Jacobian along a first axis."""

    # Compiles faster than `jax.linearize` does, which splits the program in two.
    def along(direction):
        return jax.jvp(function, (x,), (direction,))

    return jax.vmap(along, out_axes=(None, 0))(jnp.eye(len(x), dtype=x.dtype))
