"""What a fit can be told: what a residual costs, squares or less than that for
outliers, and how a long trajectory is cut up while it is fitted."""

from abc import abstractmethod
from typing import TypeAlias

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._core import checks
from .._core.errors import InputError

Residuals = Float[Array, "*s"]


class AbstractLoss(eqx.Module):
    """The cost rho(r) of residuals in output units; rho(r) = r^2 / 2 near 0."""

    @abstractmethod
    def signed_root(self, residuals: Residuals) -> Residuals:
        """sign(r) sqrt(2 rho(r)): a residual whose square is twice the cost, so that
        least-squares solvers apply."""

    @abstractmethod
    def influence(self, residuals: Residuals) -> Residuals:
        """d rho / d r."""


class Squares(AbstractLoss):
    """r^2 / 2: best for Gaussian noise."""

    def signed_root(self, residuals):
        return residuals

    def influence(self, residuals):
        return residuals


class Huber(AbstractLoss):
    """Squares up to a threshold, straight lines beyond.

    **Attributes:**

    - `threshold`: output units; 1.345 standard deviations of the noise keep 95 % of the
        efficiency of squares.

    **Source:** Huber (1964), doi 10.1214/aoms/1177703732.
    """

    threshold: float | Array

    def __check_init__(self):
        checks.positive("threshold", self.threshold)

    def signed_root(self, residuals):
        size = jnp.abs(residuals)
        far = size > self.threshold
        safe = jnp.where(far, size, self.threshold)
        root = jnp.sqrt(self.threshold * (2 * safe - self.threshold))
        return jnp.where(far, jnp.sign(residuals) * root, residuals)

    def influence(self, residuals):
        return jnp.clip(residuals, jnp.negative(self.threshold), self.threshold)


class Cauchy(AbstractLoss):
    """scale^2 log(1 + (r / scale)^2) / 2: gross outliers count for almost nothing.

    **Attributes:**

    - `scale`: output units; 2.385 standard deviations of the noise keep 95 % of the
        efficiency of squares.

    **Source:** Holland and Welsch (1977), doi 10.1080/03610927708827533.
    """

    scale: float | Array

    def __check_init__(self):
        checks.positive("scale", self.scale)

    def signed_root(self, residuals):
        square = (residuals / self.scale) ** 2
        small = square < 1e-12
        safe = jnp.where(small, 1.0, square)
        return residuals * jnp.where(small, 1.0, jnp.sqrt(jnp.log1p(safe) / safe))

    def influence(self, residuals):
        return residuals / (1 + (residuals / self.scale) ** 2)


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
