"""How often the right terms are found under noise, and how long that takes."""

import time
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pysindy as ps

import hystjax as hj
from hystjax._core.show import Progress
from hystjax.library import Library, Polynomial

from ._agreement import agreed, relative_difference
from ._noisy import CASES, Case, Noisy
from ._problem import Columns
from ._results import Table
from ._rivals import Fit, rivals
from ._timing import FULL, Effort, Timing
from ._truth import Truth

_OURS, _GIVEN = "hystjax.discover", "hystjax.refine of the true terms"
_RECORDS = 100
# Of PySINDy's grid; the smallest coefficient to be found is 0.25.
_THRESHOLDS = (0.1, 0.15, 0.2, 0.3)
_CHOOSING = 20  # of the records, on which the settings of the others are chosen


class Trial(NamedTuple):
    """A law of one record: how long it took, s; whether it has exactly the right terms;
    and the relative error of its coefficients."""

    seconds: float
    right: bool
    error: float


Contestants = Mapping[str, Mapping[str, Fit]]  # the fits by setting
Trials = dict[str, dict[str, list[Trial]]]


def run(effort: Effort) -> list[Table]:
    """A hundred records of each case; when quick, three of the first one."""
    if effort is FULL:
        return [compared(case, _RECORDS) for case in CASES]
    return [compared(CASES[0], 3)]


def compared(case: Case, count: int) -> Table:
    """All contestants on `count` records of a case, which differ by their noise."""
    library, clean = Polynomial(case.degree), case.clean()
    truth = Truth(clean, library, case.law)
    records = case.records(clean, count)
    same = _same_library(case, library, records[0].columns)
    contestants = _contestants(case, truth, library, records[0].columns.t)
    chosen, trials = _with_best_settings(contestants, records, truth)
    size = f"{count} records of {len(clean)} samples, {len(library)} terms"
    return Table(
        f"{case.title}: {size}",
        _OURS,
        {name: _timing(found) for name, found in trials.items()},
        (same, *_notes(trials, chosen)),
        {name: _scores(found, trials[_GIVEN]) for name, found in trials.items()},
    )


def _contestants(case: Case, truth: Truth, library: Library, t) -> Contestants:
    law = hj.models.SparseModel.from_terms(case.law)
    refine = eqx.filter_jit(lambda record: hj.refine(law, record, throw=False).value)

    def discovered(noisy: Noisy):
        solution = hj.discover(noisy.record, library, throw=False)
        return truth.vector(solution.value.terms())

    def refined(noisy: Noisy):
        return truth.vector(refine(noisy.record).terms())

    ours = {_OURS: {"": discovered}, _GIVEN: {"": refined}}
    return ours | rivals(t, case.degree, _THRESHOLDS)


def _with_best_settings(
    contestants: Contestants, records: Sequence[Noisy], truth: Truth
) -> tuple[dict[str, str], dict[str, list[Trial]]]:
    """The best setting of each contestant, and its trials on all records."""
    first = _tried(contestants, records[:_CHOOSING], truth)
    chosen = {name: max(found, key=_merit(found)) for name, found in first.items()}
    best = {name: {s: contestants[name][s]} for name, s in chosen.items()}
    rest = _tried(best, records[_CHOOSING:], truth)
    return chosen, {name: first[name][s] + rest[name][s] for name, s in chosen.items()}


def _tried(contestants: Contestants, records: Sequence[Noisy], truth: Truth) -> Trials:
    """All contestants with each of their settings, in turns, on each record."""
    trials: Trials = {name: {s: [] for s in fits} for name, fits in contestants.items()}
    with Progress("records", len(records)) as progress:
        for done, noisy in enumerate(records, 1):
            for name, fits in contestants.items():
                for setting, fit in fits.items():
                    trials[name][setting].append(_trial(fit, noisy, truth))
            progress.show(done)
    return trials


def _trial(fit: Fit, noisy: Noisy, truth: Truth) -> Trial:
    begun = time.perf_counter()
    law = fit(noisy)
    seconds = time.perf_counter() - begun
    return Trial(seconds, truth.is_found(law), truth.error(law))


def _merit(found: Mapping[str, Sequence[Trial]]) -> Callable[[str], tuple]:
    """Of a setting: how often it is right, then how small its errors are."""

    def merit(setting):
        _, right, errors = zip(*found[setting], strict=True)
        return sum(right), -sum(errors)

    return merit


def _timing(trials: Sequence[Trial]) -> Timing:
    first, *warm = (trial.seconds for trial in trials)
    return Timing(first, tuple(warm))


def _scores(trials: Sequence[Trial], given: Sequence[Trial]) -> dict[str, float]:
    error, least = (np.mean([t.error for t in each]) for each in (trials, given))
    return {
        "right, %": 100 * float(np.mean([trial.right for trial in trials])),
        "error, %": 100 * float(error),
        "error ratio": float(error / least),
    }


def _notes(
    trials: Mapping[str, Sequence[Trial]], chosen: Mapping[str, str]
) -> tuple[str, ...]:
    wrong = [str(seed) for seed, trial in enumerate(trials[_OURS]) if not trial.right]
    return (
        f"seeds of which {_OURS} finds other terms: {', '.join(wrong) or 'none'}",
        "right: exactly the true terms, up to terms that are equal on this excitation; "
        "error: mean length of the error of all coefficients, of the true ones'; error "
        "ratio: over that of the true terms, refined",
        *(f"{name}: {setting}" for name, setting in chosen.items() if setting),
        f"PySINDy's settings are the best of a grid on the first {_CHOOSING} records, "
        "which count too; the search for them is not timed; it is given the exact "
        "slope of u",
        "a first call compiles what no case before it has compiled",
    )


def _same_library(case: Case, library: Library, data: Columns) -> str:
    """That both have the same terms in the same order."""
    theirs = ps.PolynomialLibrary(degree=case.degree).fit_transform(data.all)
    signals = (data.w[:, 0], data.controls[:, 0], data.controls[:, 1])
    ours = library(*map(jnp.asarray, signals))
    return agreed("terms", relative_difference(ours, np.asarray(theirs)), 1e-9)
