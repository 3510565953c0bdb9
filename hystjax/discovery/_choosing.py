"""Which of the laws that were tried is taken, and why; how far laws go apart under
inputs beyond the recorded ones, of which no output is known, has a part in it."""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from itertools import islice, product
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from .._core.checks import on_trial
from .._core.compiling import changed, in_order, jit
from .._core.show import quantity
from .._core.solution import RESULTS, ended
from ..library import Library
from ..models import AbstractModel, SparseModel
from ..recording._as_measured import noise_on_all
from ..refinement import (
    Objective,
    Refined,
    Squares,
    first_unknowns,
    free_of,
    known_to,
    parameters,
    refine,
)
from ..refinement._refine import fades
from ..regression import Alias
from . import _explore, search
from ._layout import Layout
from ._missing import missing
from ._setting import Setting, agree
from .search import Around, Trial, information_criterion

# Laws of each size that are judged by blocks, each of which is one more refinement.
_FINALISTS = 3
_MORE = 4  # times the steps, at most, that another search takes
# Of the squares that a constant leaves: more than that explains no record. Laws that
# are chosen for measured devices leave 1e-5 to 0.06, far below half of it.
_POOR = 0.25
_HOPELESS = 1.5  # times the least error, beyond which a law is none of these
# Share of residuals that is worth independent ones. Instruments correlate noise over a
# sample or two, a law's error lasts until the output turns: of measured devices it is
# 0.01 to 0.04. A test of whiteness alone would take one record in fifty for coloured
# that is not, for the best of many laws is fitted to its noise.
_COLOURED = 0.5


class Found(NamedTuple):
    """What a search ends with: its laws, the chosen one first; that one refined to the
    end, or `None` where none is clearly better than what there is `without` any; why
    that law, in words; and the steps a sample interval that a search should take."""

    trials: tuple[Trial, ...]
    refined: Refined | None
    without: Trial
    why: str
    substeps: int


def chosen(setting: Setting, library: Library, tried: tuple[Trial, ...]) -> Found:
    """The law that is chosen out of those tried, refined to the end.

    What the best law leaves decides how. Where that is nearly white, the record is a
    law and noise, and an information criterion weighs how much better a law fits
    against how many there were to choose from; of those that it hardly tells apart none
    is taken that runs away under other waveforms, as no device does, while another
    stays. Where it is not, no law is the device's, what they leave is their own error,
    and how well they will do elsewhere is seen on blocks of the samples that they are
    refined without; of those that blocks hardly tell apart, and of which no plainer one
    has more evidence, the one is taken that goes least its own way beyond the record.
    """
    trials = _not_refused(setting, tried)
    judged = _by_evidence(setting, trials)
    if trials and decided_by_blocks(setting, tried):
        judged = _by_blocks(setting, judged)
    far = partial(_distances, setting, library)
    # A hidden law is the same one in other words, but for how it starts.
    equal = search.HARDLY if setting.hidden else search.EQUAL
    while True:
        ranked = search.ordered(judged, setting.library, far, equal)
        best, laws = ranked[0], tuple(trial for trial in ranked if trial.terms)
        refined = _to_the_end(setting, best) if best.terms else None
        if refined is None or len(laws) == 1:
            break
        if _explore.stays(setting, _again(setting, best, refined)):
            break
        # With its last steps it has left what the others were allowed.
        judged = [trial for trial in judged if trial is not best]
    (without,) = (trial for trial in ranked if not trial.terms)
    said = [_why(setting, tried, ranked)]
    if refined is not None and not white(setting, ranked):
        said += missing(setting, best, refined)
    why = " ".join([*said, *_unsettled(refined)])
    substeps = _substeps_wanted(setting, tried, best, refined)
    return Found(laws, refined, without, why, substeps)


def _substeps_wanted(
    setting: Setting, tried: Sequence[Trial], best: Trial, refined: Refined | None
) -> int:
    """The steps a sample interval that another search should take: as many as the law
    that was chosen needs, or one that follows far better; and more where none explains
    the record, of laws of which some were lost."""
    substeps = 0 if refined is None else refined.substeps
    most = _MORE * setting.layout.samples.substeps
    others = [*_not_refused(setting, tried), *_straying(setting, tried)]
    follows = min(others, key=lambda trial: trial.squares, default=best)
    if follows.squares < best.squares / 2:
        # It was refused, or lost without a block: for want of steps, perhaps.
        needed = _to_the_end(setting, follows).substeps
        substeps = max(substeps, min(needed, most))
    constant = np.sum(_of_constants(setting)[1])
    lost = any(not trial.squares <= constant for trial in tried)
    if lost and not best.squares <= _POOR * constant:
        substeps = max(substeps, most)  # so may those be that explain the record
    return substeps


