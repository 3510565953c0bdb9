"""The best supports of one size on a factored least-squares problem, of equations or of
free runs close to one, and how often each is chosen when data are drawn again."""

import itertools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, TypeAlias

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ..._core.compiling import jit
from ...library import Library
from ...models import AbstractLaw, AbstractModel, AbstractSum, SparseModel
from ...refinement import (
    Objective,
    Samples,
    Squares,
    first_unknowns,
    free_of,
    linearised,
    parameters,
)
from ...regression import LeastSquaresProblem, compress
from ._choice import HARDLY, information_criterion, plainness

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
    # Columns of terms by which a law runs away may be too large to be squared: they are
    # of no use, and their gains not finite.
    with np.errstate(over="ignore", invalid="ignore"):
        new = columns - basis @ (basis.T @ columns)
        sizes, lengths = (np.linalg.norm(each, axis=0) for each in (new, columns))
        usable = sizes > np.finfo(sizes.dtype).eps ** 0.5 * lengths
        gains = np.abs(target @ new) / np.where(usable, sizes, 1.0)
    gains[[*support, *np.flatnonzero(~usable)]] = -np.inf
    for term in np.argsort(-gains)[: np.count_nonzero(np.isfinite(gains))].tolist():
        longer = tuple(sorted((*support, term)))
        yield longer, np.linalg.lstsq(columns[:, longer], target)[0]


class Choice(AbstractSum):
    """Some terms of a library, told by an array: laws of other terms are then other
    values of one compiled program, and a batch of them is fitted side by side.

    **Attributes:**

    - `library`: the k candidates.
    - `rows`: which of them, shape (s,).
    - `used`: whether each takes part, shape (s,); laws of fewer terms are padded.
    - `coefficients`: s scalars.
    - `known`: coefficients of a part that all have, shape (k,), if there is one.
    - `places`: of q numbers in the terms, such as radii, those that are fitted too,
        their places among the library's, shape (q,); beyond the last, of none.
    - `numbers`: these, q scalars.
    - `target`: what the law gives, the `"rate"` or the `"value"`; keyword only.
    """

    library: Library
    rows: Int[Array, " s"]
    used: Bool[Array, " s"]
    coefficients: tuple[Float[Array, ""], ...]
    known: Float[Array, " k"] | None = None
    places: Int[Array, " q"] | None = None
    numbers: tuple[Float[Array, ""], ...] = ()
    target: str = eqx.field(static=True, kw_only=True, default="rate")

    @property
    def memory(self):
        return self.moved().memory

    def made(self, w, m, now):
        library = self.moved()
        signals = library.memory.values(m, now)
        return library.weighted(self.spread(), w, now.u, now.du, signals)

    def moved(self) -> Library:
        """The candidates, with the numbers that are fitted."""
        if not self.numbers:
            return self.library
        every = self.library.numbers
        grid, numbers = (jnp.stack([*x]) for x in (every.values(), self.numbers))
        here = jax.nn.one_hot(self.places, len(grid), dtype=grid.dtype)
        new = jnp.where(jnp.sum(here, axis=0) > 0, numbers @ here, grid)
        return self.library.with_numbers(dict(zip(every, new, strict=True)))

    def spread(self) -> Float[Array, " k"]:
        """A coefficient for every candidate."""
        places = jax.nn.one_hot(self.rows, len(self.library)) * self.used[:, None]
        values = jnp.stack(self.coefficients)
        found = values @ places.astype(values.dtype)
        return found if self.known is None else found + self.known

    def parameters(self):
        every = (*self.coefficients, *self.numbers)
        return {str(i): value for i, value in enumerate(every)}

    def with_parameters(self, values):
        new = tuple((self.parameters() | dict(values)).values())
        size = len(self.coefficients)
        parts = new[:size], new[size:]
        return eqx.tree_at(lambda law: (law.coefficients, law.numbers), self, parts)

    def addends(self):
        weights = self.spread().tolist()
        return tuple(zip(weights, self.library.terms, strict=True))


Around: TypeAlias = Callable[[AbstractLaw], AbstractModel]


def itself(law: AbstractLaw) -> AbstractModel:
    """The model around a law of the recorded output: none."""
    return law


class OfValue(eqx.Module):
    """What makes a model of a law, of one that gives the value of its output.

    **Attributes:** `around`, which makes it of laws of the rate too.
    """

    around: Around

    def __call__(self, law: Any) -> AbstractModel:
        """The model around the law, which gives the value from now on."""
        return self.around(replace(law, target="value"))


@jit
def output_error(
    samples: Samples,
    library: Library,
    coefficients: Float[Array | np.ndarray, " k"],
    starts: Float[Array, " r"],
    outputs: Float[Array, "b r n"] | None = None,
    around: Around = itself,
    own: Mapping[str, Float[Array, ""]] | None = None,
) -> LeastSquaresProblem:
    """The misfit of the free run as a least-squares problem in the coefficients of all
    k candidates, about one law.

    Regressions of the derivative see noise that the free run averages out, and miss
    drifts that it adds up. Here the misfit itself is regressed on its sensitivities, so
    that the supports of least misfit can be looked for without simulating each.

    **Arguments:** what is matched; the candidates; and of the law the coefficients,
    zero for terms it does not have, and first outputs. These are free too. Of other
    `outputs` than those of the samples there are b problems, along a leading axis of
    `target` and `remainder`. Then the model `around` the law, and its `own` numbers by
    name, which are free as well.

    **Source:** Ljung (1999), System Identification, 2nd ed., section 10.2, ISBN
    0-13-656695-2: Gauss-Newton steps of output-error models.
    """
    law = SparseModel(library, coefficients, np.ones(len(library), bool))
    model = around(law).with_parameters(own or {})
    fitted = parameters(model, tuple(library.numbers), {}, {})
    objective = Objective(fitted, samples, Squares(), 1, 0.0, free_of(model))
    run = linearised(objective, first_unknowns(objective, starts))
    root = jnp.sqrt(samples.weight).ravel()
    jacobian = root[:, None] * run.jacobian
    terms = np.array([run.names.index(name) for name in library.names])
    others = np.setdiff1d(np.arange(len(run.names)), terms)
    by_terms = jacobian[:, terms]
    whole = jnp.concatenate([jacobian[:, others], by_terms], axis=1)
    r = len(others)

    def about(measured):
        misfit = root * (run.run.outputs - measured).ravel()
        problem = compress(whole, by_terms @ coefficients - misfit)
        # The rows below those of the others are what no choice of these can explain.
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


def inclusion(
    problems: LeastSquaresProblem,
    library: Library,
    supports: Sequence[Int[np.ndarray, "_m _s"]],
    samples: float,
    others: int,
) -> Float[np.ndarray, " k"]:
    """The share of problems in which each of k terms is in the support that is chosen
    by the extended Bayesian information criterion, as `ordered` chooses laws.

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
