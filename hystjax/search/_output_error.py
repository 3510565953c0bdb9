"""The free runs of all laws close to one, linear in their coefficients."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..library import Library
from ..models import SparseModel
from ..refinement import Objective, Samples, Squares, Unknowns, linearised, parameters
from ..regression import LeastSquaresProblem, compress


@eqx.filter_jit
def output_error(
    samples: Samples,
    library: Library,
    coefficients: Float[Array, " k"],
    starts: Float[Array, " r"],
) -> LeastSquaresProblem:
    """The misfit of the free run as a least-squares problem in the coefficients of all
    k candidates, about one law.

    Regressions of the derivative see noise that the free run averages out, and miss
    drifts that it adds up. Here the misfit itself is regressed on its sensitivities, so
    that the supports of least misfit can be looked for without simulating each.

    **Arguments:** what is matched; the candidates; and of the law the coefficients,
    zero for terms it does not have, and first outputs. These are free too.

    **Source:** Ljung (1999), System Identification, 2nd ed., section 10.2, ISBN
    0-13-656695-2: Gauss-Newton steps of output-error models.
    """
    law = SparseModel(library, coefficients, np.ones(len(library), bool))
    objective = Objective(
        parameters(law, (), {}, {}), samples, Squares(), 1, False, True
    )
    run = linearised(objective, Unknowns(coefficients, starts[:, None, None]))
    root = jnp.sqrt(samples.weight).ravel()
    jacobian = root[:, None] * run.jacobian
    misfit = root * (run.outputs - samples.w).ravel()
    by_terms, by_starts = jnp.split(jacobian, [len(library)], axis=1)
    problem = compress(
        jnp.concatenate([by_starts, by_terms], axis=1), by_terms @ coefficients - misfit
    )
    # The rows below those of the starts are what no choice of starts can explain.
    r = by_starts.shape[1]
    return LeastSquaresProblem(
        problem.triangle[r:, r:], problem.target[r:], problem.remainder, problem.rows
    )