def _straying(setting: Setting, trials: Iterable[Trial]) -> list[Trial]:
    """Those that would be admitted, did they not run away."""
    return [
        each
        for each in trials
        if agree(each.terms, setting.signs)
        and _explore.forgets(setting, each)
        and not _explore.stays(setting, each)
    ]


def white(setting: Setting, trials: Sequence[Trial]) -> bool:
    """Whether the law that follows best leaves what looks like white noise, or nearly
    enough; or nothing that is known."""
    best = min(trials, key=lambda trial: trial.squares, default=None)
    if best is None:
        return False
    return best.independent >= _COLOURED or best.squares <= _uncertain(setting, trials)


def _uncertain(setting: Setting, trials: Sequence[Trial]) -> float:
    """The squares that are nothing, of clean records: what steps, the input between its
    samples and rounding leave uncertain. Laws that leave less are as good as each
    other."""
    samples = setting.layout.samples
    n, spread = float(samples.scored), float(samples.spread)
    least = min(trial.squares for trial in trials)
    left = math.sqrt(least / n) / spread
    return n * (spread * known_to(setting.group, left)) ** 2


def _not_refused(setting: Setting, tried: Sequence[Trial]) -> tuple[Trial, ...]:
    return tuple(each for each in tried if _explore.admitted(setting, each))


def wants_more(setting: Setting, tried: Sequence[Trial]) -> bool:
    """Whether laws of more terms than were tried may be better: what the best leaves is
    no noise; or it is, and the best by evidence has as many terms as were tried."""
    trials = _not_refused(setting, tried)
    if not white(setting, trials):
        return True
    best = min(_by_evidence(setting, trials), key=lambda trial: trial.criterion)
    return len(best.terms) == setting.largest


def decided_by_blocks(setting: Setting, tried: Sequence[Trial]) -> bool:
    """Whether free runs on blocks decide: what the best law leaves is no noise, and
    there are blocks to leave out."""
    trials = _not_refused(setting, tried)
    return not white(setting, trials) and setting.layout.count > 1


def _by_evidence(setting: Setting, trials: tuple[Trial, ...]) -> list[Trial]:
    """The laws that were tried, and what there is without any, with their criteria."""
    n = float(setting.layout.samples.scored)  # those of no weight are none
    best = min(trials, key=lambda trial: trial.squares, default=None)
    independent = n if best is None else n * best.independent
    others, candidates = setting.others(), setting.candidates
    off_grid = search.laws_off_grid(candidates)
    known = _uncertain(setting, trials) if trials else 0.0

    def criterion(trial):
        (size, numbers), variance = trial.size, max(trial.squares, known) / n
        laws = off_grid[size] if numbers else math.comb(len(candidates), size)
        unknowns = size + numbers + others
        return information_criterion(variance, independent, unknowns, laws)

    each = [*trials, _without_law(setting, trials)]
    return [replace(trial, criterion=criterion(trial)) for trial in each]


def _without_law(setting: Setting, trials: Sequence[Trial]) -> Trial:
    """What there is without any term that was found: what is known of the law, the
    model around it, or a constant output."""
    if not _has_rest(setting):
        return Trial({}, squares=float(np.sum(_of_constants(setting)[1])))
    own = setting.own()
    # A law may hold part of what then is the model's to hold: from there it is far.
    laws = search.frontier(sorted(trials, key=lambda trial: trial.squares))
    near = [trial.own for trial in laws.values()] if own else []
    guesses = [Trial({}, own=each) for each in (own, *near)]
    ends = _explore.refined(setting, guesses, _explore.ENOUGH)
    return min((end for end, _ in ends), key=lambda trial: trial.squares)


def _has_rest(setting: Setting) -> bool:
    """Whether more than a constant is left without any term: a known part of the law,
    or numbers of the model around it."""
    return bool(setting.known or setting.own())


