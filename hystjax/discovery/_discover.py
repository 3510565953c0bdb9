"""From recordings to the terms of a law and their coefficients."""

import itertools
import math
import time
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PRNGKeyArray

from .. import refinement, regression
from .._core import checks
from .._core.errors import InputError
from .._core.progress import say
from .._core.solution import RESULTS, Solution, raise_unless_successful
from ..library import Library
from ..models import AbstractModel, SparseModel
from ..recording import Recording
from ..refinement import refine
from ..refinement._refine import fades, share
from ..refinement._steps import steps
from ..regression._regressors import (
    admitted,
    as_group,
    check,
    factor,
    told_apart,
    weak_form,
)
from ..regression.formulation import WeakForm
from . import _guesses, _trials, search
from ._guesses import Draws, Stage
from ._trials import Setting
from .search import Around, Support, Trial, information_criterion

Weights = list[Float[Array, " _n"]]


def discover(
    recordings: Recording | Sequence[Recording],
    library: Library,
    *,
    around: Around | None = None,
    size: float | None = None,
    key: PRNGKeyArray | None = None,
    starts: int = 8,
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

    A law may also be part of a larger model, such as a butterfly, of which only the
    output was recorded: `around` makes that model of a law. There is no derivative to
    regress then, and the first laws are found at random: those of all supports are
    fitted to thinned recordings from random coefficients. (Of sizes with more than 5000
    supports, those that add a term to one of the best of the size before.) All else is
    the same.

    **Arguments:**

    - `recordings`: one, or several of one device.
    - `library`: candidate terms. Of terms that this excitation cannot tell apart the
        first is tried; `stats["aliases"]` names the others.
    - `around`: the model that a law is part of, such as `lambda law:
        models.Butterfly(law, offset=-0.1)`; w in the law then stands for the law's own
        output. Its other parameters are fitted too, from the values given there.
    - `size`: with `around`, about the largest output of the law, from which random
        coefficients get their size.
    - `key`: with `around`, a `jax.random` key.
    - `starts`: with `around`, random coefficients that each law is fitted from.
    - `largest`: most terms of a law.
    - `width`: laws of each size that are refined at first.
    - `formulation`: the weak form; by default its test functions fit the distance of
        the input's turning points.
    - `fading`: as for `refine`; laws that keep more of a difference are refused. They
        may follow these recordings as well, and drift away on the next, which laws
        without memory, such as w' = 2 u', do not. Of hidden outputs it is not asked.
    - `seconds`: time after which no further laws are tried; the result then depends on
        the machine.
    - `progress`: whether to show on standard error how many laws were refined, where
        that is a terminal.
    - `throw`: whether to raise when no law is clearly better than a constant output, or
        to say so in `result`.

    **Returns:** a `Solution` whose `value` is a `SparseModel` over the library, or the
    model `around` it, and whose `stats` are those of `refine` for it, and

    - `candidates`: every `search.Trial` that was refined and not refused, the chosen
        one first, then by their criterion;
    - `frontier`: the best of each number of terms, by that number;
    - `alike`: those that the recordings hardly tell from the best, of a criterion less
        than 6 above the least;
    - `weights`: of the samples of each recording, as for `refine`, where the noise
        grows with the output; else `None`;
    - `aliases`: what the excitation cannot tell apart.

    `value.kind` says whether there is hysteresis in the law.

    **Raises:** `InputError` as `identify` does, for sizes below 1, and for an `around`
    without `size` and `key`; `ComputationError` when no law explains the output clearly
    better than a constant does.

    **Source:** Chen and Chen (2008), doi 10.1093/biomet/asn034; Kass and Raftery
    (1995), doi 10.1080/01621459.1995.10476572, for what is hardly told apart; Messenger
    and Bortz (2021), doi 10.1137/20M1343166.
    """
    checks.concrete("`discover`", recordings, size, key)
    end = time.monotonic() + seconds
    group = as_group(recordings)
    check(group, library)
    _check_sizes(largest=largest, width=width, starts=starts)
    draws = _draws(around, size, starts, key)
    weak = weak_form(group) if formulation is None else formulation
    library, group = admitted(library, group, weak)
    if draws is None:
        problem = factor(group, library, weak)
    else:
        problem = _guesses.blind(group, library, draws)
    kept = np.flatnonzero(np.asarray(told_apart(problem)))
    columns = problem.columns(kept)
    setting = Setting(
        group,
        refinement.samples(group, None, steps(group, None)),
        library.part(kept.tolist()),
        min(largest, len(kept)),
        width,
        share(fading),
        search.itself if around is None else around,
    )
    if draws is None:
        stages = _guesses.regressed(setting, columns)
    else:
        stages = _guesses.random(setting, columns, draws, end, progress)
    found = _chosen(setting, explore(setting, stages, end, progress))
    if found.substeps > setting.samples.substeps:
        # What was found needs more steps; so may what was passed over for want of them.
        setting = _laid_out(setting, None, found.substeps)
        found = _chosen(setting, explore(setting, stages, end, progress))
    weights = _weights(setting, found)
    if weights is not None:
        setting = _laid_out(setting, weights, setting.samples.substeps)
        trials = explore(setting, stages, end, progress)
        # None when the time is up, or all are refused.
        found = _chosen(setting, trials, weights) if trials else found
    stats = {
        "candidates": found.trials,
        "frontier": search.frontier(found.trials),
        "alike": search.alike(found.trials),
        "weights": found.weights,
        "aliases": regression.aliases(problem, library.names),
    }
    solution = _solution(setting, library, found, stats)
    return raise_unless_successful(solution) if throw else solution


def _check_sizes(**sizes: int) -> None:
    for name, value in sizes.items():
        if value < 1:
            raise InputError(f"`{name}` must be at least 1, got {value}.")


def _draws(around: Around | None, size, starts: int, key) -> Draws | None:
    """How the first laws are drawn, if they are."""
    if around is None:
        if size is not None or key is not None:
            raise InputError(
                "`size` and `key` are for random laws, and without `around` none are "
                "drawn: leave them out, or give the model that the law is part of."
            )
        return None
    if not callable(around):
        raise InputError(
            "`around` must be a function that makes a model of a law, such as "
            f"`models.Butterfly`; got {around!r}."
        )
    if size is None or key is None:
        raise InputError(
            "with `around` the output of the law is not recorded, and the first laws "
            "are drawn at random: give `size`, about the largest output of the law, "
            "and a `key`, such as `jax.random.key(0)`."
        )
    checks.positive("size", size)
    return Draws(size, starts, key)


def explore(
    setting: Setting, stages: Sequence[Stage], end: float, progress: bool
) -> tuple[Trial, ...]:
    """Refine the laws that are guessed, then around the best of each size those that
    the linearised free run ranks best, until no size has a new best.

    At first with the terms of low degree, of which so few are that little is missed;
    what they lead to is where the search among all terms goes on.

    **Arguments:** the first guesses; the time, of a monotonic clock, from which no more
    laws are tried; and whether to say how far it is.
    """
    tried: dict[Support, Trial] = {}
    for among, lists in stages:
        centred: set[Support] = set()
        guesses = _guesses.untried(lists, tried, setting.width)
        while guesses and time.monotonic() < end:
            tried = _trials.with_guesses(setting, tried, guesses)
            if progress:
                say(f"{len(tried)} laws refined")
            best = _trials.best(setting, tried)
            centres = [each for each in best if each.support not in centred]
            centred |= {centre.support for centre in centres}
            around = itertools.chain.from_iterable(
                _guesses.nearby(setting, among, centre) for centre in centres
            )
            guesses = _guesses.untried(around, tried, max(1, setting.width // 2))
    return tuple(trial for trial in tried.values() if _trials.admitted(setting, trial))


class _Found(NamedTuple):
    """What a search ends with: its laws, the chosen one first; that one refined to the
    end, or `None` where none is clearly better than a constant output; and the weights
    of the samples."""

    trials: tuple[Trial, ...]
    refined: Solution | None
    weights: Weights | None

    @property
    def substeps(self) -> int:
        """That the chosen law needs."""
        return 0 if self.refined is None else self.refined.stats["substeps"]


def _chosen(
    setting: Setting, trials: tuple[Trial, ...], weights: Weights | None = None
) -> _Found:
    """The law that is chosen out of those tried, refined to the end."""
    library = setting.library
    found = search.ordered(_judged(setting, trials), library)
    plainest = search.ordered((*found, _constant(setting, trials)), library)[0]
    if not plainest.terms:
        return _Found(found, None, weights)
    model = _model(setting, library, plainest)
    refined = refine(
        model,
        setting.group,
        # Radii, times and frequencies stay those of the candidates.
        fixed=[name for name in model.parameters() if name in library.numbers],
        weights=weights,
        fading=setting.fading if fades(model) else False,
        throw=False,
    )
    return _Found(found, refined, weights)


def _judged(setting: Setting, trials: tuple[Trial, ...]) -> list[Trial]:
    """The laws that were tried, with their criteria."""
    n, independent = _counts(setting, trials)
    others, candidates = setting.others(), len(setting.library)

    def criterion(trial):
        size, variance = len(trial.terms), trial.squares / n
        return information_criterion(
            variance, independent, size + others, size, candidates
        )

    return [replace(trial, criterion=criterion(trial)) for trial in trials]


def _constant(setting: Setting, trials: tuple[Trial, ...]) -> Trial:
    """Outputs that do not change, as a law of no terms."""
    n, independent = _counts(setting, trials)
    w, weight = np.asarray(setting.samples.w), np.asarray(setting.samples.weight)
    mean = np.sum(weight * w, 1) / np.sum(weight, 1)
    errors = np.where(weight > 0, w - mean[:, None], 0.0) ** 2
    squares = float(np.sum(weight * errors))
    criterion = information_criterion(squares / n, independent, len(mean), 0, 0)
    return Trial({}, criterion=criterion)


def _counts(setting: Setting, trials: tuple[Trial, ...]) -> tuple[int, float]:
    """The samples, and how many independent ones what the best trial leaves is."""
    n = sum(len(recording) for recording in setting.group)
    best = min(trials, key=lambda trial: trial.squares, default=None)
    return n, n if best is None else n * best.independent


def _weights(setting: Setting, found: _Found) -> Weights | None:
    """Of the samples of each recording, where the noise grows with the output."""
    if found.refined is None:
        return None
    residuals, used = found.refined.stats["residuals"], setting.samples.weight > 0
    independent = search.effective_samples(residuals, used)
    outputs = setting.samples.w + residuals
    weights = search.weights(outputs, residuals, used, independent)
    if weights is None:
        return None
    return [row[: len(r)] for row, r in zip(weights, setting.group, strict=True)]


def _laid_out(setting: Setting, weights: Weights | None, substeps: int) -> Setting:
    samples = refinement.samples(setting.group, weights, substeps)
    return setting._replace(samples=samples)


def _solution(setting: Setting, library: Library, found: _Found, stats) -> Solution:
    """What is returned: a law over the whole library, and what is known of it."""
    refined = found.refined
    if refined is None:
        nothing = _model(setting, library, Trial({}))
        return Solution(nothing, RESULTS.empty_support, stats)
    chosen = _model(setting, library, found.trials[0])
    value = chosen.with_parameters(refined.value.parameters())
    return Solution(value, refined.result, refined.stats | stats)


def _model(setting: Setting, library: Library, trial: Trial) -> AbstractModel:
    """A law over a library, and what is around it."""
    law = SparseModel(
        library,
        jnp.asarray(np.array([trial.terms.get(name, 0.0) for name in library.names])),
        np.array([name in trial.terms for name in library.names]),
    )
    # Inside of another model its output is its own, in a unit of its own.
    if setting.around is search.itself:
        first = setting.group[0]
        law = replace(law, names=first.names, units=first.units)
    own = {name: jnp.asarray(x) for name, x in trial.own.items()}
    return setting.around(law).with_parameters(own)
