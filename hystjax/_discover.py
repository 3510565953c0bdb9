"""From recordings to the terms of a law and their coefficients."""

import math
from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from . import _checks, refinement, regression, search
from ._errors import InputError
from ._explore import Setting, Trial, explore
from ._recording import Recording
from ._refine import refine, steps
from ._regressors import as_group, check, factor
from ._solution import RESULTS, Solution, raise_unless_successful
from .formulation import WeakForm
from .library import Library
from .models import SparseModel
from .regression import LeastSquaresProblem, novelty
from .search import Candidate, information_criterion

_NEW = 1e-5  # share of a term that must be new for it to be a candidate
_WIDTH = 0.4  # half width of test functions, in distances of turning points


def discover(
    recordings: Recording | Sequence[Recording],
    library: Library,
    *,
    largest: int = 4,
    width: int = 6,
    formulation: WeakForm | None = None,
    fading: bool | float = 0.1,
    seconds: float = math.inf,
    progress: bool = False,
    throw: bool = True,
) -> Solution:
    """Find the terms of a law, and its coefficients, in noisy recordings.

    Every support of up to `largest` terms is ranked on the weak form of the law, which
    never differentiates the output, and the best of each size are refined by trajectory
    matching, side by side. About the best law of each size the free run is then
    linearised in the coefficients of all candidates, every support is ranked on that,
    and what looks best is refined in its turn, until no size has a better law. The
    least extended Bayesian information criterion of the free run decides, in which
    correlated residuals count as fewer samples. Nothing is random.

    **Arguments:**

    - `recordings`: one, or several of one device.
    - `library`: candidate terms. Of terms that this excitation cannot tell apart the
        first is tried; `stats["aliases"]` names the others.
    - `largest`: most terms of a law.
    - `width`: laws of each size that are refined at first.
    - `formulation`: the weak form; by default its test functions fit the distance of
        the input's turning points.
    - `fading`: as for `refine`; laws that keep more of a difference are refused. They
        may follow these recordings as well, and drift away on the next.
    - `seconds`: time after which no further laws are tried; the result then depends on
        the machine.
    - `progress`: whether to show on standard error how many laws were refined, where
        that is a terminal.
    - `throw`: whether to raise when no law is better than a constant output, or to say
        so in `result`.

    **Returns:** a `Solution` whose `value` is a `SparseModel` over the library, and
    whose `stats` are those of `refine` for it, and

    - `candidates`: every `Candidate` that was refined and not refused, the best first;
    - `frontier`: the best of each number of terms, by that number;
    - `alike`: those that the recordings hardly tell from the chosen law, of a criterion
        less than 6 above its own (Kass and Raftery 1995, doi
        10.1080/01621459.1995.10476572);
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
    most = min(largest, len(kept))
    samples = refinement.samples(group, None, steps(group, None))
    setting = Setting(group, samples, reduced, most, width, fading)
    trials = explore(setting, problem.columns(kept), seconds, progress)
    found = _candidates(setting, trials)
    stats: dict[str, Any] = {
        "candidates": found,
        "frontier": search.frontier(found),
        "alike": search.alike(found),
        "aliases": regression.aliases(problem, library.names),
    }
    if not found or found[0].criterion >= _constant(group, trials):
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


def _candidates(setting: Setting, trials: tuple[Trial, ...]) -> tuple[Candidate, ...]:
    """The laws that were tried, the least criterion first."""
    share, names = _independent(trials), setting.library.names
    n = sum(len(recording) for recording in setting.group)
    found = []
    for trial in trials:
        values = zip(trial.support, trial.coefficients, strict=True)
        terms = {names[row]: value for row, value in values}
        criterion = information_criterion(
            trial.squares / n,
            n * share,
            len(terms) + len(setting.group),
            len(terms),
            len(names),
        )
        rmse = math.sqrt(trial.squares / n)
        found.append(Candidate(terms, rmse, criterion, trial.kept))
    return tuple(sorted(found, key=lambda candidate: candidate.criterion))


def _independent(trials: tuple[Trial, ...]) -> float:
    """The share of samples that are independent, from what the best trial leaves."""
    best = min(trials, key=lambda trial: trial.squares, default=None)
    return 1.0 if best is None else best.independent


def _constant(group, trials: tuple[Trial, ...]) -> float:
    """The criterion of outputs that do not change."""
    n = sum(len(recording) for recording in group)
    squares = sum(float(jnp.sum((r.w - jnp.mean(r.w)) ** 2)) for r in group)
    return information_criterion(
        squares / n, n * _independent(trials), len(group), 0, 0
    )


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
