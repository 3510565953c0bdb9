"""What every weighting offers, and the plain one."""

from abc import abstractmethod

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float


class AbstractWeighting(eqx.Module):
    """Weighs the equations of a least-squares problem before it is factored, and so
    for every regression that follows."""

    @abstractmethod
    def weights(
        self, regressors: Float[Array, "n k"], target: Float[Array, " n"]
    ) -> Float[Array, " n"]:
        """The factor of each squared residual, 0 to 1."""


class Even(AbstractWeighting):
    """Every equation counts."""

    def weights(self, regressors, target):
        return jnp.ones_like(target)
