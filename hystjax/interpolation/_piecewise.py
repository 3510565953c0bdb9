"""Input paths that are polynomials between knots."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ._path import AbstractInputPath


class PiecewisePolynomial(AbstractInputPath):
    """A path with `pieces` equal polynomial pieces in every sample interval.

    **Attributes:**

    - `t`: sample times, shape (n,), s.
    - `coefficients`: shape (pieces (n - 1), degree + 1), lowest power first, of the
        time since the piece's start, s.
    - `pieces`: number of pieces a sample interval.
    """

    coefficients: Float[Array, "m order"]
    pieces: int = eqx.field(static=True)

    @property
    def kinked(self):
        """Straight lines are, splines are not."""
        return self.coefficients.shape[-1] == 2

    def segments(self):
        intervals = self.t.shape[0] - 1
        return (
            jnp.diff(self.t) / self.pieces,
            self.coefficients.reshape(intervals, self.pieces, -1),
        )

    def evaluate(self, segment, fraction):
        length, coefficients = segment
        piece = jnp.clip(jnp.floor(fraction * self.pieces), 0, self.pieces - 1)
        since = (fraction * self.pieces - piece) * length
        # A lone piece needs no look-up, which would slow the fixed-step solver.
        index = 0 if self.pieces == 1 else piece.astype(int)
        powers = coefficients[index]
        u, du = powers[-1], jnp.zeros_like(since)
        for order in range(powers.shape[0] - 2, -1, -1):
            du = du * since + u
            u = u * since + powers[order]
        return u, du
