"""Periodic functions of time."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float


class Waveform(eqx.Module):
    """A periodic function of time, made of cubic pieces of one length.

    **Attributes:**

    - `start`: time at which the first piece begins, s.
    - `length`: of a piece, s.
    - `coefficients`: shape (m, 4) for the m pieces of a period, lowest power first, of
        the time since the piece's start, s.
    """

    start: Float[Array, ""]
    length: Float[Array, ""]
    coefficients: Float[Array, "m 4"]

    def __call__(self, time: Float[Array, ""]) -> Float[Array, ""]:
        """The value at any time, s."""
        position = (time - self.start) / self.length
        piece = jnp.floor(position)
        since = (position - piece) * self.length
        a, b, c, d = self.coefficients[piece.astype(int) % len(self.coefficients)]
        return a + since * (b + since * (c + since * d))
