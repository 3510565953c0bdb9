"""Laws worth trying, by linear least squares, and the same refined side by side."""

import math
from collections.abc import Iterable, Iterator
from functools import partial
from typing import NamedTuple, TypeAlias

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from .._core.jit import jit
from ..library import Kind, Library, kind
from ..recording import Recording
from ..refinement import (
    LevenbergMarquardt,
    Objective,
    Samples,
    Squares,
    Unknowns,
    minimise,
    parameters,
)
from ..regression import LeastSquaresProblem
from . import search

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


def best_guesses(
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


_ENOUGH = LevenbergMarquardt(rtol=1e-6)  # of the loss: to tell laws apart
_LANES = 8  # laws side by side: one compiled program for all
_STEPS = 8  # of the solver, in which most laws end
_TURNS = 4  # of so many steps, for those that do not
_FAR = 4.0  # times the squares of the best law of as many terms, to be given up
_GAIN = 0.99  # of the squares before, to be worth another turn


# A support, its coefficients, and the first outputs.
_Beginning: TypeAlias = tuple[Support, tuple[float, ...], tuple[float, ...]]


class Setting(NamedTuple):
    """What laws are tried on: recordings, also laid out as samples; the candidate
    terms; the most terms of a law; how many laws of each size are tried at first; and
    how much of a difference a law may keep, 0 for any."""

    group: tuple[Recording, ...]
    samples: Samples
    library: Library
    largest: int
    width: int
    fading: float


class Trial(NamedTuple):
    """A refined law: its terms by row of the library, their coefficients, the first
    outputs, the weighted sum of squared errors, how much of a difference in these is
    kept to the end, which share of its residuals is independent, and their root mean
    square."""

    support: Support
    coefficients: tuple[float, ...]
    starts: tuple[float, ...]
    squares: float
    kept: float
    independent: float
    rmse: float


def with_guesses(
    setting: Setting, tried: dict[Support, Trial], guesses: list[Guess]
) -> dict[Support, Trial]:
    """The laws tried, and guesses refined.

    Side by side with others, laws that take long would make these wait: they go on in
    further turns, as long as they get better and are not far behind.
    """
    tried = dict(tried)
    measured = tuple(np.asarray(setting.samples.w[:, 0]).tolist())
    beginnings = [(*guess, measured) for guess in guesses]
    for _ in range(_TURNS):
        slow = []
        for trial, steps in _turn(setting, beginnings):
            before = tried.get(trial.support)
            both = [trial] if before is None else [before, trial]
            tried[trial.support] = min(both, key=partial(_rank, setting))
            gained = before is None or trial.squares < _GAIN * before.squares
            if steps == _STEPS and gained:
                slow.append(trial)
        rivals = best(setting, tried)
        beginnings = [each[:3] for each in slow if not _behind(each, rivals)]
    return tried


def _rank(setting: Setting, trial: Trial) -> tuple[bool, float]:
    """The less, the better."""
    return not admitted(setting, trial), trial.squares


def _behind(trial: Trial, rivals: Iterable[Trial]) -> bool:
    """Whether a law of no more terms is far better."""
    size, squares = len(trial.support), trial.squares / _FAR
    return any(r.squares < squares and len(r.support) <= size for r in rivals)


def best(setting: Setting, tried: dict[Support, Trial]) -> list[Trial]:
    """The best law of each size."""
    best: dict[int, Trial] = {}
    for trial in sorted(tried.values(), key=lambda trial: trial.squares):
        if admitted(setting, trial):
            best.setdefault(len(trial.support), trial)
    return list(best.values())


def admitted(setting: Setting, trial: Trial) -> bool:
    """Whether the law fades, or has no memory, and so nothing to drift away with."""
    fades = not setting.fading or trial.kept < setting.fading
    terms = (setting.library.terms[row] for row in trial.support)
    bounded = fades or kind(terms) is Kind.MEMORYLESS
    return math.isfinite(trial.squares) and bounded


def _turn(setting: Setting, beginnings: list[_Beginning]):
    """Refine laws, in portions of one size, which is compiled once, and say in how many
    steps."""
    for first in range(0, len(beginnings), _LANES):
        portion = beginnings[first : first + _LANES]
        filled = portion + portion[:1] * (_LANES - len(portion))
        batch = _padded(filled, setting.largest)
        *ends, steps = jax.device_get(_refined(setting, *batch))
        for i, (support, *_) in enumerate(portion):
            yield _trial(support, [leaf[i] for leaf in ends]), int(steps[i])


def _trial(support: Support, end) -> Trial:
    coefficients, starts, *numbers = end
    values = tuple(coefficients[: len(support)].tolist())
    return Trial(support, values, tuple(starts.tolist()), *map(float, numbers))


def _padded(beginnings: Iterable[_Beginning], largest: int):
    """Rows, which of them are used, coefficients, and first outputs, one law a line."""
    supports, values, starts = zip(*beginnings, strict=True)
    sizes = np.array([len(support) for support in supports])
    used = np.arange(largest) < sizes[:, None]

    def filled(lines, dtype):
        whole = np.zeros(used.shape, dtype)
        whole[used] = np.concatenate(lines)
        return whole

    return filled(supports, int), used, filled(values, float), np.array(starts)


@jit
def _refined(
    setting: Setting,
    rows: Int[Array | np.ndarray, "m s"],
    used: Bool[Array | np.ndarray, "m s"],
    coefficients: Float[Array | np.ndarray, "m s"],
    starts: Float[Array | np.ndarray, "m r"],
):
    """For each law of a batch what a `Trial` holds, but for the support, and how many
    steps were made."""
    samples = setting.samples
    known = samples.weight > 0

    def fit(row, used, coefficients, starts):
        law = search.Choice(setting.library, row, used, tuple(coefficients))
        fitted = parameters(law, (), {}, {})
        objective = Objective(
            fitted, samples, Squares(), 1, setting.fading, True
        ).prepared()
        first = Unknowns(coefficients, starts[:, None, None])
        end = minimise(objective, first, _ENOUGH, _STEPS)
        run = objective.run(end.unknowns)
        outputs = run.outputs
        residuals = jnp.where(known, outputs - samples.w, 0.0)
        weighted = jnp.sqrt(samples.weight) * residuals
        squares = jnp.sum(weighted**2)
        squares = jnp.where(jnp.isfinite(squares), squares, jnp.inf)
        kept = jnp.exp(jnp.max(objective.gains(end.unknowns, run)))
        share = search.effective_samples(weighted, known) / jnp.sum(known)
        rmse = jnp.sqrt(jnp.sum(residuals**2) / jnp.sum(known))
        found = end.unknowns.values, outputs[:, 0], squares, kept, share, rmse
        return *found, end.num_steps

    return jax.vmap(fit)(rows, used, coefficients, starts)
