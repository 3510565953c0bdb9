"""A least-squares problem, factored once for every regression that follows."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Bool, Float, Int

from .._jit import jit


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
    triangles: the same to rounding, without leaving the cache.

    **Source:** Demmel, Grigori, Hoemmen and Langou (2012), doi 10.1137/080731992.
    """
    columns = rows.shape[1]
    block = max(_BLOCK // columns, 2 * columns)
    while rows.shape[0] > block:
        # Rows left over join the triangles: a block filled up with zeros would have no
        # derivative.
        whole = rows.shape[0] - rows.shape[0] % block
        blocks = rows[:whole].reshape(-1, block, columns)
        triangles = jnp.linalg.qr(blocks, mode="r").reshape(-1, columns)
        rows = jnp.concatenate([triangles, rows[whole:]])
    return jnp.linalg.qr(_padded(rows, max(0, columns - rows.shape[0])), mode="r")


def _padded(rows, extra: int):
    return jnp.pad(rows, ((0, extra), (0, 0)))
