"""How often each term is chosen when the data are drawn again."""

from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ..regression import LeastSquaresProblem
from ._candidate import information_criterion
from ._ranking import ranking


def inclusion(
    problems: LeastSquaresProblem,
    supports: Sequence[Int[np.ndarray, "_m _s"]],
    samples: float,
    others: int,
) -> Float[np.ndarray, " k"]:
    """The share of problems in which each of k terms is in the support of the least
    extended Bayesian information criterion.

    **Arguments:** b problems with one `triangle`, and `target` and `remainder` along a
    leading axis; the supports to choose from, by size; how many independent samples
    there are; and how many unknowns besides the terms.

    **Source:** Shao (1996), doi 10.1080/01621459.1996.10476934: model selection by the
    bootstrap; Chen and Chen (2008), doi 10.1093/biomet/asn034.
    """
    b, k = problems.target.shape
    least, chosen = np.full(b, np.inf), np.zeros((b, k), bool)
    for rows in supports:
        size = rows.shape[1]
        best, variances = (np.asarray(x) for x in _best(problems, rows))
        criteria = np.array(
            [
                information_criterion(variance, samples, size + others, size, k)
                for variance in variances.tolist()
            ]
        )
        better = criteria < least
        least = np.where(better, criteria, least)
        new = np.zeros((b, k), bool)
        new[np.arange(b)[:, None], best] = True
        chosen = np.where(better[:, None], new, chosen)
    return chosen.mean(axis=0)


def _best(
    problems: LeastSquaresProblem, rows: Int[np.ndarray, "m s"]
) -> tuple[Int[Array, "b s"], Float[Array, " b"]]:
    """Of each problem the best of these supports, and the variance that it leaves."""

    def one(target_and_remainder):
        target, remainder = target_and_remainder
        problem = LeastSquaresProblem(
            problems.triangle, target, remainder, problems.rows
        )
        best = ranking(problem, rows, 1)
        left = best.residuals[0] ** 2 * (jnp.sum(target**2) + remainder**2)
        return best.rows[0], left / problems.rows

    return jax.lax.map(one, (problems.target, problems.remainder))
