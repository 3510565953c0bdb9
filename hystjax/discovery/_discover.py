"""From recordings to the terms of a law and their coefficients."""

import itertools
import math
import time
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .. import refinement, regression
from .._core import checks
from .._core.errors import InputError
from .._core.progress import say
from .._core.solution import RESULTS, Solution, raise_unless_successful
from ..library import Library
from ..models import SparseModel
from ..recording import Recording
from ..refinement import refine
from ..refinement._refine import share
from ..refinement._steps import steps
from ..regression import LeastSquaresProblem
from ..regression._regressors import (
    admitted,
    as_group,
    check,
    factor,
    told_apart,
    weak_form,
)
from ..regression.formulation import WeakForm
from . import _trials, search
from ._trials import Guess, Setting, Support, Trial
from .search import Candidate, information_criterion

Weights = list[Float[Array, " _n"]]


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
    and what looks best is refined in its turn, until no size has a better law: at first
    among terms of degree two and less, and from what that leads to among all. The
    extended Bayesian information criterion of the free run decides, in which correlated
    residuals count as fewer samples; of laws that it hardly tells from the best the
    plainest is chosen: of the fewest terms; if it can be, linear or rate independent;
    and of the lowest degrees. Where the noise grows with the output, the search is made
    again with samples weighed by the inverse of its variance. Nothing is random.

    **Arguments:**

    - `recordings`: one, or several of one device.
    - `library`: candidate terms. Of terms that this excitation cannot tell apart the
        first is tried; `stats["aliases"]` names the others.
    - `largest`: most terms of a law.
    - `width`: laws of each size that are refined at first.
    - `formulation`: the weak form; by default its test functions fit the distance of
        the input's turning points.
    - `fading`: as for `refine`; laws that keep more of a difference are refused. They
        may follow these recordings as well, and drift away on the next, which laws
        without memory, such as w' = 2 u', do not.
    - `seconds`: time after which no further laws are tried; the result then depends on
        the machine.
    - `progress`: whether to show on standard error how many laws were refined, where
        that is a terminal.
    - `throw`: whether to raise when no law is clearly better than a constant output, or
        to say so in `result`.

    **Returns:** a `Solution` whose `value` is a `SparseModel` over the library, and
    whose `stats` are those of `refine` for it, and

    - `candidates`: every `Candidate` that was refined and not refused, the chosen one
        first, then by their criterion;
    - `frontier`: the best of each number of terms, by that number;
    - `alike`: those that the recordings hardly tell from the best, of a criterion less
        than 6 above the least;
    - `weights`: of the samples of each recording, as for `refine`, where the noise
        grows with the output; else `None`;
    - `aliases`: what the excitation cannot tell apart.

    `value.kind` says whether there is hysteresis in the law.

    **Raises:** `InputError` as `identify` does; `ComputationError` when no law explains
    the output clearly better than a constant does.

    **Source:** Chen and Chen (2008), doi 10.1093/biomet/asn034; Kass and Raftery
    (1995), doi 10.1080/01621459.1995.10476572, for what is hardly told apart; Messenger
    and Bortz (2021), doi 10.1137/20M1343166.
    """
    checks.concrete("`discover`", recordings)
    end = time.monotonic() + seconds
    group = as_group(recordings)
    check(group, library)
    _check_sizes(largest, width)
    weak = weak_form(group) if formulation is None else formulation
    library, group = admitted(library, group, weak)
    problem = factor(group, library, weak)
    kept = np.flatnonzero(np.asarray(told_apart(problem)))
    reduced = library.part(kept.tolist())
    most = min(largest, len(kept))
    samples = refinement.samples(group, None, steps(group, None))
    setting = Setting(group, samples, reduced, most, width, share(fading))
    columns = problem.columns(kept)
    found = _chosen(setting, library, explore(setting, columns, end, progress))
    if found.stats.get("substeps", 0) > samples.substeps:
        # What was found needs more steps; so may what was passed over for want of them.
        samples = refinement.samples(group, None, found.stats["substeps"])
        setting = setting._replace(samples=samples)
        found = _chosen(setting, library, explore(setting, columns, end, progress))
    weights = _weights(setting, found)
    if weights is not None:
        weighted = refinement.samples(group, weights, setting.samples.substeps)
        setting = setting._replace(samples=weighted)
        trials = explore(setting, columns, end, progress)
        # None when the time is up, or all are refused.
        found = _chosen(setting, library, trials, weights) if trials else found
    aliases = regression.aliases(problem, library.names)
    solution = Solution(found.value, found.result, found.stats | {"aliases": aliases})
    return raise_unless_successful(solution) if throw else solution


def _chosen(
    setting: Setting,
    library: Library,
    trials: tuple[Trial, ...],
    weights: Weights | None = None,
) -> Solution:
    """The law that is chosen out of those tried, refined to the end."""
    found = search.ordered(candidates(setting, trials), library)
    stats: dict[str, Any] = {
        "candidates": found,
        "frontier": search.frontier(found),
        "alike": search.alike(found),
        "weights": weights,
    }
    group = setting.group
    plainest = search.ordered((*found, constant(setting, trials)), library)[0]
    if not plainest.terms:
        return Solution(_law(group, library, {}), RESULTS.empty_support, stats)
    chosen = _law(group, library, plainest.terms)
    refined = refine(
        chosen,
        group,
        # Radii, times and frequencies stay those of the candidates.
        fixed=[name for name in chosen.parameters() if name in library.numbers],
        weights=weights,
        fading=setting.fading,
        throw=False,
    )
    law = _law(group, library, refined.value.terms())
    return Solution(law, refined.result, refined.stats | stats)


def _weights(setting: Setting, found: Solution) -> Weights | None:
    """Of the samples of each recording, where the noise grows with the output."""
    if "residuals" not in found.stats:
        return None
    residuals, used = found.stats["residuals"], setting.samples.weight > 0
    independent = search.effective_samples(residuals, used)
    outputs = setting.samples.w + residuals
    weights = search.weights(outputs, residuals, used, independent)
    if weights is None:
        return None
    return [row[: len(r)] for row, r in zip(weights, setting.group, strict=True)]


def _check_sizes(largest: int, width: int) -> None:
    for name, value in (("largest", largest), ("width", width)):
        if value < 1:
            raise InputError(f"`{name}` must be at least 1, got {value}.")


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


def explore(
    setting: Setting, weak: LeastSquaresProblem, end: float, progress: bool
) -> tuple[Trial, ...]:
    """Refine the laws that the weak form ranks best, then around the best of each size
    those that the linearised free run ranks best, until no size has a new best.

    At first with the terms of low degree, of which so few are that little is missed;
    what they lead to is where the search among all terms goes on.

    **Arguments:** the factored weak form; the time, of a monotonic clock, from which no
    more are tried; and whether to say how far it is.
    """
    tried: dict[Support, Trial] = {}
    for among in _trials.nested(setting.library):
        centred: set[Support] = set()
        lists = _trials.best_guesses(weak, among, setting.largest, setting.width)
        guesses = _untried(lists, tried, setting.width)
        while guesses and time.monotonic() < end:
            tried = _trials.with_guesses(setting, tried, guesses)
            if progress:
                say(f"{len(tried)} laws refined")
            best = _trials.best(setting, tried)
            centres = [each for each in best if each.support not in centred]
            centred |= {centre.support for centre in centres}
            lists = itertools.chain.from_iterable(
                _nearby(setting, among, centre) for centre in centres
            )
            guesses = _untried(lists, tried, max(1, setting.width // 2))
    return tuple(trial for trial in tried.values() if _trials.admitted(setting, trial))


def _untried(lists: Iterable[Iterator[Guess]], tried, each: int) -> list[Guess]:
    """From each list so many of the first that were not tried."""
    seen, chosen = set(tried), []
    for guesses in lists:
        new = [*itertools.islice((g for g in guesses if g[0] not in seen), each)]
        seen |= {support for support, _ in new}
        chosen += new
    return chosen


def _nearby(setting: Setting, among, centre: Trial) -> Iterator[Iterator[Guess]]:
    """What promises to be better than a law, by the free runs close to it."""
    coefficients = np.zeros(len(setting.library))
    coefficients[list(centre.support)] = centre.coefficients
    dtype = setting.samples.w.dtype
    problem = search.output_error(
        setting.samples,
        setting.library,
        jnp.asarray(coefficients, dtype),
        jnp.asarray(centre.starts, dtype),
    )
    return _trials.around(problem, among, centre.support, setting.largest)


def candidates(setting: Setting, trials: tuple[Trial, ...]) -> Iterator[Candidate]:
    """The laws that were tried."""
    names, fixed = setting.library.names, len(setting.group)
    n, independent = _counts(setting, trials)
    for trial in trials:
        values = zip(trial.support, trial.coefficients, strict=True)
        terms = {names[row]: value for row, value in values}
        size = len(terms)
        criterion = information_criterion(
            trial.squares / n, independent, size + fixed, size, len(names)
        )
        yield Candidate(terms, trial.rmse, criterion, trial.kept)


def constant(setting: Setting, trials: tuple[Trial, ...]) -> Candidate:
    """Outputs that do not change, as a law of no terms."""
    n, independent = _counts(setting, trials)
    w, weight = np.asarray(setting.samples.w), np.asarray(setting.samples.weight)
    mean = np.sum(weight * w, 1) / np.sum(weight, 1)
    errors = np.where(weight > 0, w - mean[:, None], 0.0) ** 2
    squares, unweighted = float(np.sum(weight * errors)), float(np.sum(errors))
    criterion = information_criterion(squares / n, independent, len(mean), 0, 0)
    return Candidate({}, math.sqrt(unweighted / n), criterion)


def _counts(setting: Setting, trials: tuple[Trial, ...]) -> tuple[int, float]:
    """The samples, and how many independent ones what the best trial leaves is."""
    n = sum(len(recording) for recording in setting.group)
    best = min(trials, key=lambda trial: trial.squares, default=None)
    return n, n if best is None else n * best.independent