def _of_constants(setting: Setting):
    """The weights of the samples, and so weighted the squared errors of outputs that do
    not change, shape (R, n) each."""
    samples = setting.layout.samples
    w, weight = np.asarray(samples.w), np.asarray(samples.weight)
    total = np.sum(weight, 1)  # of a recording that is left out 0
    mean = np.sum(weight * w, 1) / np.where(total > 0, total, 1.0)
    return weight, np.where(weight > 0, weight * (w - mean[:, None]) ** 2, 0.0)


def _by_blocks(setting: Setting, judged: list[Trial]) -> list[Trial]:
    """The laws and what there is without any, the best of each size, and of such as
    are odd, with their errors on blocks left out."""
    laws = [trial for trial in judged if trial.terms]
    odd = [trial for trial in laws if setting.odd.issuperset(trial.terms)]
    both = {law.support: law for law in (*_finalists(laws), *_finalists(odd))}
    finalists = [*both.values()]
    (without,) = (trial for trial in judged if not trial.terms)
    # It has to follow best of all, and its evidence excludes no law.
    without = replace(without, criterion=math.inf)
    if _has_rest(setting):
        (without,) = _explore.left_out(setting, [without])
    else:
        # Means of whole recordings: a constant that is not told what a block is leaves
        # more there, and laws are to be better than one that is.
        weight, squares = _of_constants(setting)
        inside = [setting.layout.blocks == each for each in range(setting.layout.count)]
        errors = [np.sqrt(np.sum(squares[b]) / np.sum(weight[b])) for b in inside]
        without = replace(without, blocks=tuple(map(float, errors)))
    supports = {(), *(trial.support for trial in finalists)}
    rest = [trial for trial in judged if trial.support not in supports]
    return [without, *_explore.left_out(setting, finalists), *rest]


def _finalists(laws: Sequence[Trial]) -> list[Trial]:
    """The best of each size, of laws that are not hopelessly behind the best."""
    found: list[Trial] = []
    for trial in sorted(laws, key=lambda trial: trial.squares):
        rivals = sum(each.size == trial.size for each in found)
        close = trial.squares <= _HOPELESS**2 * (found or [trial])[0].squares
        if rivals < _FINALISTS and close:
            found.append(trial)
    return found


def _to_the_end(setting: Setting, trial: Trial) -> Refined:
    # Its numbers, too, are now fitted.
    trial = _explore.free(setting, trial, trial.numbers)
    law = model(setting, setting.library, trial)
    known = {*setting.known, *setting.library.numbers} - trial.numbers.keys()
    bounds = {
        name: (0.0, math.inf) if sign > 0 else (-math.inf, 0.0)
        for name, sign in setting.signs.items()
        if name in trial.terms
    }
    with on_trial():
        fit = refine(
            law,
            setting.group,
            fixed=[name for name in law.parameters() if name in known],
            bounds=bounds or None,
            weights=setting.weights,
            fading=setting.fading if fades(law) else False,
            throw=False,
        )
    return Refined.of(fit)


def _again(setting: Setting, trial: Trial, refined: Refined) -> Trial:
    """The law as it was refined to the end, as a trial."""
    law = as_refined(model(setting, setting.library, trial), refined)
    values = {name: float(x) for name, x in law.parameters().items()}
    terms = {name: values.get(name, x) for name, x in trial.terms.items()}
    own = {name: values.get(name, x) for name, x in trial.own.items()}
    starts = tuple(np.asarray(refined.w0).tolist())
    guess = _explore.free(setting, Trial(terms, own=own, starts=starts), values)
    ((end, _),) = _explore.refined(setting, [guess], _explore.ENOUGH)
    (end,) = _explore.looked_beyond(setting, [end])
    return end


def as_refined(law: AbstractModel, refined: Refined) -> AbstractModel:
    """A law with the numbers that it has after a refinement, whose own names show
    them; and with the names and units of what it was refined on."""
    fit = refined.value
    pairs = zip(law.parameters(), fit.parameters().values(), strict=True)
    law = law.with_parameters(dict(pairs))
    return changed(law, names=fit.names, units=fit.units)


def model(setting: Setting, library: Library, trial: Trial) -> AbstractModel:
    """A law over a library, and what is around it."""
    terms = {**setting.known, **trial.terms}
    law = SparseModel(
        library.with_numbers(trial.numbers),
        jnp.asarray(np.array([terms.get(name, 0.0) for name in library.names])),
        np.array([name in terms for name in library.names]),
    )
    # Inside of another model its output is its own, in a unit of its own.
    if setting.recorded:
        first = setting.group[0]
        law = replace(law, names=first.names, units=first.units)
    own = {name: jnp.asarray(x) for name, x in trial.own.items()}
    return setting.around(law).with_parameters(own)


