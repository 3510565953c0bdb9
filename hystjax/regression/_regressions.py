"""Sparse and plain regressions on a factored least-squares problem."""

from abc import abstractmethod

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Bool, Float, Int

from .. import _checks
from ._novelty import novelty
from ._problem import LeastSquaresProblem


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
        _checks.positive("ridge", self.ridge, zero=True)

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
        _checks.positive("threshold", self.threshold, zero=True)
        _checks.positive("ridge", self.ridge, zero=True)
        _checks.positive("max_steps", self.max_steps)

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
