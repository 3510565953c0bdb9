"""A least-squares problem, factored once for every regression that follows, and which
terms it cannot tell apart."""

from collections.abc import Sequence
from dataclasses import dataclass

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Bool, Float, Int

from .._core.compiling import jit


class LeastSquaresProblem(eqx.Module):
    """Minimise |Theta x - y|^2 over x, kept as the triangle of [Theta, y].

    An orthogonal transformation loses nothing that regression needs, and k + 1 rows
    take the place of n; masks, thresholds and ridges are then small problems.

    **Attributes:**

    - `triangle`: R of Theta = Q R, shape (k, k).
    - `target`: Q'y, shape (k,).
    - `remainder`: the part of |y| outside the span of Theta, a scalar.
    - `rows`: number n of rows that were compressed.
    """

    triangle: Float[Array, "k k"]
    target: Float[Array, " k"]
    remainder: Float[Array, ""]
    rows: int = eqx.field(static=True)

    def norms(self) -> tuple[Float[Array, " k"], Float[Array, ""]]:
        """Root mean squares of the columns of Theta, and of y."""
        columns = jnp.linalg.norm(self.triangle, axis=0)
        target = jnp.hypot(jnp.linalg.norm(self.target), self.remainder)
        return columns / self.rows**0.5, target / self.rows**0.5

    def finite(self) -> Bool[Array, ""]:
        """Whether Theta and y, and the sums of their squares, are finite."""
        columns, target = self.norms()
        return jnp.all(jnp.isfinite(columns)) & jnp.isfinite(target)

    @jit
    def columns(self, kept: Int[Array | np.ndarray, " c"]) -> "LeastSquaresProblem":
        """The problem of some of its terms alone."""
        triangle = jnp.linalg.qr(
            jnp.column_stack([self.triangle[:, kept], self.target]), mode="r"
        )
        c = len(kept)
        triangle = jnp.pad(triangle, ((0, max(0, c + 1 - triangle.shape[0])), (0, 0)))
        return LeastSquaresProblem(
            triangle[:c, :c],
            triangle[:c, c],
            jnp.hypot(triangle[c, c], self.remainder),
            self.rows,
        )

    def less(self, known: Float[Array, " k"]) -> "LeastSquaresProblem":
        """The problem of what is left of y without a known part Theta x of it."""
        return eqx.tree_at(
            lambda each: each.target, self, self.target - self.triangle @ known
        )

    def residual(self, coefficients: Float[Array, " k"]) -> Float[Array, ""]:
        """|Theta x - y| / |y|."""
        misfit = self.triangle @ coefficients - self.target
        size = jnp.hypot(jnp.linalg.norm(self.target), self.remainder)
        return jnp.hypot(jnp.linalg.norm(misfit), self.remainder) / size

    def solve(
        self, support: Bool[Array, " k"], ridge: ArrayLike = 0.0
    ) -> Float[Array, " k"]:
        """The minimiser of |Theta x - y|^2 + ridge |x|^2 over x zero off `support`.

        One orthogonal factorisation of fixed shape: columns off the support are
        replaced by unit vectors of their own.
        """
        penalties = jnp.where(support, ridge, 1.0)
        solution = _minimiser(self.triangle * support, self.target, penalties)
        return jnp.where(support, solution, 0.0)


@jax.custom_jvp
def _minimiser(matrix, target, penalties):
    """The minimiser of |matrix x - target|^2 + sum of penalties x^2."""
    return _factored(matrix, target, penalties)[1]


@_minimiser.defjvp
def _minimiser_jvp(primals, tangents):
    # By the normal equations: the factorisation itself has no derivative where the
    # target is in the span of the columns.
    matrix, target, _ = primals
    d_matrix, d_target, d_penalties = tangents
    triangle, solution = _factored(*primals)
    right = (
        d_matrix.T @ (target - matrix @ solution)
        + matrix.T @ (d_target - d_matrix @ solution)
        - d_penalties * solution
    )
    half = jax.scipy.linalg.solve_triangular(triangle, right, trans="T")
    return solution, jax.scipy.linalg.solve_triangular(triangle, half)