# ----------------------------------------------------------------------- in words


def _why(setting: Setting, tried: tuple[Trial, ...], ranked: tuple[Trial, ...]) -> str:
    """How it came to this law."""
    unit = setting.group[0].units[1]
    best, others = ranked[0], search.alike(ranked)
    refused = _refused(setting, tried, best, unit)
    if not best.terms:
        return " ".join([_no_law(setting, best), *refused])
    said = [_by_what(setting, ranked, unit)]
    if others:
        contenders, near = search.contenders(ranked), len(others) + 1
        of = "it"
        if len(contenders) < near:
            of = (
                f"{near - len(contenders)} have less evidence than a plainer one; of "
                "the others it"
            )
        one = "the plainest"
        if not best.blocks and any(sum(x.size) < sum(best.size) for x in contenders):
            one += " of those that do not run away under other waveforms"
        if runs_decide(setting, contenders):
            one = (
                "the one that goes least its own way under larger, faster and slower "
                "inputs"
            )
        said.append(f"Of {near} laws that this hardly tells apart {of} is {one}.")
    return " ".join([*said, *refused])


def _no_law(setting: Setting, best: Trial) -> str:
    """That what there is without any law is as good."""
    if not setting.own():
        other = "what is known of it" if setting.known else "a constant"
        return f"No law explains the output clearly better than {other} does."
    own = ", ".join(f"{name} = {x:.4g}" for name, x in best.own.items())
    return (
        "No law explains the output clearly better than the model around it does "
        f"without one, with {own}: nothing tells of hysteresis."
    )


def _unsettled(refined: Refined | None) -> list[str]:
    """Whether coefficients still moved when the last refinement ended."""
    if refined is None:
        return []
    if not ended(refined.result, RESULTS.nonlinear_max_steps_reached):
        return []
    return [
        f"After {int(refined.num_steps)} steps of its last refinement its "
        "coefficients still moved: take them, and their standard errors, with care."
    ]


def _by_what(setting: Setting, ranked: tuple[Trial, ...], unit: str) -> str:
    if not ranked[0].blocks:
        exact = _uncertain(setting, ranked)
        if not white(setting, ranked):
            return (
                "What the laws leave is no white noise, but the recordings are too "
                "short to leave blocks out: the information criterion decides, by as "
                "many samples as are independent."
            )
        if min(trial.squares for trial in ranked) > exact:
            return (
                "What the laws leave looks like white noise, so that the information "
                "criterion decides."
            )
        known = math.sqrt(exact / float(setting.layout.samples.scored))
        return (
            f"What the best law leaves, {quantity(ranked[0].rmse, unit, 2)}, is less "
            f"than the {quantity(known, unit, 2)} to which the recorded samples tell "
            "the output, so that the information criterion decides."
        )
    judged = [trial for trial in ranked if trial.blocks]
    best = min(judged, key=lambda trial: trial.unseen)
    count = len(best.blocks)
    unsure = float(f"{np.std(best.blocks, ddof=1) / math.sqrt(count):.1g}")
    missed = ranked[0].rmse
    # Few samples a cycle look like noise: of more than is missed nothing is known.
    floor = noise_on_all(setting.group, setting.layout.samples.weight)
    noise = min(floor, missed)
    return (
        "What the laws leave is no white noise but their own error, so that free runs "
        f"decide, on {count} blocks that each law was refined without: "
        f"{quantity(ranked[0].unseen, unit, 3)} for this one, {best.unseen:.3g} ± "
        f"{quantity(unsure, unit, 3)} for the best, of {len(best.terms)} terms. "
        f"On all samples it misses {quantity(missed, unit, 3)}, of which the "
        f"noise is {quantity(noise, unit, 2)} at most."
    )


