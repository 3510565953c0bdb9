"""Whether steps are fine enough for what a fit leaves, and lines close enough."""

import math
import warnings
from dataclasses import replace
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .._core.checks import is_concrete
from .._core.errors import InputError
from .._core.solution import Solution
from ..recording import Recording
from ..signals import Linear

_STEP_SHARE = 0.01  # of what a fit leaves, that its steps may change
_STEP_FLOOR = 1e-6  # of the output's spread, that they may change in any case
_MOST_SUBSTEPS = 32
# Of the error of lines, that cubics have where an input is smooth: 0.35 for the
# multisine of the Bouc-Wen benchmark, 0.67 and more for triangles, 1 for random walks.
_SMOOTH = 0.5
_PROVEN = 100.0  # fits this much closer than lines can miss show that lines are right


def steps(group: tuple[Recording, ...], substeps: int | None) -> int:
    """Integration steps a sample interval: enough to step around turning points."""
    least = 1 if all(recording.path.kinked for recording in group) else 2
    if substeps is not None and substeps < least:
        raise InputError(
            f"`substeps` must be at least {least} for an input that is "
            f"{'linear' if least == 1 else 'smooth'} between samples, got {substeps}."
        )
    return substeps or least


def of_steps(objective, finer, unknowns, residuals) -> dict[str, Any]:
    """How the simulated output changes with twice as many steps."""
    samples = objective.samples
    again = eqx.tree_at(lambda o: o.samples, objective, finer)
    outputs = replace(again, memory=None).run(unknowns).outputs
    used = samples.weight > 0
    change = jnp.where(used, outputs - samples.w, 0.0) - residuals
    error = jnp.sqrt(jnp.sum(change**2) / jnp.sum(used))
    counts = {"substeps": samples.substeps, "spread": samples.spread}
    return counts | {"step_error": error}


def _step_errors(solution: Solution) -> tuple[float, float]:
    """By how much the output of a fit changes with the steps, and by how much it may;
    zeros while that is being traced."""
    stats = solution.stats
    if not is_concrete(stats["step_error"], *jax.tree.leaves(solution.value)):
        return 0.0, 0.0
    left = float(jnp.nan_to_num(jnp.sqrt(jnp.mean(stats["rmse"] ** 2)), nan=0.0))
    most = max(_STEP_SHARE * left, _STEP_FLOOR * float(stats["spread"]))
    return float(jnp.nan_to_num(stats["step_error"], nan=jnp.inf)), most


def too_long(solution: Solution) -> bool:
    """Whether a fit should be made again with more steps."""
    error, most = _step_errors(solution)
    return error > most and solution.stats["substeps"] < _MOST_SUBSTEPS


def more(solution: Solution) -> int:
    """The steps that a method of fourth order needs, twice to eight times as many."""
    error, most = _step_errors(solution)
    ratio = (error / most) ** 0.25 if math.isfinite(error) else 8.0
    factor = 2 ** min(3, max(1, math.ceil(math.log2(ratio))))
    return min(_MOST_SUBSTEPS, solution.stats["substeps"] * factor)


def warn_of_steps(solution: Solution) -> None:
    error, most = _step_errors(solution)
    if error > most:
        warnings.warn(
            f"with {solution.stats['substeps']} steps a sample interval the simulated "
            f"output is uncertain by about {error:.2g}, which is no small part of what "
            "the fit leaves: give more `substeps`, or judge the law by "
            "`simulation.Adaptive()`.",
            stacklevel=3,
        )


def warn_of_lines(group: tuple[Recording, ...], solution: Solution) -> None:
    """Say where inputs are taken for straight lines that are smooth, if that is no
    small part of what a fit leaves."""
    stats = solution.stats
    if not is_concrete(stats["rmse"], *(each.u for each in group)):
        return
    left = stats["rmse"] / stats["spread"]
    for recording, share in zip(group, np.asarray(left).tolist(), strict=True):
        missed = _missed_by_lines(recording)
        if share < missed < _PROVEN * share:
            warnings.warn(
                "the input is smooth, and straight lines between its samples miss it "
                f"by about {missed:.1%} of its spread, where the fit leaves {share:.1%}"
                " of the output's: make the recording with `interpolation="
                "hystjax.interpolation.Cubic()`, or `BandLimited()` for whole periods.",
                stacklevel=3,
            )


def _missed_by_lines(recording: Recording) -> float:
    """What straight lines miss of an input between its samples, over its spread: none
    where it is not clearly smooth.

    Each sample is predicted by its neighbours, by the line through two of them and by
    the cubic through four. Smooth inputs follow the cubic; corners and noise, neither.
    """
    if not isinstance(recording.interpolation, Linear) or len(recording) < 9:
        return 0.0
    u = np.asarray(recording.u)
    line = (u[1:-3] + u[3:-1]) / 2 - u[2:-2]
    cubic = (4 * (u[1:-3] + u[3:-1]) - u[:-4] - u[4:]) / 6 - u[2:-2]
    by_line, by_cubic = (np.sqrt(np.mean(error**2)) for error in (line, cubic))
    smooth = by_cubic < _SMOOTH * by_line
    # Half as far from the neighbours, lines are four times as close.
    return float(by_line / 4 / np.std(u)) if smooth else 0.0
