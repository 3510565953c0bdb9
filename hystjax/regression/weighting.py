"""How much each equation of a regression counts."""

from abc import abstractmethod
from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from .._core import checks
from ..least_squares import compress, novelty, root_of
from ..recording._as_measured import NORMAL

__all__ = [
    "AbstractWeighting",
    "Bisquare",
    "Even",
]


def __dir__() -> list[str]:
    return __all__


class AbstractWeighting(eqx.Module):
    """Weighs the equations of a least-squares problem before it is factored, and so
    for every regression that follows."""

    @abstractmethod
    def weights(
        self, regressors: Float[Array, "n k"], target: Float[Array, " n"]
    ) -> Float[Array, " n"]:
        """The factor of each squared residual, 0 to 1; equations that count for nothing
        by the weights of their samples are zeros."""


class Even(AbstractWeighting):
    """Every equation counts."""

    def weights(self, regressors, target):
        return jnp.ones_like(target)


_STRETCHES = 5  # of neighbouring equations, in the subset that a trial fit sees


class Bisquare(AbstractWeighting):
    """Tukey's bisquare of the residuals of all terms together, by iteratively
    reweighted least squares.

    A bad sample spoils the regressors of one equation and the derivatives of its
    neighbours, and may pull a fit of all equations to itself. So the iteration starts
    from the best of many trial fits, each of a few short stretches of equations,
    judged by the median magnitude of its residuals over all equations: a bad sample
    spoils neighbours together, so that many stretches are without any. Medians are of
    equations whose target is not zero: of a device at rest most laws are right.

    **Attributes:**

    - `cutoff`: residuals beyond so many scales count for nothing; 4.685 keeps 95 % of
        the efficiency of least squares under normal errors. The scale is 1.4826 times
        the median magnitude of the residuals.
    - `floor`: least scale, as a share of that of the target itself: what a record
        without noise leaves of the equations is not an error of the record.
    - `trials`: how many fits to start from.
    - `steps`: of the iteration.

    **Source:** Rousseeuw (1984), doi 10.1080/01621459.1984.10477105, for the trials;
    Holland and Welsch (1977), doi 10.1080/03610927708827533, for the iteration.
    """

    cutoff: ArrayLike = 4.685
    floor: ArrayLike = 0.01
    trials: int = eqx.field(
        converter=partial(checks.count, "trials"), static=True, default=200
    )
    steps: int = eqx.field(
        converter=partial(checks.count, "steps"), static=True, default=20
    )

    def __check_init__(self):
        checks.positive("cutoff", self.cutoff)
        checks.positive("floor", self.floor)

    def weights(self, regressors, target):
        least = self.floor * NORMAL * _median(jnp.abs(target), target)

        def weighed(coefficients):
            size = jnp.abs(target - regressors @ coefficients)
            scale = jnp.maximum(NORMAL * _median(size, target), least)
            inside = 1 - (size / (self.cutoff * scale)) ** 2
            return jnp.maximum(inside, 0.0) ** 2

        def improve(_, weights):
            root = root_of(weights)
            return weighed(_fit(root[:, None] * regressors, root * target))

        start = weighed(self._best_trial(regressors, target))
        return jax.lax.fori_loop(0, self.steps, improve, start)

    def _best_trial(self, regressors, target):
        n, k = regressors.shape
        stretch = jnp.arange(-(-k // _STRETCHES) + 1)
        apart = jnp.arange(_STRETCHES) * n // _STRETCHES
        subset = (apart[:, None] + stretch).ravel()

        def trial(shift):
            rows = (subset + shift) % n
            return _fit(regressors[rows], target[rows])

        shifts = jnp.arange(self.trials) * n // (self.trials * _STRETCHES)
        fits = jax.vmap(trial)(shifts)

        def misfit(fit):
            return _median(jnp.abs(target - regressors @ fit), target)

        # One after the other: all at once would be hundreds of numbers for a sample.
        return fits[jnp.nanargmin(jax.lax.map(misfit, fits))]


def _median(size: Float[Array, "*f n"], target: Float[Array, " n"]) -> Array:
    """That of equations whose target is not zero."""
    return jnp.nanmedian(jnp.where(target == 0, jnp.nan, size), axis=-1)


def _fit(regressors, target):
    """Least squares over the terms that the equations can tell apart."""
    problem = compress(regressors, target)
    _, kept = novelty(problem)
    return problem.solve(kept)