def _refused(
    setting: Setting, tried: tuple[Trial, ...], best: Trial, unit: str
) -> Iterator[str]:
    """What is said of laws that follow better, but are not to be trusted."""
    better = [trial for trial in tried if trial.squares < best.squares]
    agreeing = [each for each in better if agree(each.terms, setting.signs)]
    against = [each for each in better if not agree(each.terms, setting.signs)]
    keeping = [each for each in agreeing if not _explore.forgets(setting, each)]
    kept, lost = "do not forget how they began", "run away beyond the recorded input"
    both = [each for each in keeping if not _explore.stays(setting, each)]
    keeping = [each for each in keeping if _explore.stays(setting, each)]
    straying = _straying(setting, agreeing)
    for each, fault, option in (
        (against, "have a term of the other sign", "signs=None"),
        (keeping, kept, "fading=False"),
        (straying, lost, "guard=False"),
        (both, f"{kept} and {lost}", "fading=False, guard=False"),
    ):
        if each:
            least = quantity(min(trial.rmse for trial in each), unit, 3)
            yield (
                f"{len(each)} that follow better, down to {least}, were refused, for "
                f"they {fault} (`{option}` admits them)."
            )


_EVIDENCE = 6.0  # difference of criteria, below which evidence is not strong
_AS_WELL = 1.1  # times the squares, to follow as well
_AT_ONCE = 8  # laws, so that one program serves any number
# Of the output's range, by which laws are not the same; and less, with so many standard
# errors. Of measured devices laws that follow as well are 0.2 % apart, or 80 %: half
# and twice of either mark the same.
_MUCH, _LITTLE, _ERRORS = 0.05, 0.01, 3.0
_RUNS_AWAY = 5.0  # times the reach: laws that do get much farther
_TOGETHER = 40  # laws with several terms under other names


def _distances(
    setting: Setting, library: Library, near: Sequence[Trial]
) -> list[float]:
    """How far laws go that are hardly told apart; one that goes least far is taken."""
    if any(trial.blocks for trial in near):
        return from_the_others(setting, library, near)
    return running_away(setting, library, near)


def runs_decide(setting: Setting, near: Sequence[Trial]) -> bool:
    """Whether runs tell which of some laws is the middle one: of two neither is."""
    judged = all(trial.blocks and trial.terms for trial in near)
    return setting.layout.outside is not None and judged and len(near) > 2


def from_the_others(
    setting: Setting, library: Library, near: Sequence[Trial]
) -> list[float]:
    """How far each of some laws goes from the others, summed over these: root mean
    square distances, over the range of the recorded output, under inputs 1.5 times as
    large, three times as fast and half as fast. None goes anywhere where that tells
    nothing.

    What one law does there that others as good do not do the record has not told it.
    The least sum is that of the medoid.

    **Source:** Kaufman and Rousseeuw (1990), Finding Groups in Data, section 2.4, doi
    10.1002/9780470316801, for the medoid.
    """
    if not runs_decide(setting, near):
        return [0.0] * len(near)
    laws = [_numbers(setting, each) for each in near]
    outputs = _runs(setting, library, laws, near[0]).outputs.reshape(len(laws), -1)
    return [float(np.sum(_far(each - outputs))) for each in outputs]


def running_away(
    setting: Setting, library: Library, near: Sequence[Trial]
) -> list[float]:
    """Infinity for each of some laws that runs away under multisines, and 0 for the
    others; for all of them 0 where there is one alone, or no law among them.

    An output of one sign does not tell w|w| from w², of which one may come back from
    below zero and the other does not.
    """
    laws = [_numbers(setting, each) for each in near if each.terms]
    if setting.layout.outside is None or not 1 < len(laws) == len(near):
        return [0.0] * len(near)
    remain = _remain(setting, _runs(setting, library, laws, near[0]))
    return np.where(remain, 0.0, np.inf).tolist()


class Elsewhere(NamedTuple):
    """What the recordings leave open of a law beyond them: how far it goes `apart` from
    one that follows as well; and whether it is `marked` for that."""

    apart: float
    marked: bool

    def in_words(self) -> str:
        """What is said of a law that is marked."""
        if not self.marked:
            return ""
        remedy = "record an input of several amplitudes and frequencies."
        if self.apart > _MUCH:
            remedy = f"do not use it there, or {remedy}"
        return (
            "Laws that follow as well differ from it by up to "
            f"{100 * self.apart:.2g} % of the output's range under larger, faster or "
            f"slower inputs or other waveforms: {remedy}"
        )


