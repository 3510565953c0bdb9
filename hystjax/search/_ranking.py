"""The best supports of one size on a factored least-squares problem."""

import itertools
import math
from collections.abc import Iterator
from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from .._jit import jit
from ..regression import LeastSquaresProblem

_MOST = 500_000  # supports that are looked at one by one
_BEAM = 2000  # supports that are grown where there are more
_CHUNK = 8192  # small solves at a time
_ROWS, _TERMS = 4096, 4  # to multiples of which supports are filled up


class Ranking(eqx.Module):
    """Supports of s terms, the best first.

    **Attributes:**

    - `rows`: which terms, shape (c, s).
    - `coefficients`: of least squares on each support, shape (c, s).
    - `residuals`: relative misfits, shape (c,).
    """

    rows: Int[Array | np.ndarray, "c s"]
    coefficients: Float[Array | np.ndarray, "c s"]
    residuals: Float[Array | np.ndarray, " c"]


def supports(
    terms: int,
    size: int,
    shorter: Int[Array | np.ndarray, "c t"] | None = None,
    most: int = _MOST,
) -> Int[np.ndarray, "m s"]:
    """Supports of `size` out of `terms`: all of them, or where these are more than
    `most`, the shorter ones that are given, each with one term more."""
    if shorter is None or math.comb(terms, size) <= most:
        every = itertools.chain.from_iterable(
            itertools.combinations(range(terms), size)
        )
        return np.fromiter(every, int).reshape(-1, size)
    grown = {
        tuple(sorted((*map(int, row), extra)))
        for row in np.asarray(shorter)
        for extra in set(range(terms)) - set(map(int, row))
    }
    return np.array(sorted(grown))


def ranking(
    problem: LeastSquaresProblem, rows: Int[np.ndarray, "m s"], count: int
) -> Ranking:
    """The best supports of least squares.

    By normal equations of normalised columns, which are precise enough to rank.

    **Arguments:** the factored problem; the supports to look at; and how many of them
    are wanted, at most.

    **Source:** Miller (2002), doi 10.1201/9781420035933.
    """
    best = _ranking(problem, np.asarray(rows), count)
    return _part(best, min(count, len(rows)), np.shape(rows)[1])


def _ranking(problem: LeastSquaresProblem, rows: np.ndarray, count: int) -> Ranking:
    """As `ranking`, filled up: few programs serve supports of all sizes."""
    # The number of samples has no part in it, and would make another program.
    bare = replace(problem, rows=0)
    m, s = rows.shape
    shape = -(-m // _ROWS) * _ROWS, -(-s // _TERMS) * _TERMS
    filled, used = np.zeros(shape, int), np.zeros(shape, bool)
    filled[:m, :s], used[:m, :s] = rows, True
    return _ranked(bare, filled, used, min(count, len(filled)))


def _part(ranking: Ranking, count: int, size: int) -> Ranking:
    return Ranking(
        ranking.rows[:count, :size],
        ranking.coefficients[:count, :size],
        ranking.residuals[:count],
    )


def rankings(
    problem: LeastSquaresProblem,
    largest: int,
    count: int,
    beam: int = _BEAM,
    most: int = _MOST,
) -> Iterator[Ranking]:
    """The best supports of each size up to the `largest`.

    **Arguments:** the factored problem; how many supports of a size are wanted; and of
    sizes with more than `most` supports, how many of the size before are grown.
    """
    grown = None
    for size in range(1, min(largest, len(problem.target)) + 1):
        rows = supports(len(problem.target), size, grown, most)
        # As many whatever is asked for: one program for all problems of these terms.
        best = jax.device_get(_ranking(problem, rows, max(count, beam, _BEAM)))
        grown = _part(best, min(beam, len(rows)), size).rows
        yield _part(best, min(count, len(rows)), size)


@jit
def _ranked(problem: LeastSquaresProblem, rows, used, count: int) -> Ranking:
    solutions, left = solved(problem, rows, used)
    # What is not a number comes last, and what only fills up after that.
    last = jnp.where(jnp.isfinite(left), left, jnp.finfo(left.dtype).max)
    _, best = jax.lax.top_k(-jnp.where(used[:, 0], last, jnp.inf), count)
    residuals = jnp.sqrt(jnp.maximum(left[best], 0.0))
    return Ranking(rows[best], solutions[best], residuals)


def solved(
    problem: LeastSquaresProblem,
    rows: Int[Array, "m s"],
    used: Bool[Array, "m s"] | None = None,
) -> tuple[Float[Array, "m s"], Float[Array, " m"]]:
    """For each support the coefficients of least squares, and the share of the target's
    square that they leave. Terms that are not used have the coefficient 0."""
    lengths = jnp.linalg.norm(problem.triangle, axis=0)
    lengths = jnp.where(lengths > 0, lengths, 1.0)
    columns = problem.triangle / lengths
    gram, right = columns.T @ columns, columns.T @ problem.target
    size = jnp.sum(problem.target**2) + problem.remainder**2
    used = jnp.ones(rows.shape, bool) if used is None else used

    def solve(row, used):
        both, target = used & used[:, None], jnp.where(used, right[row], 0.0)
        matrix = jnp.where(both, gram[row][:, row], jnp.eye(len(row), dtype=gram.dtype))
        chosen = jnp.linalg.solve(matrix, target)
        return chosen / lengths[row], (size - target @ chosen) / size

    return jax.lax.map(lambda each: solve(*each), (rows, used), batch_size=_CHUNK)
