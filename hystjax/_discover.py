"""From recordings to the terms of a law and their coefficients."""

from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from . import _checks, regression, search
from ._errors import InputError
from ._recording import Recording
from ._refine import refine
from ._regressors import as_group, check, factor
from ._solution import RESULTS, Solution, raise_unless_successful
from .formulation import WeakForm
from .library import Library
from .models import SparseModel
from .refinement import LevenbergMarquardt
from .regression import LeastSquaresProblem, novelty
from .search import Candidate, information_criterion

_NEW = 1e-3  # share of a term that must be new for it to be a candidate
_ENOUGH = LevenbergMarquardt(rtol=1e-6)  # of the loss: to tell laws apart
_BEAM = 2000  # supports that are grown where there are too many to enumerate
_WIDTH = 0.4  # half width of test functions, in distances of turning points


def discover(
    recordings: Recording | Sequence[Recording],
    library: Library,
    *,
    largest: int = 4,
    width: int = 12,
    formulation: WeakForm | None = None,
    fading: bool = True,
    throw: bool = True,
) -> Solution:
    """Find the terms of a law, and its coefficients, in noisy recordings.

    Every support of up to `largest` terms is ranked on the weak form of the law, which
    never differentiates the output; the best of each size are refined by trajectory
    matching, side by side; and the least extended Bayesian information criterion of the
    free run decides. Nothing is random.

    **Arguments:**

    - `recordings`: one, or several of one device.
    - `library`: candidate terms. Of terms that this excitation cannot tell apart the
        first is tried; `stats["aliases"]` names the others.
    - `largest`: most terms of a law.
    - `width`: laws of each size that are refined.
    - `formulation`: the weak form; by default its test functions fit the distance of
        the input's turning points.
    - `fading`: whether laws that do not forget their initial value are refused.
    - `throw`: whether to raise when no law is better than a constant output, or to say
        so in `result`.

    **Returns:** a `Solution` whose `value` is a `SparseModel` over the library, and
    whose `stats` are those of `refine` for it, and

    - `candidates`: every `Candidate` that was refined, the best first;
    - `frontier`: the best of each number of terms, by that number;
    - `aliases`: what the excitation cannot tell apart.

    **Raises:** `InputError` as `identify` does; `ComputationError` when no law explains
    the output better than a constant does.

    **Source:** Chen and Chen (2008), doi 10.1093/biomet/asn034; Messenger and Bortz
    (2021), doi 10.1137/20M1343166.
    """
    group = as_group(recordings)
    check(group, library)
    _check_sizes(largest, width)
    weak = WeakForm(_half_width(group)) if formulation is None else formulation
    problem = eqx.filter_jit(factor)(group, library, weak)
    kept = np.flatnonzero(np.asarray(_new(problem)))
    reduced = Library(tuple(library.terms[i] for i in kept))
    rankings = _rankings(problem.columns(kept), min(largest, len(kept)), width)
    found = _candidates(group, reduced, _batch(rankings), fading)
    stats: dict[str, Any] = {
        "candidates": found,
        "frontier": search.frontier(found),
        "aliases": regression.aliases(problem, library.names),
    }
    if not found or found[0].criterion >= _constant(group):
        solution = Solution(_law(group, library, {}), RESULTS.empty_support, stats)
        return raise_unless_successful(solution) if throw else solution
    law = _law(group, library, found[0].terms)
    refined = refine(law, group, fading=fading, throw=throw)
    return Solution(
        _law(group, library, refined.value.terms()),
        refined.result,
        refined.stats | stats,
    )


def _check_sizes(largest: int, width: int) -> None:
    for name, value in (("largest", largest), ("width", width)):
        if value < 1:
            raise InputError(f"`{name}` must be at least 1, got {value}.")


def _half_width(group: tuple[Recording, ...]) -> int:
    """Of test functions, in samples, for the turning points of these inputs."""
    between = []
    for recording in group:
        _checks.enough_samples("`discover`", len(recording), 9)
        turns = len(recording.path.turning_points()[0])
        between.append(len(recording) / (turns + 1))
    return max(2, round(_WIDTH * min(between)))


@eqx.filter_jit
def _new(problem: LeastSquaresProblem):
    return novelty(problem, tolerance=_NEW)[1]


def _rankings(problem, largest: int, width: int) -> list[search.Ranking]:
    """The best supports of each size."""
    found, grown = [], None
    for size in range(1, largest + 1):
        rows = search.supports(len(problem.target), size, grown)
        best = search.ranking(problem, rows, max(width, _BEAM))
        grown = best.rows
        found.append(jax.tree.map(lambda leaf: leaf[:width], best))
    return found


def _batch(rankings: list[search.Ranking]):
    """Rows, which of them are used, and coefficients: all sizes as one batch."""
    most = rankings[-1].rows.shape[1]

    def padded(leaf):
        return jnp.pad(leaf, ((0, 0), (0, most - leaf.shape[1])))

    rows = jnp.concatenate([padded(r.rows) for r in rankings])
    used = jnp.concatenate([padded(jnp.ones_like(r.rows, bool)) for r in rankings])
    return rows, used, jnp.concatenate([padded(r.coefficients) for r in rankings])


def _candidates(group, library: Library, batch, fading: bool) -> tuple[Candidate, ...]:
    """Refine a batch of laws and sort them by their criterion."""
    rows, used, coefficients = batch
    weights, squares, exponents = _refined(
        group, library, rows, used, coefficients, fading
    )
    n = sum(len(recording) for recording in group)
    found = []
    for row, active, square, exponent in zip(
        np.asarray(weights), used, squares, exponents, strict=True
    ):
        terms = {
            name: float(c) for name, c in zip(library.names, row, strict=True) if c
        }
        forgets, size = bool(np.all(exponent < 0)), int(np.sum(active))
        if np.isfinite(square) and len(terms) == size and (forgets or not fading):
            criterion = information_criterion(
                float(square), n, size + len(group), size, len(library)
            )
            rmse = float((square / n) ** 0.5)
            found.append(Candidate(terms, rmse, criterion, forgets))
    return tuple(sorted(found, key=lambda candidate: candidate.criterion))


@eqx.filter_jit
def _refined(group, library, rows, used, coefficients, fading):
    """For each law of a batch its coefficients over the library, the squared error of
    its free run, and how fast it forgets."""

    def fit(row, takes_part, first):
        start = search.Choice(library, row, takes_part, tuple(first))
        solution = refine(
            start, group, fading=fading, solver=_ENOUGH, max_steps=40, throw=False
        )
        squares = jnp.sum(solution.stats["residuals"] ** 2)
        return solution.value.spread(), squares, solution.stats["fading"].exponent

    return jax.vmap(fit)(rows, used, coefficients)


def _constant(group) -> float:
    """The criterion of outputs that do not change."""
    n = sum(len(recording) for recording in group)
    squares = sum(float(jnp.sum((r.w - jnp.mean(r.w)) ** 2)) for r in group)
    return information_criterion(squares, n, len(group), 0, 0)


def _law(group, library: Library, terms: dict[str, float]) -> SparseModel:
    coefficients = np.array([terms.get(name, 0.0) for name in library.names])
    support = np.array([name in terms for name in library.names])
    first = group[0]
    return SparseModel(
        library,
        jnp.asarray(coefficients),
        support,
        names=first.names,
        units=first.units,
    )
