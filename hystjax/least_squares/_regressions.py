"""Sparse and plain regressions on a factored least-squares problem, and STLSQ over many
thresholds at once."""

from abc import abstractmethod

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Bool, Float, Int

from .._core import checks
from ._problem import LeastSquaresProblem, novelty


class Fit(eqx.Module):
    """Coefficients found by a regression, or along a path of several.

    **Attributes:**

    - `coefficients`: shape (k,), zero off the support.
    - `support`: which terms take part, shape (k,).
    - `num_steps`: regressions that were solved.
    """

    coefficients: Float[Array, "*paths k"]
    support: Bool[Array, "*paths k"]
    num_steps: Int[Array, "*paths"]


class AbstractRegression(eqx.Module):
    """Finds coefficients for a factored least-squares problem.

    Single problem in, single fit out; `jax.vmap` over the attributes, the problem or
    both gives paths, ensembles and batches.
    """

    @abstractmethod
    def fit(self, problem: LeastSquaresProblem) -> Fit:
        """Coefficients and support."""


class LeastSquares(AbstractRegression):
    """Ordinary least squares over all terms the data can tell apart.

    Terms that add nothing to those before them get the coefficient 0.
    """

    def fit(self, problem):
        _, kept = novelty(problem)
        return Fit(problem.solve(kept), kept, jnp.array(1))


class Ridge(AbstractRegression):
    """Least squares with a penalty `ridge` times the sum of squared coefficients.

    **Attributes:**

    - `ridge`: at least 0; with `normalise` relative to the normalised problem.
    - `normalise`: whether columns and target are divided by their root mean squares
        and the squared residual by the number of rows, so that `ridge` has no unit.

    **Source:** Hoerl and Kennard (1970), doi 10.1080/00401706.1970.10488634.
    """

    ridge: ArrayLike = 1.0
    normalise: bool = eqx.field(static=True, default=True)

    def __check_init__(self):
        checks.positive("ridge", self.ridge, zero=True)

    def fit(self, problem):
        inner, unit = scaled(problem, self.normalise)
        start = full_support(inner, self.ridge)
        solution = inner.solve(start, self.ridge)
        return Fit(solution * unit, start, jnp.array(1))


class STLSQ(AbstractRegression):
    """Sequentially thresholded least squares.

    Ridge regression, dropping terms with coefficients below the threshold, until none
    drops; then least squares without ridge on what is left. Terms that cannot be told
    apart are resolved by the ridge when it is positive, and else by dropping those that
    come later in the library.

    **Attributes:**

    - `threshold`: smallest magnitude kept. With `normalise` a share of the derivative's
        root mean square, meaning the same for every term; without, in each
        coefficient's own units.
    - `ridge`: as in `Ridge`.
    - `normalise`: as in `Ridge`.
    - `max_steps`: most regressions before the last.

    **Source:** Brunton, Proctor and Kutz (2016), doi 10.1073/pnas.1517384113. With
    `normalise=False`, and columns that the data tell apart, the results are those of
    PySINDy's `STLSQ`. Of columns that are equal, or a mix of others, PySINDy keeps all
    and shares the coefficient between them in the last regression; here the first has
    it, and the law is shorter and predicts the same. Without a ridge PySINDy compares
    the shares with the threshold, or what rounding makes of them, and may end with
    other terms altogether; here the later columns are left out from the start.
    """

    threshold: ArrayLike = 0.05
    ridge: ArrayLike = 0.0
    normalise: bool = eqx.field(static=True, default=True)
    max_steps: int = eqx.field(static=True, default=20)

    def __check_init__(self):
        checks.positive("threshold", self.threshold, zero=True)
        checks.positive("ridge", self.ridge, zero=True)
        checks.positive("max_steps", self.max_steps)

    def fit(self, problem):
        inner, unit = scaled(problem, self.normalise)
        support, num_steps = self._thresholded(jax.lax.stop_gradient(inner))
        _, told_apart = novelty(inner, support)
        return Fit(inner.solve(told_apart) * unit, told_apart, num_steps)

    def _thresholded(self, problem):
        def shrink(state):
            support, _, step = state
            large = jnp.abs(problem.solve(support, self.ridge)) >= self.threshold
            smaller = support & large
            return smaller, jnp.any(smaller != support), step + 1

        def unfinished(state):
            _, changed, step = state
            return changed & (step < self.max_steps)

        start = full_support(problem, self.ridge)
        state = (start, jnp.array(True), jnp.array(0))
        support, _, num_steps = jax.lax.while_loop(unfinished, shrink, state)
        return support, num_steps + 1


