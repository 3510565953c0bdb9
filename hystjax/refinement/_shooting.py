"""How a long trajectory is cut up while it is fitted."""

from abc import abstractmethod
from typing import TypeAlias

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._errors import InputError

Stages: TypeAlias = tuple[
    Float[Array, " s"], Float[Array, " s"], Float[Array, " s"] | None
]


class AbstractShooting(eqx.Module):
    """A sequence of least-squares problems, each started where the last one ended.

    The last fit is always a single trajectory from each recording's start.
    """

    @property
    @abstractmethod
    def segments(self) -> int:
        """Pieces, each with a free start, that a recording is cut into."""

    @abstractmethod
    def stages(self) -> Stages:
        """For each of the stages before the last fit: the share of the samples that
        counts; the weight of the gaps between pieces relative to the output; and the
        gain of nudging, if there is any."""


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
        return horizons, jnp.zeros_like(horizons), None


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
        return jnp.ones_like(weights), weights, None


class Nudging(AbstractShooting):
    """One trajectory a recording, drawn to the measured output at every sample, less at
    each stage.

    A drawn trajectory cannot get out of step with the record, nor far from it: where a
    free run has false minima (a resonance that is off), or is lost, this one mostly
    has neither. It needs no further unknowns, and works on models with hidden states.

    **Attributes:**

    - `gains`: for each stage, the share of its distance from the measured output by
        which the simulated output is moved after every sample; decreasing. A trajectory
        remembers some 1 / gain samples: start with less than a period of the output.

    **Source:** Vyasarayani, Uchida, Carvalho and McPhee (2011),
    doi 10.1007/s11044-011-9260-0, who add the distance to the derivative.
    """

    gains: tuple[float, ...] = eqx.field(static=True, default=(0.5, 0.2, 0.05))

    def __check_init__(self):
        falling = sorted({g for g in self.gains if 0 < g < 1}, reverse=True)
        if not self.gains or list(self.gains) != falling:
            raise InputError(
                f"`gains` must decrease and lie between 0 and 1, got {self.gains}; the "
                "free run, without gain, always comes last."
            )

    @property
    def segments(self):
        """One."""
        return 1

    def stages(self):
        gains = jnp.array(self.gains, float)
        return jnp.ones_like(gains), jnp.zeros_like(gains), gains