def elsewhere(
    setting: Setting,
    library: Library,
    trials: Sequence[Trial],
    refined: Refined | None,
    aliases: Sequence[Alias],
) -> Elsewhere:
    """The largest root mean square distance, over the range of the recorded output, of
    the chosen law from one that follows the recordings as well, under inputs 1.5 times
    as large, three times as fast or half as fast, or multisines; 0 where there is no
    other.

    Others are laws of hardly less evidence, or hardly worse on blocks; and such as have
    terms in the places of others that the excitation does not tell from them. The law
    is marked where one goes far, or farther than noise on the recordings moves the law
    itself: by some standard errors of its own run there.

    **Arguments:** the laws that were tried, the chosen one first; that one refined to
    the end, of which its errors are known; and the aliases of its terms.

    **Source:** Kass and Raftery (1995), doi 10.1080/01621459.1995.10476572, for what is
    hardly less evidence.
    """
    if setting.layout.outside is None or refined is None:
        return Elsewhere(0.0, False)
    first, *rivals = (_numbers(setting, each) for each in (trials[0], *_rivals(trials)))
    others = [
        *rivals,
        *(x for x in _under_other_names(first, aliases) if _possible(setting, x)),
    ]
    if not others:
        return Elsewhere(0.0, False)
    moved = _moved(setting, trials[0], refined)
    ran = _runs(setting, library, [first, *others, *moved], trials[0])
    as_well = ran.squares <= max(_AS_WELL * ran.squares[0], _uncertain(setting, trials))
    stay = as_well & (ran.reached <= setting.reach)
    # The guard knows nothing of other waveforms, so that the chosen law may run away.
    remain = stay & _remain(setting, ran)
    most = _most(setting)
    waves = np.where(np.isnan(ran.waves), np.inf, ran.waves)
    rival = np.arange(len(stay)) <= len(others)
    found = []
    for outputs, counts in (
        (ran.outputs, stay),
        (np.clip(waves, -most, most), remain),
    ):
        far = _far(outputs - outputs[0])
        # Errors are of residuals that are independent; others are worth fewer of them.
        unsure = np.sqrt(np.sum(far[~rival] ** 2, axis=0) / trials[0].independent)
        found.append((far[rival & counts], unsure))
    apart = max(float(np.max(far, initial=0.0)) for far, _ in found)
    marked = apart > _MUCH or any(
        np.any((far > _LITTLE) & (far > _ERRORS * unsure)) for far, unsure in found
    )
    return Elsewhere(apart, marked)


def _remain(setting: Setting, ran: "_Runs") -> Bool[np.ndarray, " m"]:
    """Which laws do not run away under other waveforms."""
    return np.all(np.abs(ran.waves) <= _most(setting), axis=(1, 2))


def _most(setting: Setting) -> float:
    """How far an output may get from the middle of the recorded ones, over their range,
    under other waveforms: their peaks are three times the recorded input's, and lead
    beyond the reach."""
    return _RUNS_AWAY * setting.reach / 2


def _moved(setting: Setting, trial: Trial, refined: Refined) -> list[dict[str, float]]:
    """A law with its numbers moved by a standard error along each axis of their errors:
    root sums of squares of what that does are the errors of its runs."""
    trial = _explore.free(setting, trial, trial.numbers)  # as it was refined
    law, named = _numbers(setting, trial), model(setting, setting.library, trial)
    own = dict(zip(refined.value.parameters(), named.parameters(), strict=True))
    names, covariance = refined.of_numbers()
    sizes, axes = np.linalg.eigh(np.asarray(covariance))
    steps = axes * np.sqrt(np.maximum(sizes, 0.0))
    return [
        law | {own[n]: law[own[n]] + x for n, x in zip(names, step, strict=True)}
        for step in steps.T
    ]


def _rivals(trials: Sequence[Trial]) -> list[Trial]:
    """Laws, after the chosen one, that are not clearly worse."""
    if trials[0].blocks:
        return list(search.alike(trials))
    least = min(trial.criterion for trial in trials)
    return [each for each in trials[1:] if each.criterion < least + _EVIDENCE]


def _under_other_names(
    law: dict[str, float], aliases: Sequence[Alias]
) -> Iterator[dict[str, float]]:
    """Laws that are this one as far as the excitation tells, of as many terms: with
    another term in the place of one, and of several at once. Under a triangle the
    speed, which is the same all along, may stand in every term or in none."""
    others: dict[str, list[tuple[str, float]]] = {name: [] for name in law}
    for alias in aliases:
        mix = alias.combination
        if not mix or not law.keys() >= mix.keys():
            continue
        for place, share in mix.items():
            amount = law[place] / share
            other = {name: x - amount * mix.get(name, 0.0) for name, x in law.items()}
            del other[place]
            yield {**other, alias.term: amount}
        if len(mix) == 1:
            ((place, share),) = mix.items()
            others[place].append((alias.term, law[place] / share))
    choices = [[(name, law[name]), *each] for name, each in others.items()]
    for each in islice(product(*choices), _TOGETHER):
        other = dict(each)
        if len(other) == len(law) and len(other.keys() - law.keys()) > 1:
            yield other