def full_support(problem, ridge):
    """All terms where a ridge makes the solution unique, else those told apart."""
    _, kept = novelty(problem)
    return jnp.where(jnp.asarray(ridge) > 0, True, kept)


def scaled(problem, normalise):
    """The problem in normalised columns, and the factor back to physical units."""
    if not normalise:
        return problem, jnp.ones_like(problem.target)
    columns, size = problem.norms()
    columns = jnp.where(columns > 0, columns, 1.0)
    size = jnp.where(size > 0, size, 1.0)
    per_row = problem.rows**0.5
    inner = LeastSquaresProblem(
        problem.triangle / (columns * per_row),
        problem.target / (size * per_row),
        problem.remainder / (size * per_row),
        problem.rows,
    )
    return inner, size / columns


def threshold_path(
    regression: STLSQ, problem: LeastSquaresProblem, thresholds: Float[Array, " m"]
) -> Fit:
    """Fits for many thresholds, each as `regression` with that threshold would give.

    Thresholds that have come to the same support share its regression: the same as
    `jax.vmap` over thresholds, in a fraction of the time, since neighbours pass through
    the same supports.

    **Arguments:** the regression, whose own threshold is not used; the factored
    problem of k terms; and the thresholds, positive or zero, in any order.

    **Returns:** a `Fit` with leading axis m.
    """
    inner, unit = scaled(problem, regression.normalise)
    supports, num_steps = _supports(regression, inner, thresholds)

    def settle(state):
        coefficients, final, pending = state
        support = supports[jnp.argmax(pending)]
        alike = _alike(supports, support, pending)
        _, kept = novelty(inner, support)
        solution = inner.solve(kept) * unit
        return (
            jnp.where(alike[:, None], solution, coefficients),
            jnp.where(alike[:, None], kept, final),
            pending & ~alike,
        )

    nothing = jnp.zeros(supports.shape, problem.target.dtype)
    start = (nothing, supports, jnp.ones(len(thresholds), bool))
    coefficients, final, _ = jax.lax.while_loop(_any_pending, settle, start)
    return Fit(coefficients, final, num_steps)


def _supports(regression, problem, thresholds):
    """Supports after thresholding, and how many regressions each took."""
    first = full_support(problem, regression.ridge)
    every = jnp.broadcast_to(first, (len(thresholds), len(first)))

    def shrink(state):
        supports, steps, pending = state
        support = supports[jnp.argmax(pending)]
        alike = _alike(supports, support, pending)
        size = jnp.abs(problem.solve(support, regression.ridge))
        large = size >= thresholds[:, None]
        smaller = jnp.where(alike[:, None], supports & large, supports)
        steps = steps + alike
        changed = jnp.any(smaller != supports, axis=1)
        on = jnp.where(alike, changed & (steps < regression.max_steps), pending)
        return smaller, steps, on

    start = (every, jnp.zeros(len(thresholds), int), jnp.ones(len(thresholds), bool))
    supports, steps, _ = jax.lax.while_loop(_any_pending, shrink, start)
    return supports, steps + 1


def _any_pending(state) -> Bool[Array, ""]:
    return jnp.any(state[-1])


def _alike(supports, support, pending) -> Bool[Array, " m"]:
    """The pending thresholds that have this support."""
    return pending & jnp.all(supports == support, axis=1)