def _factored(matrix, target, penalties):
    """R of the penalised columns, and the minimiser."""
    k = target.shape[0]
    top = jnp.column_stack([matrix, target])
    bottom = jnp.column_stack([jnp.diag(jnp.sqrt(penalties)), jnp.zeros(k)])
    both = jnp.linalg.qr(jnp.concatenate([top, bottom]), mode="r")
    triangle = both[:k, :k]
    return triangle, jax.scipy.linalg.solve_triangular(triangle, both[:k, k])


def compress(
    regressors: Float[Array, "n k"], target: Float[Array, " n"]
) -> LeastSquaresProblem:
    """Factor the problem of `target` regressed on the columns of `regressors`."""
    n, k = regressors.shape
    triangle = _triangle(jnp.column_stack([regressors, target]))
    return LeastSquaresProblem(triangle[:k, :k], triangle[:k, k], triangle[k, k], n)


def merged(problems: LeastSquaresProblem) -> LeastSquaresProblem:
    """The problem of all rows of several, which lie along the first axis of its arrays,
    shape (m, ...), and have as many rows each.

    Some of them, drawn again and again, are a bootstrap of blocks of rows; one by one,
    as a record is read, they are a problem of more rows than memory holds.
    """
    k = problems.target.shape[-1]
    top = jnp.concatenate([problems.triangle, problems.target[..., None]], axis=2)
    bottom = jnp.pad(problems.remainder[:, None, None], ((0, 0), (0, 0), (k, 0)))
    rows = jnp.concatenate([top, bottom], axis=1).reshape(-1, k + 1)
    triangle = _triangle(rows)
    count = problems.rows * problems.target.shape[0]
    return LeastSquaresProblem(triangle[:k, :k], triangle[:k, k], triangle[k, k], count)


_BLOCK = 8192  # numbers: more make LAPACK start threads, which costs more than it saves


def _triangle(rows: Float[Array, "n c"]) -> Float[Array, "c c"]:
    """R of the QR factorisation of `rows`, by blocks of rows and then of their
    triangles: the same to rounding, without leaving the cache. Of so many columns that
    a block would be little longer than its triangle LAPACK has blocks of its own.

    **Source:** Demmel, Grigori, Hoemmen and Langou (2012), doi 10.1137/080731992.
    """
    columns = rows.shape[1]
    block = _BLOCK // columns
    while block >= 2 * columns and rows.shape[0] > block:
        # Rows left over join the triangles: a block filled up with zeros would have no
        # derivative.
        whole = rows.shape[0] - rows.shape[0] % block
        blocks = rows[:whole].reshape(-1, block, columns)
        triangles = jnp.linalg.qr(blocks, mode="r").reshape(-1, columns)
        rows = jnp.concatenate([triangles, rows[whole:]])
    return jnp.linalg.qr(_padded(rows, max(0, columns - rows.shape[0])), mode="r")


def _padded(rows, extra: int):
    return jnp.pad(rows, ((0, extra), (0, 0)))


def rank_tolerance(dtype) -> float:
    """Share of a column below which what is left of it counts as rounding."""
    return 0.01 * float(jnp.finfo(dtype).eps) ** 0.5


