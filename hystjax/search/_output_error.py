"""The free runs of all laws close to one, linear in their coefficients."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._jit import jit
from ..library import Library
from ..models import SparseModel
from ..refinement import Objective, Samples, Squares, Unknowns, linearised, parameters
from ..regression import LeastSquaresProblem, compress


@jit
def output_error(
    samples: Samples,
    library: Library,
    coefficients: Float[Array, " k"],
    starts: Float[Array, " r"],
    outputs: Float[Array, "b r n"] | None = None,
) -> LeastSquaresProblem:
    """The misfit of the free run as a least-squares problem in the coefficients of all
    k candidates, about one law.

    Regressions of the derivative see noise that the free run averages out, and miss
    drifts that it adds up. Here the misfit itself is regressed on its sensitivities, so
    that the supports of least misfit can be looked for without simulating each.

    **Arguments:** what is matched; the candidates; and of the law the coefficients,
    zero for terms it does not have, and first outputs. These are free too. Of other
    `outputs` than those of the samples there are b problems, along a leading axis of
    `target` and `remainder`.

    **Source:** Ljung (1999), System Identification, 2nd ed., section 10.2, ISBN
    0-13-656695-2: Gauss-Newton steps of output-error models.
    """
    law = SparseModel(library, coefficients, np.ones(len(library), bool))
    fitted = parameters(law, tuple(library.numbers), {}, {})
    objective = Objective(fitted, samples, Squares(), 1, 0.0, True)
    run = linearised(objective, Unknowns(coefficients, starts[:, None, None]))
    root = jnp.sqrt(samples.weight).ravel()
    by_terms, by_starts = jnp.split(root[:, None] * run.jacobian, [len(library)], 1)
    whole = jnp.concatenate([by_starts, by_terms], axis=1)
    r = by_starts.shape[1]

    def about(measured):
        misfit = root * (run.run.outputs - measured).ravel()
        problem = compress(whole, by_terms @ coefficients - misfit)
        # The rows below those of the starts are what no choice of starts can explain.
        return LeastSquaresProblem(
            problem.triangle[r:, r:],
            problem.target[r:],
            problem.remainder,
            problem.rows,
        )

    if outputs is None:
        return about(samples.w)
    each = jax.lax.map(about, outputs)
    return eqx.tree_at(lambda p: p.triangle, each, each.triangle[0])
