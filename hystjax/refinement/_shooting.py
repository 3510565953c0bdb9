"""How a long trajectory is cut up while it is fitted."""

from abc import abstractmethod

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._errors import InputError


class AbstractShooting(eqx.Module):
    """A sequence of least-squares problems, each started where the last one ended.

    The last fit is always a single trajectory from each recording's start.
    """

    @property
    @abstractmethod
    def segments(self) -> int:
        """Pieces, each with a free start, that a recording is cut into."""

    @abstractmethod
    def stages(self) -> tuple[Float[Array, " s"], Float[Array, " s"]]:
        """For each of the stages before the last fit: the share of the samples that
        counts, and the weight of the gaps between pieces relative to the output."""


class SingleShooting(AbstractShooting):
    """One trajectory a recording, over growing horizons.

    **Attributes:**

    - `horizons`: shares of the samples, increasing, that are fitted before all of them:
        far from the truth a short horizon has fewer false minima.
    """

    horizons: tuple[float, ...] = eqx.field(static=True, default=())

    def __check_init__(self):
        if list(self.horizons) != sorted({h for h in self.horizons if 0 < h < 1}):
            raise InputError(
                "`horizons` must increase and lie between 0 and 1, got "
                f"{self.horizons}; the whole recording always comes last."
            )

    @property
    def segments(self):
        """One."""
        return 1

    def stages(self):
        horizons = jnp.array(self.horizons, float)
        return horizons, jnp.zeros_like(horizons)


class MultipleShooting(AbstractShooting):
    """Pieces side by side, each with a free start, whose gaps are closed step by step.

    For long recordings, and laws that are unstable on the way to the solution.

    **Attributes:**

    - `pieces`: number of them, at least 2.
    - `weights`: weight of the gaps at each stage, relative to the whole output's
        spread; increasing.

    **Source:** Bock (1983), doi 10.1007/978-1-4684-7324-7_8.
    """

    pieces: int = eqx.field(static=True, default=10)
    weights: tuple[float, ...] = eqx.field(static=True, default=(0.1, 1.0, 10.0, 100.0))

    def __check_init__(self):
        if self.pieces < 2:
            raise InputError(f"`pieces` must be at least 2, got {self.pieces}.")
        if not self.weights or min(self.weights) <= 0:
            raise InputError(f"`weights` must be positive, got {self.weights}.")

    @property
    def segments(self):
        """As many as there are pieces."""
        return self.pieces

    def stages(self):
        weights = jnp.array(self.weights, float)
        return jnp.ones_like(weights), weights
