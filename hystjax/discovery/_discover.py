"""From recordings to the terms of a law and their coefficients."""

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import ArrayLike, Float, Int, PRNGKeyArray

from .. import refinement, regression
from .._core import checks
from .._core.checks import InputError, warn
from .._core.show import quantity
from .._core.solution import (
    RESULTS,
    AbstractFindings,
    Solution,
    ended,
    raise_unless_successful,
)
from ..least_squares import rank_tolerance
from ..library import Library, Polynomial
from ..loops import reversals
from ..models import AbstractModel
from ..recording import Recording, as_group
from ..recording._as_measured import all_across, from_known, noise_on_all
from ..refinement import Refined
from ..refinement._certainty import steps, warn_of_lines, warn_of_steps
from ..refinement._refine import share
from ..regression import Alias, LeastSquaresProblem
from ..regression._identify import (
    NEW,
    admitted,
    check,
    factor,
    level,
    told_apart,
    weak_form,
)
from ..regression.formulation import AbstractFormulation, Direct
from . import _hidden, search
from ._choosing import (
    Found,
    as_refined,
    chosen,
    decided_by_blocks,
    elsewhere,
    model,
    wants_more,
    white,
)
from ._explore import Rows, best_of_each_size, explore, regressed, with_guesses
from ._hidden import Draws, Seen
from ._layout import NEAR, layout
from ._setting import (
    FEW,
    Setting,
    Weights,
    agree,
    changes_sign,
    fixed_part,
    nothing,
    own,
    signs_of,
    symmetric,
    with_part,
)
from .search import Around, Trial

_SURER = 3  # times fewer laws need be refined, where a hidden law is seen
_FINER = 2  # times more steps, for what is hidden has kinks of its own
_COARSE = 0.05  # of the range: few samples a cycle look like so much noise
_FARTHER = 1.02  # times: 0.2 % of noise on a sine of 600 samples a cycle does that
_FAST = 0.1  # of half cycles may be shorter than what samples are to be enough for
_ENOUGH, _KEPT = 100, 10_000  # samples, from one turning point to the next, and of all
_MANY = 50_000  # samples, with which a search takes a minute and more
_AGAIN = 2  # times, at most, for want of steps
_EITHER_SIDE = 0.1  # of how far a signal gets on one side of zero, on the other
_OF_VALUE = (
    "Laws of the value itself are found with `target='value'`, and fitted without a "
    "choice by `identify(recordings, library, formulation=formulation.Direct())`."
)


