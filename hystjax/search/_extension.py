"""Supports with one term more."""

from collections.abc import Iterator

import numpy as np
from jaxtyping import Float

from ..regression import LeastSquaresProblem


def extensions(
    problem: LeastSquaresProblem, support: tuple[int, ...]
) -> Iterator[tuple[tuple[int, ...], Float[np.ndarray, " s"]]]:
    """Supports with one term more, those first whose term explains most of what the
    support leaves, and their coefficients of least squares.

    **Source:** Chen, Billings and Luo (1989), doi 10.1080/00207178908953472: a step of
    forward selection by orthogonal least squares.
    """
    columns, target = np.asarray(problem.triangle), np.asarray(problem.target)
    basis, _ = np.linalg.qr(columns[:, support])
    new = columns - basis @ (basis.T @ columns)
    sizes = np.linalg.norm(new, axis=0)
    usable = sizes > np.finfo(sizes.dtype).eps ** 0.5 * np.linalg.norm(columns, axis=0)
    gains = np.abs(target @ new) / np.where(usable, sizes, 1.0)
    gains[[*support, *np.flatnonzero(~usable)]] = -np.inf
    for term in np.argsort(-gains)[: np.count_nonzero(np.isfinite(gains))].tolist():
        longer = tuple(sorted((*support, term)))
        yield longer, np.linalg.lstsq(columns[:, longer], target)[0]