@jit
def novelty(
    problem: LeastSquaresProblem,
    candidates: Bool[Array, " k"] | None = None,
    tolerance: Float[ArrayLike, ""] | None = None,
) -> tuple[Float[Array, " k"], Bool[Array, " k"]]:
    """What each column adds to the columns before it.

    Goes through the columns in order, so that of several that cannot be told apart the
    first is kept: with the lowest degree, in a library that lists low degrees first.

    **Arguments:**

    - `problem`: the factored problem.
    - `candidates`: columns to look at; all by default.
    - `tolerance`: a column of which a smaller share is new is not kept; rounding by
        default.

    **Returns:** the share of each column's norm that no kept column before it explains
    (0 to 1), and which columns are kept. Both of shape (k,).
    """
    triangle = jax.lax.stop_gradient(problem.triangle)
    k = triangle.shape[0]
    limit = rank_tolerance(triangle.dtype) if tolerance is None else tolerance
    candidates = jnp.ones(k, bool) if candidates is None else candidates

    def look(basis, column):
        vector, candidate = column
        size = jnp.linalg.norm(vector)
        left = vector - basis @ (basis.T @ vector)
        left = left - basis @ (basis.T @ left)  # again, or rounding stays behind
        length = jnp.linalg.norm(left)
        share = jnp.where(size > 0, length / jnp.where(size > 0, size, 1), 0.0)
        keep = candidate & (share > limit)
        direction = jnp.where(keep, left / jnp.where(length > 0, length, 1), 0.0)
        return basis, share, keep, direction

    def step(carry, column):
        basis, index = carry
        basis, share, keep, direction = look(basis, column)
        return (basis.at[:, index].set(direction), index + 1), (share, keep)

    start = (jnp.zeros_like(triangle), 0)
    _, (shares, kept) = jax.lax.scan(step, start, (triangle.T, candidates))
    return shares, kept


@dataclass(frozen=True)
class Alias:
    """A term that is nearly a combination of simpler ones on a recording.

    **Attributes:**

    - `term`: its name.
    - `share`: the share of its norm that the combination misses, 0 to 1.
    - `combination`: coefficients by the names of the simpler terms.
    """

    term: str
    share: float
    combination: dict[str, float]

    def __str__(self) -> str:
        *others, last = self.combination or ["nothing (it is zero here)"]
        known = f"a mix of {', '.join(others)} and {last}" if others else last
        new = f"{100 * self.share:.2g} % of it is new"
        return f"{self.term} cannot be told from {known} ({new})"


def aliases(
    problem: LeastSquaresProblem, names: Sequence[str], tolerance: float = 0.01
) -> tuple[Alias, ...]:
    """Columns of a factored problem that are nearly combinations of columns before
    them.

    **Arguments:** the problem of k columns; the names of its terms; and the share of a
    column that must be new.

    **Returns:** one `Alias` for each that is not, in the order of the columns.
    """
    found = novelty(problem, tolerance=jnp.asarray(tolerance))
    shares, kept, triangle = map(np.asarray, (*found, problem.triangle))
    return tuple(
        _alias(triangle, names, int(j), max(tolerance, float(shares[j])))
        for j in np.flatnonzero(~kept)
    )


def _alias(triangle, names, j: int, tolerance: float) -> Alias:
    """The fewest terms before term j that make it up: added greedily, then pruned."""
    target, before = triangle[:, j], triangle[:, :j]
    size = np.linalg.norm(target) or 1.0
    lengths = np.linalg.norm(before, axis=0)

    def explain(chosen):
        if not chosen:
            return np.zeros(0), target
        coefficients, *_ = np.linalg.lstsq(before[:, chosen], target, rcond=None)
        return coefficients, target - before[:, chosen] @ coefficients

    def share(chosen):
        return float(np.linalg.norm(explain(chosen)[1]) / size)

    chosen: list[int] = []
    while share(chosen) > tolerance and len(chosen) < j:
        likeness = np.abs(before.T @ explain(chosen)[1])
        likeness /= np.where(lengths > 0, lengths, np.inf)
        likeness[chosen] = -1
        chosen.append(int(np.argmax(likeness)))
    for i in tuple(chosen):
        fewer = [other for other in chosen if other != i]
        chosen = fewer if share(fewer) <= tolerance else chosen
    coefficients, _ = explain(chosen)
    parts = {names[i]: float(c) for i, c in zip(chosen, coefficients, strict=True)}
    return Alias(names[j], share(chosen), parts)