def _possible(setting: Setting, law: dict[str, float]) -> bool:
    """Whether a law has the known part, and the signs that are asked for."""
    holds = all(law.get(name) == x for name, x in setting.known.items())
    return holds and agree(law, setting.signs)


def _numbers(setting: Setting, trial: Trial) -> dict[str, float]:
    return {**setting.known, **trial.terms, **trial.numbers}


class _Runs(NamedTuple):
    """Of m laws the squares, how far they get beyond the recorded inputs, and their
    outputs there and under other waveforms, from the middle of the recorded ones and
    over their range, for each of c inputs."""

    squares: Float[np.ndarray, " m"]
    reached: Float[np.ndarray, " m"]
    outputs: Float[np.ndarray, "m c s"]
    waves: Float[np.ndarray, "m d s"]


def _runs(
    setting: Setting,
    library: Library,
    laws: Sequence[dict[str, float]],
    first: Trial,
) -> _Runs:
    """Free runs of laws, by their coefficients and numbers, from where the first law
    begins: in portions of one size."""
    names = (*library.names, *library.numbers)
    grid = {name: float(number) for name, number in library.numbers.items()}
    numbers = [grid | law for law in laws]
    rows = np.array([[law.get(name, 0.0) for name in names] for law in numbers])
    rows = np.concatenate([rows, np.tile(rows[:1], (-len(rows) % _AT_ONCE, 1))])
    portions = jnp.asarray(rows.reshape(-1, _AT_ONCE, len(names)))
    layout, starts = setting.layout, jnp.array(first.starts)
    fixed = layout, library, setting.around

    def run(portion):
        return jax.device_get(_run_beyond(*fixed, portion, starts))

    ran = [found for _, found in in_order(run, [*portions])]
    squares, reached, *outputs = (
        np.concatenate(each)[: len(laws)] for each in zip(*ran, strict=True)
    )
    w, known = (np.asarray(x) for x in (layout.samples.w, layout.samples.weight > 0))
    # Of a recording of no weight there is neither, and nothing is looked at below.
    high = np.max(w, axis=1, where=known, initial=np.min(w))[:, None]
    low = np.min(w, axis=1, where=known, initial=np.max(w))[:, None]
    beyond = (((each - (high + low) / 2) / (high - low)) for each in outputs)
    return _Runs(squares, reached, *(each[:, :, known] for each in beyond))


@jit
def _run_beyond(
    layout: Layout,
    library: Library,
    around: Around,
    rows: Float[Array, "m _n"],
    starts: Float[Array, " r"],
) -> tuple[
    Float[Array, " m"],
    Float[Array, " m"],
    Float[Array, "m c r n"],
    Float[Array, "m d r n"],
]:
    """Of laws the squares, how far they get beyond the recorded inputs, and their
    outputs there and under other waveforms; each by its coefficients and the library's
    numbers."""
    k, samples = len(library), layout.samples

    def run(row):
        moved = library.with_numbers(dict(zip(library.numbers, row[k:], strict=True)))
        law = around(SparseModel(moved, row[:k], np.ones(k, bool)))
        free = free_of(law)
        law = parameters(law, (), {}, {})
        objective = Objective(law, samples, Squares(), 1, 0.0, free)
        unknowns = first_unknowns(objective, starts)
        missed = objective.run(unknowns).outputs - samples.w
        squares = jnp.sum(jnp.where(samples.weight > 0, samples.weight * missed**2, 0))
        outputs = layout.beyond(objective, unknowns)
        waves = layout.otherwise(objective, unknowns)
        return squares, layout.from_middle(outputs), outputs[:-1], waves

    return jax.vmap(run)(rows)


def _far(distances: Float[np.ndarray, "*any s"]) -> Float[np.ndarray, " *any"]:
    """Their root mean squares; infinite where one is not finite."""
    with np.errstate(over="ignore"):
        far = np.sqrt(np.mean(distances**2, axis=-1))
    return np.where(np.isfinite(far), far, np.inf)