def discover(
    recordings: Recording | Sequence[Recording],
    library: Library | None = None,
    *,
    around: Around | None = None,
    target: str = "rate",
    size: float | None = None,
    key: PRNGKeyArray | None = None,
    starts: int = 8,
    largest: int = 6,
    width: int = 6,
    formulation: AbstractFormulation | None = None,
    weights: refinement.Weights | None = None,
    rate_independent: bool = False,
    odd: bool = False,
    signs: Mapping[str, float] | None = None,
    known: Mapping[str, float] | None = None,
    fading: bool | float = 0.1,
    guard: bool = True,
    seconds: float = math.inf,
    progress: bool = False,
    throw: bool = True,
) -> Solution:
    """Find the terms of a law, and its coefficients, in noisy recordings.

    Every support of a few terms is ranked on the weak form of the law, which never
    differentiates the output, or for laws of the value on the output itself; and the
    best of each size are refined by trajectory matching, side by side. About the best
    law of each size the free run is then linearised in the coefficients of all
    candidates, supports of about as many terms are ranked on that, and what looks best
    is refined in its turn, until no size has a better law: at first among terms of
    degree two and less, and from what that leads to among all. Sizes above four are
    looked at only where what is left is not white, or four terms are better than fewer.

    What the best law leaves decides how one is chosen. White residuals, or nearly white
    ones, are noise, and the extended Bayesian information criterion of the free run
    decides. Others, as all measured devices leave them sooner or later, are the law's
    own error: then free runs decide on blocks of the samples, each of a law refined
    without that block. Most devices are symmetric about zero: where input and output
    were recorded on both sides of it, the best laws of terms alone that change their
    sign with both are among these. Of three laws or more that are hardly told from the
    best, and of which no plainer one has more evidence, the one is chosen whose runs
    are nearest to those of the others where inputs are 1.5 times as large, three times
    or half as fast: their medoid. Of others it is the plainest, of the fewest terms,
    and of as many the one of most evidence. Laws that run away under these inputs, or
    where they run backwards, are refused. Of records without noise laws count as equal,
    by evidence, that leave less than what straight lines miss of a smooth input between
    its samples, than what the rounding of its samples takes, or than 1e-5 of the
    output's spread: degrees then decide.
    Where the noise grows with the output, the search is made again with samples weighed
    by the inverse of its variance. Nothing is random.

    Numbers in the terms, such as radii and time constants, are a grid on which laws are
    looked for. About the best of each size laws are tried whose numbers are fitted with
    their coefficients, and such as have one operator, between them, in place of two
    that are neighbours on the grid. Each number in a law makes it less plain, as a term
    does; one that is fitted is an unknown more, and what the grid offered in its place
    was no choice. Those of the law that is chosen are refined in any case.

    A law may also be part of a larger model, of which only the output was recorded:
    `around` makes that model of a law. Where input and output of the model tell those
    of the law up to a few numbers of the model (`hidden_signals`), as the forces in an
    `Oscillator` do, its equations are regressed for any such numbers, and only these
    are searched for: variable projection, without luck. Recordings then have to be
    evenly sampled. What a law gives less a share of what drives it may obey another
    law of as many terms, which with other numbers of the model is the same device: of
    hidden laws of as many terms that are hardly told apart degrees decide.

    Of others, such as a butterfly, there is no derivative to regress, and the first
    laws are found at random: those of all supports are fitted to thinned recordings
    from random coefficients. (Of sizes with more than 5000 supports, those that add a
    term to one of the best of the size before.) All else is the same.

    **Arguments:**

    - `recordings`: one, or several of one device.
    - `library`: candidate terms, `library.Polynomial(2)` by default. Of terms that this
        excitation cannot tell apart the first is tried, or where input and output were
        recorded on both sides of zero one that changes its sign with both;
        `stats["aliases"]` names the others. Terms of the output that several others
        make up together are tried after all others, where a law leaves noise.
    - `around`: the model that a law is part of, such as `lambda law:
        models.Butterfly(law, offset=-0.1)`; w in the law then stands for the law's own
        output. Its other parameters are fitted too, from the values given there.
    - `target`: what a law gives, the `"rate"` of its output or with `"value"` that
        itself, such as plays side by side, or the stops of an elastoplastic spring;
        inside of a larger model with an `around` that tells its law only. Terms of a
        value are of the input alone.
    - `size`: with an `around` that does not tell its law, about the largest output of
        that, from which random coefficients get their size; with others too, to draw
        the first laws at random all the same.
    - `key`: with `size`, a `jax.random` key.
    - `starts`: with `size`, random coefficients that each law is fitted from.
    - `largest`: most terms of a law; with `around`, four at most.
    - `width`: laws of each size that are refined at first; of hidden laws that are
        seen, a third as many.
    - `formulation`: what laws are ranked by; by default the weak form, with test
        functions that fit the distance of the input's turning points, and
        `formulation.Direct()` for laws of the value.
    - `weights`: of the samples, one array for each recording, shape (n,); or by what to
        weigh whole recordings, so that the largest does not rule: their `"range"`, or
        the `"noise"` on them.
    - `rate_independent`: whether only terms of degree one in the rate are tried, whose
        laws draw the same loop however fast.
    - `odd`: whether only terms are tried that change their sign with input and output,
        of devices whose loops are symmetric about zero.
    - `signs`: of coefficients where they are known, 1 or -1 by the name of the term,
        such as `{"w*|du|": -1}`; laws that have the term with the other are not tried.
    - `known`: a part of the law that is known, as coefficients by term, candidates or
        not, such as `{"w": -1 / tau}`. Only what is left of the output's derivative is
        explained; the part is in every law, fixed, and counts as none of its terms. Not
        with `around`.
    - `fading`: as for `refine`; laws that keep more of a difference are refused. They
        may follow these recordings as well, and drift away on the next, which laws
        without memory, such as w' = 2 u', do not. Of hidden outputs it is not asked.
    - `guard`: whether to refuse laws whose output leaves three times the recorded range
        under the larger, faster and slower inputs, or fifteen times where these run
        backwards; and of laws that noise alone tells apart such as run away under
        multisines, where another does not. Of hidden outputs it is not asked.
    - `seconds`: time after which no further laws are tried; the result then depends on
        the machine, and `why` says so.
    - `progress`: whether to show on standard error how many laws were refined, how many
        more are known of, and the best so far, on a terminal or in a notebook.
    - `throw`: whether to raise when no law is clearly better than a constant output, or
        to say so in `result`.

    **Returns:** a `Solution` whose `value` is a `SparseModel` over the library, or the
    model `around` it, and whose `stats` are those of `refine` for it, which need not
    have settled (`result` and `why` then say so), and

    - `candidates`: every `search.Trial` that was refined and not refused, the chosen
        one first, then those judged by blocks, then by their criterion;
    - `frontier`: the best of each number of terms, by that number;
    - `alike`: those that the recordings hardly tell from the best: of a criterion less
        than 2 above the least, or on blocks less than a standard error above the least
        and not twice that, and on all samples less than a tenth;
    - `apart`: by how much of the output's range, root mean square, the law differs
        from another that follows as well where inputs are 1.5 times as large, three
        times or half as fast, or multisines: what is not known there. A law that was
        found under a single sine is told by it. 0 without `guard`, and around;
    - `marked`: whether that is much, as `why` says: more than 5 % of the output's
        range, so that the law is not to be used there, or than 1 % and three standard
        errors of its own run there;
    - `noise_floor`: standard deviation of the white noise on the recorded output where
        it has a weight, in its units, by what changes from sample to sample as no
        smooth output does: what the best law would leave. Few samples a cycle make it
        too large;
    - `why`: what decided, and what was refused, in words;
    - `weights`: of the samples of each recording, as for `refine`, where they were
        given or the noise grows with the output; else `None`;
    - `aliases`: what the excitation cannot tell apart;
    - `signs`: those given, by the names that terms have in `value`; not told where none
        were.

    `value.kind` says whether there is hysteresis in the law. Where numbers have moved
    off the grid the terms of `value`, and of its library, are named by what they are
    now; those of trials by the grid, beside their `numbers`.

    **Raises:** `InputError` as `identify` does, for sizes below 1, for a formulation of
    another target, where no term is left to try, for signs and known parts that are
    none, for an `around` that does not tell its law without `size` and `key`, and for
    uneven samples with one that does;
    `ComputationError` when no law explains the output clearly better than a constant
    does, than the known part, or than the model around it does without a law (with
    `throw=False` that model is returned, its numbers refined).
    Warns of an output so far from zero that terms with w are as good as constant, of
    noise on an input, which laws take for travel, and of far more samples than loops
    need, with which a search takes as much longer.

    **Source:** Chen and Chen (2008), doi 10.1093/biomet/asn034; Kass and Raftery
    (1995), doi 10.1080/01621459.1995.10476572, and Breiman, Friedman, Olshen and Stone
    (1984), ISBN 0-412-04841-8, for what is hardly told apart; Roberts et al. (2017),
    doi 10.1111/ecog.02881, for blocks; Madigan and Raftery (1994), doi
    10.2307/2291017, for laws that a plainer one excludes; Bennett (1948), doi
    10.1002/j.1538-7305.1948.tb01340.x, for rounding; Messenger and Bortz (2021),
    doi 10.1137/20M1343166; Rice (1984), doi 10.1214/aos/1176346788, for the noise;
    Kaufman and Rousseeuw (1990), doi 10.1002/9780470316801, for the medoid.
    """
    checks.concrete("`discover`", recordings, size, key)
    checks.positive("seconds", checks.number("seconds", seconds), zero=True)
    checks.answers(rate_independent=rate_independent, odd=odd, guard=guard)
    checks.answers(progress=progress, throw=throw)
    end = time.monotonic() + seconds
    group = as_group(recordings, "discover(recordings, library)")
    given = None if weights is None else _given(group, weights)
    library = Polynomial(2) if library is None else library
    check(group, library)
    for name, value in (("largest", largest), ("width", width), ("starts", starts)):
        checks.count(name, value)
    _check_target(target)
    draws = _hidden.draws(around, target, library, size, starts, key)
    around = search.targeted(search.itself if around is None else around, target)
    recorded = search.alone(around)
    if recorded:
        # Runs begin and end there.
        group = all_across(group, given)
        _warn_of_record(group, target)
    elif given is not None:  # of a lead-in the outputs tell what a hidden law remembers
        group = tuple(map(from_known, group, given))
    how = _formulation(formulation, target, group)
    asked = signs_of(library, signs or {})
    library = symmetric(library, group, rate_independent, odd, target)
    library, part = _with_part(library, known or {}, recorded, asked)
    library, group = admitted(library, group, how)
    _check_clocks(group, library, part, around)

    problem, records = _regression(group, library, how, around, draws, given, target)
    mirrored = np.arange(0)
    if recorded and draws is None:
        mirrored = _mirrored(problem, library, part, group)
    order = _order(library, part, mirrored)
    names = [library.names[row] for row in order]
    aliases = regression.aliases(problem.columns(order), names)
    told, more = _tried(problem, library, part, recorded, order)
    _check_told(told, part, aliases, group)
    fixed = fixed_part(library, part)
    left = problem if fixed is None else problem.less(fixed)
    task = _Task(
        library, left, told, more, mirrored, draws, records, seconds, end, progress
    )
    guarded = guard and recorded
    substeps = (_FINER if records else 1) * steps(group, None)
    setting = Setting(
        group,
        layout(group, given, substeps, guarded),
        library.part(told.tolist()),
        largest=largest if recorded else min(FEW, largest),
        width=max(1, width // _SURER) if records else width,
        fading=share(fading),
        reach=NEAR if guarded else math.inf,
        around=around,
        signs=asked,
        known=part,
        weights=given,
    )
    last, found = _found(task, setting)
    if found.refined is not None:
        warn_of_steps(found.refined)
        warn_of_lines(group, found.refined)
    discovered = _discovered(last, library, found, aliases)
    # Free runs have judged the law, settled or not.
    if throw and not ended(discovered.result, RESULTS.nonlinear_max_steps_reached):
        raise_unless_successful(discovered, lambda each: each.why)
    return discovered.solution()


class _Task(NamedTuple):
    """What all searches of one call have in common: the terms, behind those of a known
    part; what they are regressed by, all of them; the rows of those that the recordings
    tell apart, which are tried, and with those that are tried too where a law leaves
    noise; and of those that change their sign with input and output, of which laws are
    tried too where none leaves noise; how laws of a hidden output are drawn, or the
    records that it is seen in; the time that there is, and when it ends; and whether to
    say how far it is."""

    library: Library
    problem: LeastSquaresProblem
    told: Rows
    more: Rows
    mirrored: Rows
    draws: Draws | None
    records: tuple[Seen, ...]
    seconds: float
    end: float
    progress: bool


def _found(task: _Task, setting: Setting) -> tuple[Setting, Found]:
    """What a search finds; another with the steps that its law needs, for so may what
    was passed over for want of them, and with more where no law explains the record,
    and once more if that leads to a law that needs more (but hidden laws are found
    without any); and with weights, where the noise turns out to grow with the
    output."""
    last, found = _found_once(task, setting)
    wanted = 0 if task.records else found.substeps
    for _ in range(_AGAIN):
        if wanted <= setting.layout.samples.substeps:
            break
        setting = _laid_out(setting, setting.weights, wanted)
        last, found = _better(task, (last, found), _found_once(task, setting))
        wanted = 0 if found.refined is None else found.refined.substeps
    by_variance = _by_variance(last, found) if setting.weights is None else None
    if by_variance is None:
        return last, found
    again = _laid_out(setting, by_variance, last.layout.samples.substeps)
    return _better(task, (last, found), _found_once(task, again))


def _better(
    task: _Task, before: tuple[Setting, Found], after: tuple[Setting, Found]
) -> tuple[Setting, Found]:
    """What another search found, unless that is no law and the one before found one:
    the time was up, or all were refused."""
    if after[1].refined is not None or before[1].refined is None:
        return after
    last, found = before
    return last, _in_time(task, found) if time.monotonic() >= task.end else found


def _in_time(task: _Task, found: Found) -> Found:
    """What was found before the time was up, which is said."""
    said = (
        f"The time was up when the search ended, `seconds={task.seconds:g}`: with "
        "more of it a better law may be found."
    )
    return found._replace(why=f"{found.why} {said}")


def _found_once(task: _Task, setting: Setting) -> tuple[Setting, Found]:
    """What one search finds."""
    last, tried = _searched(task, setting, task.told)
    # Of a law and noise plainness tells such terms, a law that is refused or not; next
    # to a law's own error what is new of them is nothing.
    if len(task.more) > len(task.told) and white(last, tried):
        # Anew: what was found without them would stand in their way.
        last, others = _searched(task, setting, task.more)
        supports = {trial.support for trial in others}
        tried = *others, *(each for each in tried if each.support not in supports)
    late = time.monotonic() >= task.end
    found = chosen(last, task.library, tried)
    return last, _in_time(task, found) if late else found


def _searched(
    task: _Task, setting: Setting, rows: Rows
) -> tuple[Setting, tuple[Trial, ...]]:
    """Every law that is tried among some terms. Of more than four terms laws are only
    where none of fewer leaves white noise, or by evidence four are better than fewer:
    what further terms would add is then wanted."""
    most = min(setting.largest, len(rows) - len(setting.known))
    setting = setting._replace(
        library=task.library.part(rows.tolist()),
        largest=min(FEW, most),
        room=most,
        odd=frozenset(),
    )
    problem = task.problem.columns(rows)
    tried = _explored(task, setting, problem)
    if setting.largest < most and wants_more(setting, tried):
        setting = setting._replace(largest=most)
        tried = _explored(task, setting, problem, tried)
    if len(task.mirrored) and decided_by_blocks(setting, tried):
        return _with_mirrored(task, setting, problem, rows, tried)
    return setting, tried


def _with_mirrored(
    task: _Task,
    setting: Setting,
    problem: LeastSquaresProblem,
    rows: Rows,
    tried: tuple[Trial, ...],
) -> tuple[Setting, tuple[Trial, ...]]:
    """The laws tried, and such of terms alone that change their sign with input and
    output, as the outputs of most devices do."""
    among = np.flatnonzero(np.isin(rows, task.mirrored))
    names = frozenset(setting.library.names[row] for row in among)
    setting = setting._replace(odd=names)
    stages = regressed(setting, problem, among)
    return setting, explore(setting, stages, task.end, task.progress, tried)


def _explored(
    task: _Task,
    setting: Setting,
    problem: LeastSquaresProblem,
    before: tuple[Trial, ...] = (),
) -> tuple[Trial, ...]:
    """Every law that is tried, from the first guesses on, and those tried before."""
    if task.draws is not None:
        stages = _hidden.random(setting, problem, task.draws, task.end, task.progress)
    elif task.records:
        stages = _hidden.projected(setting, task.records)
    else:
        rows = np.arange(len(setting.known), len(setting.library))
        stages = regressed(setting, problem, rows)
    tried = explore(setting, stages, task.end, task.progress, before)
    if not task.records or time.monotonic() >= task.end:
        return tried
    # Which of the laws that tell the same device was found is luck: plainness decides.
    guesses = [
        other
        for law in best_of_each_size(setting, tried)
        for other in _hidden.in_other_words(setting, task.records, law)
    ]
    every = {trial.support: trial for trial in tried}
    return tuple(with_guesses(setting, every, guesses).values())


def _by_variance(setting: Setting, found: Found) -> Weights | None:
    """Of the samples of each recording, where the noise grows with the output."""
    if found.refined is None:
        return None
    samples, residuals = setting.layout.samples, found.refined.residuals
    used = samples.weight > 0
    independent = np.sum(used) * search.independent_share(residuals, used)
    outputs = samples.w + residuals
    weights = search.weights(outputs, residuals, used, independent)
    if weights is None:
        return None
    return [row[: len(r)] for row, r in zip(weights, setting.group, strict=True)]


def _laid_out(setting: Setting, weights: Weights | None, substeps: int) -> Setting:
    beyond = math.isfinite(setting.reach)
    laid_out = layout(setting.group, weights, substeps, beyond)
    return setting._replace(layout=laid_out, weights=weights)


class Discovered(AbstractFindings):
    """A law that was found, and what else was tried.

    **Attributes:** the law, or the model around it, the `value`; how its refinement
    ended, or that there is none, the `result`; all others are what `discover` tells in
    `stats`, by the same names; and how it was `refined`, told among them.
    """

    value: AbstractModel
    result: RESULTS
    candidates: tuple[Trial, ...]
    frontier: dict[int, Trial]
    alike: tuple[Trial, ...]
    apart: float
    marked: bool
    noise_floor: float
    why: str
    weights: Sequence[Float[ArrayLike, " _n"]] | None
    aliases: tuple[Alias, ...]
    signs: Mapping[str, float] | None = None
    refined: Refined | None = None

    def stats(self) -> dict[str, Any]:
        """What is known of the search, and of the fit of the law."""
        known = super().stats()
        fit = known.pop("refined", None)
        return known if fit is None else fit.stats() | known

    @classmethod
    def of(cls, solution: Solution) -> "Discovered":
        """What such a `Solution` tells."""
        known = super().of(solution)
        if not Refined.told_by(solution):
            return known
        return replace(known, refined=Refined.of(solution))


def _discovered(
    setting: Setting, library: Library, found: Found, aliases: tuple[Alias, ...]
) -> Discovered:
    """What a search found, and what is known of it."""
    there = elsewhere(setting, library, found.trials, found.refined, aliases)
    value, result = _ended(setting, library, found, there.apart)
    return Discovered(
        value=value,
        result=result,
        candidates=found.trials,
        frontier=search.frontier(found.trials),
        alike=search.alike(found.trials),
        apart=there.apart,
        marked=there.marked,
        noise_floor=noise_on_all(setting.group, setting.layout.samples.weight),
        why=" ".join(filter(None, [found.why, there.in_words()])),
        weights=setting.weights,
        aliases=aliases,
        signs=_signs(setting, library, found) or None,
        refined=found.refined,
    )


def _ended(
    setting: Setting, library: Library, found: Found, distance: float
) -> tuple[AbstractModel, RESULTS]:
    """The law over the whole library, and how its refinement ended; or that there is
    none."""
    refined = found.refined
    if refined is None:
        without = model(setting, library, found.without)
        return without, RESULTS.no_law  # pyright: ignore[reportReturnType]
    value = as_refined(model(setting, library, found.trials[0]), refined).settled()
    known = refined.value.fitted_range
    if known is not None:
        known = replace(known, apart=distance)
    return value.fitted_on(known), refined.result


def _signs(setting: Setting, library: Library, found: Found) -> dict[str, float]:
    """Those asked for, by the names of terms in the law, whose numbers have moved."""
    if found.refined is None:
        return dict(setting.signs)
    law = as_refined(model(setting, library, found.trials[0]), found.refined)
    numbers = {k: x for k, x in law.parameters().items() if k in library.numbers}
    terms = library.with_numbers(numbers).settled_terms() or library.terms
    pairs = zip(library.names, terms, strict=True)
    return {term.name: setting.signs[k] for k, term in pairs if k in setting.signs}


# ------------------------------------------------------------- what is given, checked


def _formulation(
    formulation: AbstractFormulation | None, target: str, group: tuple[Recording, ...]
) -> AbstractFormulation:
    """What laws of a target are ranked by."""
    if formulation is None:
        return weak_form(group) if target == "rate" else Direct()
    of_rate = "formulation.WeakForm(20)"
    checks.kind("formulation", formulation, AbstractFormulation, of_rate)
    if formulation.target != target:
        example = of_rate if target == "rate" else "formulation.Direct()"
        raise InputError(
            f"`formulation` must be of the {target}, such as `{example}`, got "
            f"`{type(formulation).__name__}`. {_OF_VALUE}"
        )
    return formulation


def _warn_of_record(group: tuple[Recording, ...], target: str) -> None:
    """Warn of recordings that a search for a law of their output cannot use well."""
    _warn_of_sampling(group)
    if target == "rate":  # a law of the value has no terms of the output
        _warn_of_offset(group)


def _warn_of_offset(group: tuple[Recording, ...]) -> None:
    """Warn where terms of the output hardly differ from the same terms without it, and
    are no candidates beside those."""
    mean, spread = level(group)
    if spread > 2 * NEW * abs(mean):
        return
    unit = group[0].units[1]
    warn(
        f"the output is about {quantity(mean, unit, 3)} and changes by "
        f"{quantity(spread, unit, 2)} (standard deviation): terms with w can hardly be "
        "told from those without, and are left out. Take the offset from the output "
        "first.",
    )


def _warn_of_sampling(group: tuple[Recording, ...]) -> None:
    """Warn where inputs travel between their turning points and back by noise: terms of
    |u'| add all of that up; and of many more samples than loops need."""
    between = []
    for number, each in enumerate(group):
        u = np.asarray(each.u)
        if not np.ptp(u):
            continue
        found = reversals(each)
        rows = np.unique([0, *found.rows, len(u) - 1])
        between.append(np.quantile(np.diff(rows), _FAST))
        nodes = u[rows]
        travel, apart = (np.sum(np.abs(np.diff(x))) for x in (u, nodes))
        coarse = found.noise > _COARSE * np.ptp(u)
        if not coarse and travel > _FARTHER * apart > 0:
            warn(
                f"from sample to sample the input of recording {number} travels "
                f"{travel / apart:.3g} times as far as from one turning point to the "
                "next. If that is noise, laws take it for the input, and are wrong: "
                "smooth the input first, such as by `scipy.signal.savgol_filter` over "
                f"a third of the {len(u) // (len(nodes) - 1)} samples between turning "
                "points.",
            )
    samples, fewest = sum(map(len, group)), min(between, default=0.0)
    count = int(min(fewest / _ENOUGH, samples / _KEPT))
    if samples > _MANY and count > 1:
        warn(
            f"the search takes as long as there are samples, and there are {samples}, "
            f"some {fewest:.0f} and more from one turning point to the next. Means of "
            f"{count} in turn tell as much of loops: `recording.averaged({count})`."
        )


def _check_target(target: str) -> None:
    """Raise `InputError` for what no law gives."""
    if target not in ("rate", "value"):
        raise InputError(f"`target` must be 'rate' or 'value', got {target!r}.")


def _check_clocks(
    group: tuple[Recording, ...],
    library: Library,
    part: Mapping[str, float],
    around: Around,
) -> None:
    """Raise `InputError` where the model around a law cannot follow a recording, or
    terms of the known part are left out, for want of a clock."""
    if not search.alone(around):
        for each in group:
            around(nothing(library)).check_times(each.t, each.clocked)
    lost = [name for name in part if name not in library.names]
    if lost:
        raise InputError(
            f"`known` holds {lost}, which depend on the rate, and the recording has no "
            "clock: give the times."
        )


def _given(group: tuple[Recording, ...], weights: refinement.Weights) -> Weights:
    """The weights of the samples, of which some must count."""
    given = refinement.weights_of(group, weights)
    scored = sum(int(np.sum(np.asarray(each) > 0)) for each in given)
    checks.enough_samples("a law of samples of positive weight", scored, 9)
    return given


def _with_part(
    library: Library,
    known: Mapping[str, float],
    recorded: bool,
    signs: Mapping[str, float],
) -> tuple[Library, dict[str, float]]:
    """The candidates behind a part of the law that is known, which is to have the
    `signs` that are asked for."""
    if known and not recorded:
        raise InputError(
            "`known` is about laws of the recorded output, and `around` hides the law: "
            "leave one of them out."
        )
    library, part = with_part(library, known)
    for name in part.keys() & signs.keys():
        if not agree(part, {name: signs[name]}):
            raise InputError(
                f"`known` says {part[name]:g} for {name!r}, and `signs` "
                f"{signs[name]:g}: leave it out of one of them."
            )
    return library, part


# ------------------------------------------------------------- what is regressed


def _regression(
    group, library: Library, how: AbstractFormulation, around, draws, given, target
) -> tuple[LeastSquaresProblem, tuple[Seen, ...]]:
    """All terms as a factored problem: of what the law gives, or of a hidden law's
    output as far as the recordings tell it; and what they tell of that."""
    if draws is not None:
        return _hidden.blind(group, library, draws), ()
    if search.alone(around):
        scored = _scored(library, how, given)
        problem = factor(group, library, how, weights=scored)
        _check_finite(problem, library)
        return problem, ()
    numbers = own(around, library)
    if not numbers:
        raise InputError(
            "the model that `around` makes has no numbers but the law's, and there is "
            "nothing to search for: of the law itself leave `around` out, of a machine "
            "make one of its numbers a parameter."
        )
    records = _hidden.seen(group, around(nothing(library)), library, given, target)
    return _hidden.halfway(records, around, library, numbers), records


def _scored(
    library: Library, how: AbstractFormulation, given: Weights | None
) -> Weights | None:
    """1 for samples that have a weight and 0 for others, which are to tell nothing;
    `None` where all have one, or dropouts lie so close that few test functions see
    none."""
    if given is None:
        return None
    scored = [jnp.where(each > 0, jnp.ones_like(each), 0) for each in given]
    left = sum(np.count_nonzero(how.weights(each)) for each in scored)
    return scored if left > len(library) and not all(map(np.all, scored)) else None


def _check_finite(problem: LeastSquaresProblem, library: Library) -> None:
    """Raise `InputError` for candidates that a recording has no numbers of."""
    norms, _ = problem.norms()
    bad = [library.names[i] for i in np.flatnonzero(~np.isfinite(np.asarray(norms)))]
    if bad:
        raise InputError(
            f"`library` holds {', '.join(bad)}, NaN or inf somewhere on the recording: "
            "leave it out, or guard it with `jnp.where`."
        )


def _tried(
    problem: LeastSquaresProblem,
    library: Library,
    part: Mapping[str, float],
    recorded: bool,
    order: Rows,
) -> tuple[Int[np.ndarray, " told"], Int[np.ndarray, " more"]]:
    """The rows of terms that the recordings tell apart, those first in `order` of what
    is equal, and of those that are tried where a law leaves noise; those of the known
    part in both."""
    new = order[np.asarray(told_apart(problem.columns(order)))]
    told = np.union1d(np.arange(len(part)), new)
    # What others make up together, or nearly, is no mix of the few that a law has.
    more = _of_output_and_unlike(problem, library) if recorded else told
    return told, np.union1d(told, more)


def _about_zero(group: tuple[Recording, ...]) -> bool:
    """Whether inputs and outputs get to both sides of zero: of one alone nothing is
    symmetric about it."""
    for signals in ([each.u for each in group], [each.w for each in group]):
        every = np.concatenate([np.asarray(signal) for signal in signals])
        less, more = sorted((-np.min(every), np.max(every)))
        if not less > _EITHER_SIDE * more:
            return False
    return True


def _order(
    library: Library, part: Mapping[str, float], mirrored: Rows
) -> Int[np.ndarray, " k"]:
    """In which terms are told apart: those of the known part, then those that change
    their sign with input and output. Of terms of u' and |u'|, which are equal where the
    input only rises, the record says nothing, but symmetry does."""
    first = [*range(len(part)), *mirrored]
    return np.array([*first, *np.setdiff1d(np.arange(len(library)), first)])


def _mirrored(
    problem: LeastSquaresProblem,
    library: Library,
    part: Mapping[str, float],
    group: tuple[Recording, ...],
) -> Rows:
    """The rows, behind the known part, of terms that change their sign with input and
    output and that the recordings tell apart; none where all terms do, or the known
    part does not, or one side of zero alone was recorded."""
    if not _about_zero(group):
        return np.arange(0)
    change, known = changes_sign(library, group), len(part)
    if np.all(change) or not np.all(change[:known]):
        return np.arange(0)
    rows = np.flatnonzero(change)
    told = rows[np.asarray(told_apart(problem.columns(rows)))]
    return told[told >= known]


def _check_told(
    told: Rows,
    part: Mapping[str, float],
    aliases: Sequence[Alias],
    group: tuple[Recording, ...],
) -> None:
    """Raise `InputError` where no candidate is new beside the known part."""
    if len(told) > len(part):
        return
    said = ". ".join(str(alias) for alias in aliases[:3])
    width = max(float(np.ptp(np.asarray(each.u))) for each in group)
    beside = " that is new beside `known`" if part else ""
    raise InputError(
        f"`library` holds no term{beside} on these recordings: {said}. A play wider "
        f"than the input's range, which is {quantity(width, group[0].units[0], 3)}, "
        "never moves, for example. Give other candidates."
    )


def _of_output_and_unlike(problem: LeastSquaresProblem, library: Library) -> Rows:
    """The rows of terms of the output that are not zero, and equal to no other before.
    Not of the input alone: recorded, the sines that make its terms equal are not quite
    sines."""
    sizes = np.asarray(problem.norms()[0]) * problem.rows**0.5
    columns = np.asarray(problem.triangle) / np.where(sizes > 0, sizes, 1.0)
    apart = [
        np.linalg.norm(columns[:, :, None] + s * columns[:, None], axis=0)
        for s in (-1, 1)
    ]
    equal = np.minimum(*apart) <= rank_tolerance(columns.dtype)
    unlike = ~np.any(np.tril(equal, -1), axis=1) & (sizes > 0)
    return np.flatnonzero(unlike & [not term.driven for term in library.terms])
