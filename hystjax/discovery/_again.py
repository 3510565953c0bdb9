"""Searches that are made again: with the steps that a law turned out to need, and with
weights where the noise turned out to grow."""

import math
from collections.abc import Callable

from . import search
from ._choosing import Found, Weights
from ._layout import layout
from ._trials import Setting


def again_where_needed(
    setting: Setting,
    given: Weights | None,
    found_in: Callable[[Setting, Weights | None], tuple[Setting, Found]],
    with_more_steps: bool,
) -> tuple[Setting, Found]:
    """What a search finds; another with the steps that its law needs, for so may what
    was passed over for want of them (but hidden laws are found without any); and with
    weights, where the noise turns out to grow with the output."""
    last, found = found_in(setting, given)
    if with_more_steps and found.substeps > last.layout.samples.substeps:
        setting = _laid_out(setting, given, found.substeps)
        last, found = found_in(setting, given)
    by_variance = _by_variance(last, found) if given is None else None
    if by_variance is None:
        return last, found
    again = _laid_out(setting, by_variance, last.layout.samples.substeps)
    again, other = found_in(again, by_variance)
    # None when the time is up, or all are refused.
    return (again, other) if other.trials else (last, found)


def _by_variance(setting: Setting, found: Found) -> Weights | None:
    """Of the samples of each recording, where the noise grows with the output."""
    if found.refined is None:
        return None
    samples, residuals = setting.layout.samples, found.refined.stats["residuals"]
    used = samples.weight > 0
    independent = search.effective_samples(residuals, used)
    outputs = samples.w + residuals
    weights = search.weights(outputs, residuals, used, independent)
    if weights is None:
        return None
    return [row[: len(r)] for row, r in zip(weights, setting.group, strict=True)]


def _laid_out(setting: Setting, weights: Weights | None, substeps: int) -> Setting:
    beyond = math.isfinite(setting.reach)
    return setting._replace(layout=layout(setting.group, weights, substeps, beyond))
