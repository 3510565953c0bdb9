"""Laws that are worth trying on recordings, by linear least squares."""

from collections.abc import Iterator
from typing import TypeAlias

import numpy as np
from jaxtyping import Int

from . import search
from .library import Library
from .regression import LeastSquaresProblem

_NEARBY = 20_000  # supports looked at one by one around a law
_BEAM = 300  # supports that are grown around a law
_ABOVE = 2  # terms by which the proposals exceed a law
_LOW = 2  # degree of the terms that are tried first

Support: TypeAlias = tuple[int, ...]
Guess: TypeAlias = tuple[Support, tuple[float, ...]]
Rows: TypeAlias = Int[np.ndarray, " c"]


def nested(library: Library) -> Iterator[Rows]:
    """The terms of degree two and less, and then those of each further degree too."""
    degrees = np.array([max(_LOW, term.degree) for term in library.terms])
    for degree in np.unique(degrees):
        yield np.flatnonzero(degrees <= degree)


def best(
    problem: LeastSquaresProblem, among: Rows, largest: int, count: int
) -> Iterator[Iterator[Guess]]:
    """Of each size up to the `largest` so many guesses, the best first."""
    for ranking in search.rankings(_only(problem, among), largest, count):
        yield _guesses(ranking, among)


def around(
    problem: LeastSquaresProblem, among: Rows, support: Support, largest: int
) -> Iterator[Iterator[Guess]]:
    """For a problem about one law those with one term more; then those of each size
    near its own; each time the best first."""
    part, size = _only(problem, among), len(support)
    if size < largest:
        inside = tuple(np.searchsorted(among, support).tolist())
        more = search.extensions(part, inside)
        yield ((_rows(among, rows), tuple(values.tolist())) for rows, values in more)
    sizes = min(size + _ABOVE, largest)
    for ranking in search.rankings(part, sizes, _BEAM, _BEAM, _NEARBY):
        if ranking.rows.shape[1] >= size - 1:
            yield _guesses(ranking, among)


def _only(problem: LeastSquaresProblem, among: Rows) -> LeastSquaresProblem:
    return problem if len(among) == len(problem.target) else problem.columns(among)


def _guesses(ranking: search.Ranking, among: Rows) -> Iterator[Guess]:
    rows, values = np.asarray(ranking.rows), np.asarray(ranking.coefficients)
    for support, coefficients in zip(rows, values.tolist(), strict=True):
        yield _rows(among, support), tuple(coefficients)


def _rows(among: Rows, inside) -> Support:
    return tuple(among[list(inside)].tolist())
