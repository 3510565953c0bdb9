"""Laws that were tried on recordings, with what decides between them."""

import math
from collections.abc import Iterator

import numpy as np

from ._trials import Setting, Trial
from .search import Candidate, information_criterion


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
