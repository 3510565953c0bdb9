"""What a residual costs: squares, or less than that for outliers."""

from abc import abstractmethod

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from .. import _checks

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
        _checks.positive("threshold", self.threshold)

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
        _checks.positive("scale", self.scale)

    def signed_root(self, residuals):
        square = (residuals / self.scale) ** 2
        small = square < 1e-12
        safe = jnp.where(small, 1.0, square)
        return residuals * jnp.where(small, 1.0, jnp.sqrt(jnp.log1p(safe) / safe))

    def influence(self, residuals):
        return residuals / (1 + (residuals / self.scale) ** 2)
