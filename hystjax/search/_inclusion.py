"""How often each term is chosen when the data are drawn again."""

from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from .._jit import jit
from ..library import Library
from ..regression import LeastSquaresProblem
from ._candidate import HARDLY, information_criterion
from ._plainness import plainness
from ._ranking import solved


def inclusion(
    problems: LeastSquaresProblem,
    library: Library,
    supports: Sequence[Int[np.ndarray, "_m _s"]],
    samples: float,
    others: int,
) -> Float[np.ndarray, " k"]:
    """The share of problems in which each of k terms is in the support that is chosen
    by the extended Bayesian information criterion, as `ordered` chooses candidates.

    **Arguments:** b problems with one `triangle`, and `target` and `remainder` along a
    leading axis; the terms; the supports to choose from, by size; how many independent
    samples there are; and how many unknowns besides the terms.

    **Source:** Shao (1996), doi 10.1080/01621459.1996.10476934: model selection by the
    bootstrap; Chen and Chen (2008), doi 10.1093/biomet/asn034.
    """
    k = len(library)
    criteria, every = [], []
    for rows in supports:
        size = rows.shape[1]
        penalty = information_criterion(1.0, samples, size + others, size, k)
        variances = np.asarray(_variances(problems, jnp.asarray(rows)))
        criteria.append(samples * np.log(variances) + penalty)
        every += rows.tolist()
    chosen = _plainest(np.concatenate(criteria, axis=1), library, every)
    return np.array([np.mean([i in every[c] for c in chosen]) for i in range(k)])


def _plainest(criteria: Float[np.ndarray, "b m"], library: Library, every):
    """Of each problem the plainest of m supports that is hardly told from the best, and
    of those as plain the best."""
    keys = [plainness([library.terms[i] for i in row]) for row in every]
    levels = {key: level for level, key in enumerate(sorted(set(keys)))}
    criteria = np.where(np.isfinite(criteria), criteria, np.inf)
    near = criteria < criteria.min(axis=1, keepdims=True) + HARDLY
    level = np.where(near, [levels[key] for key in keys], len(levels))
    plainest = level == level.min(axis=1, keepdims=True)
    return np.argmin(np.where(plainest, criteria, np.inf), axis=1)


@jit
def _variances(
    problems: LeastSquaresProblem, rows: Int[Array, "m s"]
) -> Float[Array, "b m"]:
    """What each support leaves of each problem, a row."""

    def one(target_and_remainder):
        target, remainder = target_and_remainder
        problem = LeastSquaresProblem(
            problems.triangle, target, remainder, problems.rows
        )
        _, left = solved(problem, rows)
        return left * (jnp.sum(target**2) + remainder**2) / problems.rows

    return jax.lax.map(one, (problems.target, problems.remainder))
