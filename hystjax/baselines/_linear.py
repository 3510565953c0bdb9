"""Linear regression of the derivative on given features."""

import jax.numpy as jnp
from jaxtyping import ArrayLike

from .. import _checks
from .._errors import InputError
from .._solution import RESULTS, Solution, outcome
from ..differentiation import AbstractDifferentiation, FiniteDifference
from ..library import Library, Term
from ..models import SparseModel
from ..regression import Ridge, compress
from ._base import AbstractRateBaseline

_CONSTANT = Term()


class Linear(AbstractRateBaseline):
    """Linear or ridge regression of the derivative, with an intercept that is not
    penalised: what scikit-learn's `LinearRegression` and `Ridge` compute.

    The model that it fits is a `SparseModel` with all features and the constant.

    **Attributes:**

    - `library`: the k features, without the constant.
    - `ridge`: penalty of the squared coefficients, in their own units; 0 for least
        squares.
    - `differentiation`: how derivatives are estimated.

    **Source:** Hoerl and Kennard (1970), doi 10.1080/00401706.1970.10488634.
    """

    library: Library
    ridge: ArrayLike = 0.0
    differentiation: AbstractDifferentiation = FiniteDifference()

    def __check_init__(self):
        _checks.positive("ridge", self.ridge, zero=True)
        if _CONSTANT in self.library.terms:
            raise InputError(
                "`library` must not hold the constant 1: the intercept is one already, "
                "and not penalised."
            )

    def fit(self, recording, *, rows=None, key=None):
        """As every baseline's; nothing is random. `stats` holds `residual`, the misfit
        of the derivative relative to its deviation from the mean."""
        features, rate = self.rows(recording, rows)
        centre, mean = jnp.mean(features, axis=0), jnp.mean(rate)
        problem = compress(features - centre, rate - mean)
        slopes = Ridge(self.ridge, normalise=False).fit(problem).coefficients
        everything = jnp.append(mean - centre @ slopes, slopes)
        law = SparseModel(
            Library((_CONSTANT, *self.library.terms), self.library.numbers),
            everything,
            jnp.ones(len(everything), bool),
            names=recording.names,
            units=recording.units,
        )
        residual = problem.residual(slopes)
        result = outcome(jnp.isfinite(residual), RESULTS.diverged)
        return Solution(law, result, {"residual": residual})
