"""A law whose terms are data."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from ..library import Library
from ..models import AbstractLaw


class Choice(AbstractLaw):
    """Some terms of a library, told by an array: laws of other terms are then other
    values of one compiled program, and a batch of them is fitted side by side.

    **Attributes:**

    - `library`: the k candidates.
    - `rows`: which of them, shape (s,).
    - `used`: whether each takes part, shape (s,); laws of fewer terms are padded.
    - `coefficients`: s scalars.
    """

    library: Library
    rows: Int[Array, " s"]
    used: Bool[Array, " s"]
    coefficients: tuple[Float[Array, ""], ...]

    @property
    def memory(self):
        return self.library.memory

    def rate(self, x, m, now):
        signals = self.memory.values(m, now)
        return self.library.weighted(self.spread(), x, now.u, now.du, signals)

    def spread(self) -> Float[Array, " k"]:
        """A coefficient for every candidate."""
        places = jax.nn.one_hot(self.rows, len(self.library)) * self.used[:, None]
        return jnp.stack(self.coefficients) @ places.astype(self.coefficients[0].dtype)

    def parameters(self):
        return {str(i): value for i, value in enumerate(self.coefficients)}

    def with_parameters(self, values):
        new = tuple((self.parameters() | dict(values)).values())
        return eqx.tree_at(lambda model: model.coefficients, self, new)

    def addends(self):
        weights = self.spread().tolist()
        return tuple(zip(weights, self.library.terms, strict=True))
