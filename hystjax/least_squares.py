"""Linear least squares: a problem, factored once for every regression that follows,
what its terms cannot tell apart, and the regressions: plain, sparse, and without
negative coefficients."""

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Bool, Float, Int

from ._core import checks
from ._core.checks import InputError, described
from ._core.compiling import jit


class LeastSquaresProblem(eqx.Module):
    """Minimise |Theta x - y|^2 over x, kept as the triangle of [Theta, y].

    An orthogonal transformation loses nothing that regression needs, and k + 1 rows
    take the place of n; masks, thresholds and ridges are then small problems.

    **Attributes:**

    - `triangle`: R of Theta = Q R, shape (k, k).
    - `target`: Q'y, shape (k,).
    - `remainder`: the part of |y| outside the span of Theta up to its sign, a scalar.
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
        found = _of_triangle(_padded(triangle, len(kept) + 1), self.rows)
        remainder = jnp.hypot(found.remainder, self.remainder)
        return eqx.tree_at(lambda each: each.remainder, found, remainder)

    def beyond(self, count: int) -> "LeastSquaresProblem":
        """The problem of its terms but the first ones, of what no choice of those can
        explain."""
        return LeastSquaresProblem(
            self.triangle[count:, count:],
            self.target[count:],
            self.remainder,
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
    rows = jnp.column_stack([regressors, target])
    return _of_triangle(_whole(rows), len(rows))


def part(
    regressors: Float[Array, "n k"], target: Float[Array, " n"]
) -> LeastSquaresProblem:
    """The same of rows that are to be `merged` with others: its derivative is NaN where
    a column is zero in these, which may have one in all."""
    rows = jnp.column_stack([regressors, target])
    return _of_triangle(_triangle(rows), len(rows))


def _of_triangle(triangle: Float[Array, "c c"], rows: int) -> LeastSquaresProblem:
    """The problem of so many rows, of the triangle of regressors and target."""
    return LeastSquaresProblem(
        triangle[:-1, :-1], triangle[:-1, -1], triangle[-1, -1], rows
    )


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
    count = problems.rows * problems.target.shape[0]
    return _of_triangle(_triangle(rows), count)


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
        # Rows left over join the triangles: to fill up a block all would be copied.
        whole = rows.shape[0] - rows.shape[0] % block
        blocks = rows[:whole].reshape(-1, block, columns)
        triangles = jnp.linalg.qr(blocks, mode="r").reshape(-1, columns)
        rows = jnp.concatenate([triangles, rows[whole:]])
    return jnp.linalg.qr(_padded(rows, columns), mode="r")


@jax.custom_jvp
def _whole(rows: Float[Array, "n c"]) -> Float[Array, "c c"]:
    """The triangle, with the derivative that R'R = A'A has. Of blocks where a column is
    zero, as that of u' where the input rests, the triangles have none; and where one is
    zero throughout, as of a play that never moves, those of all others have one."""
    return _triangle(rows)


@_whole.defjvp
def _whole_jvp(primals, tangents):
    (rows,), (changes,) = primals, tangents
    triangle = _whole(rows)
    nothing = jnp.all(triangle == 0, axis=0)
    whole = triangle + jnp.diag(nothing.astype(triangle.dtype))
    product = rows.T @ changes
    solve = partial(jax.scipy.linalg.solve_triangular, whole, trans="T")
    both = solve(solve(product + product.T).T)
    return triangle, (jnp.triu(both) - jnp.diag(jnp.diag(both)) / 2) @ whole


def _padded(rows, count: int):
    """Rows and, where they are fewer than that, rows of zeros."""
    return jnp.pad(rows, ((0, max(0, count - rows.shape[0])), (0, 0)))


def solution(
    columns: Float[np.ndarray, "n k"],
    target: Float[np.ndarray, " n"],
    rank: float | None = None,
) -> Float[np.ndarray, " k"]:
    """Coefficients of least squares.

    **Arguments:** the columns; what they are to make up; and singular values over the
    largest, of columns of one size, below which these depend on others: rounding, by
    default.
    """
    # In other units columns are of any size, and small ones depend on none.
    size = np.linalg.norm(columns, axis=0)
    size = np.where(size > 0, size, 1.0)
    return np.linalg.lstsq(columns / size, target, rcond=rank)[0] / size


def root_of(weight: Float[Array, "*n"]) -> Float[Array, "*n"]:
    """The square root of weights, with the derivative 0 at 0: what has no weight, and
    may be anything, stays without."""
    counts = weight > 0
    return jnp.where(counts, jnp.sqrt(jnp.where(counts, weight, 1.0)), 0.0)


def column_lengths(matrix: Float[Array, "n k"]) -> Float[Array, " k"]:
    """Euclidean lengths of columns, 1 of those that are zero. Squares of what is small
    by its units alone are 0 in single precision."""
    largest = jnp.max(jnp.abs(matrix), axis=0)
    largest = jnp.where(largest > 0, largest, 1.0)
    lengths = largest * jnp.linalg.norm(matrix / largest, axis=0)
    return jnp.where(lengths > 0, lengths, 1.0)


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

    def step(carry, column):
        (basis, index), (vector, candidate) = carry, column
        size = jnp.linalg.norm(vector)
        left = vector - basis @ (basis.T @ vector)
        left = left - basis @ (basis.T @ left)  # again, or rounding stays behind
        length = jnp.linalg.norm(left)
        share = jnp.where(size > 0, length / jnp.where(size > 0, size, 1), 0.0)
        keep = candidate & (share > limit)
        direction = jnp.where(keep, left / jnp.where(length > 0, length, 1), 0.0)
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


def _check_problem(problem: Any) -> None:
    """Raise `InputError` for what is no factored problem, such as a recording."""
    if not isinstance(problem, LeastSquaresProblem):
        raise InputError(
            '`problem` must be a `LeastSquaresProblem`, as in `stats["problem"]` of '
            f"what `hystjax.identify` returns; got {described(problem)}. "
            "`hystjax.identify` and `hystjax.aliases` take recordings."
        )


def aliases(
    problem: LeastSquaresProblem, names: Sequence[str], tolerance: float = 0.01
) -> tuple[Alias, ...]:
    """Columns of a factored problem that are nearly combinations of columns before
    them.

    **Arguments:** the problem of k columns; the names of its terms; and the share of a
    column that must be new.

    **Returns:** one `Alias` for each that is not, in the order of the columns.

    **Raises:** `InputError` for a share that is none, and for a recording, of which
    `hystjax.aliases` tells the same.
    """
    _check_problem(problem)
    tolerance = checks.share("tolerance", tolerance)
    triangle = np.asarray(problem.triangle)
    lengths = np.linalg.norm(triangle, axis=0)
    lengths = np.where(lengths > 0, lengths, 1.0)
    columns = triangle / lengths  # whatever the units, none is small beside the others
    told_apart, found = [], []
    for j, column in enumerate(columns.T):
        basis, _ = np.linalg.qr(columns[:, told_apart])
        share = float(np.linalg.norm(column - basis @ (basis.T @ column)))
        if share > tolerance:
            told_apart.append(j)
            continue
        chosen, coefficients, share = _fewest(columns, j, tolerance)
        scales = lengths[j] / lengths[chosen]
        parts = zip((names[i] for i in chosen), coefficients * scales, strict=True)
        found.append(Alias(names[j], share, {name: float(c) for name, c in parts}))
    return tuple(found)


def _fewest(
    columns: np.ndarray, j: int, tolerance: float
) -> tuple[list[int], np.ndarray, float]:
    """The fewest columns before column j that make it up, added greedily and then
    pruned; how much of each; and the share that they miss."""
    target, before = columns[:, j], columns[:, :j]

    def explain(chosen):
        if not chosen:
            return np.zeros(0), target
        coefficients, *_ = np.linalg.lstsq(before[:, chosen], target, rcond=None)
        return coefficients, target - before[:, chosen] @ coefficients

    def share(chosen):
        return float(np.linalg.norm(explain(chosen)[1]))

    chosen: list[int] = []
    while share(chosen) > tolerance and len(chosen) < j:
        likeness = np.abs(before.T @ explain(chosen)[1])
        likeness[chosen] = -1
        chosen.append(int(np.argmax(likeness)))
    for i in tuple(chosen):
        fewer = [other for other in chosen if other != i]
        chosen = fewer if share(fewer) <= tolerance else chosen
    return chosen, explain(chosen)[0], share(chosen)


class Fit(eqx.Module):
    """Coefficients found by a regression, or along a path of several.

    **Attributes:**

    - `coefficients`: shape (k,), zero off the support.
    - `support`: which terms take part, shape (k,).
    - `num_steps`: regressions that were solved.
    """

    coefficients: Float[Array, "*paths k"]
    support: Bool[Array, "*paths k"]
    num_steps: Int[Array, "*paths"]


class AbstractRegression(eqx.Module):
    """Finds coefficients for a factored least-squares problem.

    Single problem in, single fit out; `jax.vmap` over the attributes, the problem or
    both gives paths, ensembles and batches.
    """

    @abstractmethod
    def fit(self, problem: LeastSquaresProblem) -> Fit:
        """Coefficients and support."""


class LeastSquares(AbstractRegression):
    """Ordinary least squares over all terms the data can tell apart.

    Terms that add nothing to those before them get the coefficient 0.
    """

    def fit(self, problem):
        _check_problem(problem)
        _, kept = novelty(problem)
        return Fit(problem.solve(kept), kept, jnp.array(1))


class Ridge(AbstractRegression):
    """Least squares with a penalty `ridge` times the sum of squared coefficients.

    **Attributes:**

    - `ridge`: at least 0; with `normalise` relative to the normalised problem.
    - `normalise`: whether columns and target are divided by their root mean squares
        and the squared residual by the number of rows, so that `ridge` has no unit.

    **Source:** Hoerl and Kennard (1970), doi 10.1080/00401706.1970.10488634.
    """

    ridge: ArrayLike = 1.0
    normalise: bool = eqx.field(static=True, default=True)

    def __check_init__(self):
        checks.positive("ridge", self.ridge, zero=True)

    def fit(self, problem):
        checks.number("ridge", self.ridge)
        inner, unit = scaled(problem, self.normalise)
        start = full_support(inner, self.ridge)
        solution = inner.solve(start, self.ridge)
        return Fit(solution * unit, start, jnp.array(1))


class STLSQ(AbstractRegression):
    """Sequentially thresholded least squares.

    Ridge regression, dropping terms with coefficients below the threshold, until none
    drops; then least squares without ridge on what is left. Terms that cannot be told
    apart are resolved by the ridge when it is positive, and else by dropping those that
    come later in the library.

    **Attributes:**

    - `threshold`: smallest magnitude kept. With `normalise` a share of the derivative's
        root mean square, meaning the same for every term; without, in each
        coefficient's own units.
    - `ridge`: as in `Ridge`.
    - `normalise`: as in `Ridge`.
    - `max_steps`: most regressions before the last.

    **Source:** Brunton, Proctor and Kutz (2016), doi 10.1073/pnas.1517384113. With
    `normalise=False`, and columns that the data tell apart, the results are those of
    PySINDy's `STLSQ`. Of columns that are equal, or a mix of others, PySINDy keeps all
    and shares the coefficient between them in the last regression; here the first has
    it, and the law is shorter and predicts the same. Without a ridge PySINDy compares
    the shares with the threshold, or what rounding makes of them, and may end with
    other terms altogether; here the later columns are left out from the start.
    """

    threshold: ArrayLike = 0.05
    ridge: ArrayLike = 0.0
    normalise: bool = eqx.field(static=True, default=True)
    max_steps: int = eqx.field(
        converter=partial(checks.count, "max_steps"), static=True, default=20
    )

    def __check_init__(self):
        checks.positive("threshold", self.threshold, zero=True)
        checks.positive("ridge", self.ridge, zero=True)

    def fit(self, problem):
        checks.number("threshold", self.threshold)
        checks.number("ridge", self.ridge)
        inner, unit = scaled(problem, self.normalise)
        support, num_steps = self._thresholded(jax.lax.stop_gradient(inner))
        _, told_apart = novelty(inner, support)
        return Fit(inner.solve(told_apart) * unit, told_apart, num_steps)

    def _thresholded(self, problem):
        def shrink(state):
            support, _, step = state
            large = jnp.abs(problem.solve(support, self.ridge)) >= self.threshold
            smaller = support & large
            return smaller, jnp.any(smaller != support), step + 1

        def unfinished(state):
            _, changed, step = state
            return changed & (step < self.max_steps)

        start = full_support(problem, self.ridge)
        state = (start, jnp.array(True), jnp.array(0))
        support, _, num_steps = jax.lax.while_loop(unfinished, shrink, state)
        return support, num_steps + 1


def full_support(problem, ridge):
    """All terms where a ridge makes the solution unique, else those told apart."""
    _, kept = novelty(problem)
    return jnp.where(jnp.asarray(ridge) > 0, True, kept)


def scaled(problem, normalise):
    """The problem in normalised columns, and the factor back to physical units."""
    _check_problem(problem)
    if not normalise:
        return problem, jnp.ones_like(problem.target)
    columns, size = problem.norms()
    columns = jnp.where(columns > 0, columns, 1.0)
    size = jnp.where(size > 0, size, 1.0)
    per_row = problem.rows**0.5
    inner = LeastSquaresProblem(
        problem.triangle / (columns * per_row),
        problem.target / (size * per_row),
        problem.remainder / (size * per_row),
        problem.rows,
    )
    return inner, size / columns


def threshold_path(
    regression: STLSQ, problem: LeastSquaresProblem, thresholds: Float[Array, " m"]
) -> Fit:
    """Fits for many thresholds, each as `regression` with that threshold would give.

    Thresholds that have come to the same support share its regression: the same as
    `jax.vmap` over thresholds, in a fraction of the time, since neighbours pass through
    the same supports.

    **Arguments:** the regression, whose own threshold is not used; the factored
    problem of k terms; and the thresholds, positive or zero, in any order.

    **Returns:** a `Fit` with leading axis m.
    """
    inner, unit = scaled(problem, regression.normalise)
    supports, num_steps = _supports(regression, inner, thresholds)

    def settle(state):
        coefficients, final, pending = state
        support = supports[jnp.argmax(pending)]
        alike = _alike(supports, support, pending)
        _, kept = novelty(inner, support)
        solution = inner.solve(kept) * unit
        return (
            jnp.where(alike[:, None], solution, coefficients),
            jnp.where(alike[:, None], kept, final),
            pending & ~alike,
        )

    nothing = jnp.zeros(supports.shape, problem.target.dtype)
    start = (nothing, supports, jnp.ones(len(thresholds), bool))
    coefficients, final, _ = jax.lax.while_loop(_any_pending, settle, start)
    return Fit(coefficients, final, num_steps)


def _supports(regression, problem, thresholds):
    """Supports after thresholding, and how many regressions each took."""
    first = full_support(problem, regression.ridge)
    every = jnp.broadcast_to(first, (len(thresholds), len(first)))

    def shrink(state):
        supports, steps, pending = state
        support = supports[jnp.argmax(pending)]
        alike = _alike(supports, support, pending)
        size = jnp.abs(problem.solve(support, regression.ridge))
        large = size >= thresholds[:, None]
        smaller = jnp.where(alike[:, None], supports & large, supports)
        steps = steps + alike
        changed = jnp.any(smaller != supports, axis=1)
        on = jnp.where(alike, changed & (steps < regression.max_steps), pending)
        return smaller, steps, on

    start = (every, jnp.zeros(len(thresholds), int), jnp.ones(len(thresholds), bool))
    supports, steps, _ = jax.lax.while_loop(_any_pending, shrink, start)
    return supports, steps + 1


def _any_pending(state) -> Bool[Array, ""]:
    return jnp.any(state[-1])


def _alike(supports, support, pending) -> Bool[Array, " m"]:
    """The pending thresholds that have this support."""
    return pending & jnp.all(supports == support, axis=1)


class NonNegative(AbstractRegression):
    """Least squares over all coefficients that are zero or more.

    What a sum of plays or relays with positive weights asks for, such as the model of
    Prandtl and Ishlinskii. Most coefficients come out as exactly 0, and their terms are
    off the support: near copies of one term, to which least squares gives large
    coefficients of both signs, do no harm, and no threshold is needed. Units of terms
    do not matter.

    Where terms depend on each other, several solutions may fit equally well; this is
    one of them, and of equal terms the first.

    Derivatives with respect to the problem are those of least squares on the support
    that was found.

    **Attributes:**

    - `max_steps`: most least-squares problems that are solved; by default 10 more than
        10 for each term, where 1 or 2 for each are usual. A fit whose `num_steps` comes
        to it may have been cut short: its coefficients are zero or more and those of
        least squares on their support, but not the best.

    **Source:** Lawson and Hanson, *Solving Least Squares Problems* (1995), chapter 23,
    doi 10.1137/1.9781611971217.
    """

    max_steps: int | None = eqx.field(
        converter=lambda most: (
            most if most is None else checks.count("max_steps", most)
        ),
        static=True,
        default=None,
    )

    def fit(self, problem):
        inner, unit = scaled(problem, True)
        bound = self.max_steps or 10 * (len(problem.target) + 1)
        found, num_steps = _active_set(jax.lax.stop_gradient(inner), bound)
        # The numbers of the search, which are not negative whatever the rounding, with
        # the derivative of least squares on their support.
        smooth = inner.solve(found > 0)
        solution = found + (smooth - jax.lax.stop_gradient(smooth))
        return Fit(solution * unit, found > 0, num_steps)


class _Search(NamedTuple):
    """Between two least-squares problems of the search.

    **Attributes:**

    - `best`: coefficients of least squares on their support, zero or more.
    - `misfit`: their |R x - q|.
    - `slopes`: how fast the misfit falls along each further term, times the misfit; 0
        for terms that may not enter.
    - `trial`: the support to be tried next: that of `best`, and the term `entering`,
        less those that had to leave for it.
    - `path`: coefficients on the way from `best` to least squares on `trial`.
    - `going`: whether there is a trial.
    - `steps`: problems solved.
    """

    best: Float[Array, " k"]
    misfit: Float[Array, ""]
    slopes: Float[Array, " k"]
    trial: Bool[Array, " k"]
    entering: Bool[Array, " k"]
    path: Float[Array, " k"]
    going: Bool[Array, ""]
    steps: Int[Array, ""]


def _active_set(
    problem: LeastSquaresProblem, max_steps: int
) -> tuple[Float[Array, " k"], Int[Array, ""]]:
    """The solution for normalised columns, and how many problems it took.

    Terms enter one by one, the one first along which the misfit falls fastest. Where
    least squares on the terms let in turns some negative, coefficients move towards it
    only until the first of them is 0, which leaves.
    """
    # In exact arithmetic a term that enters always lessens the misfit, so that no
    # support comes twice. Rounding can break that where little is left to be gained;
    # so a support is accepted only if the misfit has really fallen, and a term that
    # entered in vain is left alone until it has. That is why the search ends, and why
    # the method's two nested loops can be one, which suits `vmap` better.
    nothing = jnp.zeros_like(problem.target)
    no_term = jnp.zeros(len(nothing), bool)
    infinite = jnp.full((), jnp.inf, nothing.dtype)
    start = _Search(
        best=nothing,
        misfit=infinite,
        slopes=nothing,
        trial=no_term,
        entering=no_term,
        path=nothing,
        going=jnp.array(True),
        steps=jnp.array(0),
    )

    def unfinished(now):
        return now.going & (now.steps < max_steps)

    end = jax.lax.while_loop(unfinished, lambda now: _step(problem, now), start)
    return end.best, end.steps


def _step(problem: LeastSquaresProblem, now: _Search) -> _Search:
    """One least-squares problem further."""
    aim, misfit, slopes = _least_squares(problem, now.trial)
    moved, leaving = _towards(aim, now)
    arrived = ~jnp.any(leaving)
    better = arrived & (misfit < now.misfit)
    in_vain = arrived & ~better

    best = jnp.where(better, aim, now.best)
    others = jnp.where(in_vain & now.entering, 0.0, now.slopes)
    slopes = jnp.where(better, slopes, others)
    entering = _first_largest(slopes)
    anew = better | in_vain
    return _Search(
        best=best,
        misfit=jnp.where(better, misfit, now.misfit),
        slopes=slopes,
        trial=jnp.where(anew, (best > 0) | entering, now.trial & ~leaving),
        entering=jnp.where(anew, entering, now.entering),
        path=jnp.where(anew, best, moved),
        going=~anew | jnp.any(entering),
        steps=now.steps + 1,
    )


def _least_squares(problem: LeastSquaresProblem, support: Bool[Array, " k"]):
    """Coefficients on a support, their misfit, and the slopes of the other terms."""
    # The columns of the support come first and are made triangular, and everything is
    # rotated with them. What is below their rows is what they leave of the target and
    # of each term: with slopes of these parts alone, what is nearly explained does not
    # drown in the rounding of what is.
    k = len(support)
    order = jnp.argsort(~support)
    columns = (problem.triangle * support)[:, order]
    both = [columns, problem.target[:, None], problem.triangle]
    rotated = jnp.linalg.qr(jnp.column_stack(both), mode="r")
    triangle, target, terms = rotated[:, :k], rotated[:, k], rotated[:, k + 1 :]

    taken = support[order]
    triangle = jnp.where(taken, triangle, jnp.eye(k, dtype=triangle.dtype))
    solution = jax.scipy.linalg.solve_triangular(triangle, jnp.where(taken, target, 0))
    solution = jnp.zeros_like(target).at[order].set(solution)

    left = jnp.where(taken, 0.0, target)
    new = jnp.where(taken[:, None], 0.0, terms)
    share, slopes = jnp.linalg.norm(new, axis=0), left @ new
    epsilon = jnp.finfo(target.dtype).eps
    size = jnp.linalg.norm(problem.target) + jnp.sum(jnp.abs(solution))
    may_enter = (
        ~support
        & (share > rank_tolerance(target.dtype))
        & (slopes > 2 * k**0.5 * epsilon * size * share)
    )
    return solution, jnp.linalg.norm(left), jnp.where(may_enter, slopes, 0.0)


def _towards(aim, now: _Search) -> tuple[Float[Array, " k"], Bool[Array, " k"]]:
    """As far from `path` towards `aim` as no coefficient turns negative, and the terms
    that come to 0 there; none if `aim` has no such term."""
    falling = now.trial & (aim <= 0)
    slope = jnp.where(falling, now.path - aim, 0.0)
    reach = jnp.where(slope > 0, now.path / jnp.where(slope > 0, slope, 1.0), 0.0)
    share = jnp.min(reach, where=falling, initial=1.0)
    moved = now.path + share * (aim - now.path)
    leaving = falling & ((reach <= share) | (moved <= 0))
    return jnp.where(now.trial & ~leaving, moved, 0.0), leaving


def _first_largest(slopes: Float[Array, " k"]) -> Bool[Array, " k"]:
    """The largest if it is positive; the first of those equal but for rounding."""
    most = jnp.max(slopes)
    alike = slopes >= (1 - rank_tolerance(slopes.dtype)) * most
    return (jnp.arange(len(slopes)) == jnp.argmax(alike)) & (most > 0)
