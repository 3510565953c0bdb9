"""Whether steps are fine enough for what a fit leaves, and lines close enough."""

import math
import warnings
from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._core.checks import is_concrete
from .._core.errors import InputError
from ..recording import Recording
from ..signals import Linear
from ._certainty import Refined

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


def step_error(objective, finer, unknowns, residuals) -> Float[Array, ""]:
    """How the simulated output changes with twice as many steps, root mean square."""
    samples = objective.samples
    again = eqx.tree_at(lambda o: o.samples, objective, finer)
    outputs = replace(again, memory=None).run(unknowns).outputs
    used = samples.weight > 0
    change = jnp.where(used, outputs - samples.w, 0.0) - residuals
    return jnp.sqrt(jnp.sum(change**2) / jnp.sum(used))


def _step_errors(fit: Refined) -> tuple[float, float]:
    """By how much the output of a fit changes with the steps, and by how much it may;
    zeros while that is being traced."""
    if not is_concrete(fit.step_error, *jax.tree.leaves(fit.model)):
        return 0.0, 0.0
    left = float(jnp.nan_to_num(jnp.sqrt(jnp.mean(fit.rmse**2)), nan=0.0))
    most = max(_STEP_SHARE * left, _STEP_FLOOR * float(fit.spread))
    return float(jnp.nan_to_num(fit.step_error, nan=jnp.inf)), most


def too_long(fit: Refined) -> bool:
    """Whether a fit should be made again with more steps."""
    error, most = _step_errors(fit)
    return error > most and fit.substeps < _MOST_SUBSTEPS


def more(fit: Refined) -> int:
    """The steps that a method of fourth order needs, twice to eight times as many."""
    error, most = _step_errors(fit)
    ratio = (error / most) ** 0.25 if math.isfinite(error / most) else 8.0
    factor = 2 ** min(3, max(1, math.ceil(math.log2(ratio))))
    return min(_MOST_SUBSTEPS, fit.substeps * factor)


def warn_of_steps(fit: Refined) -> None:
    error, most = _step_errors(fit)
    if error > most:
        warnings.warn(
            f"with {fit.substeps} steps a sample interval the simulated output is "
            f"uncertain by about {error:.2g}, which is no small part of what the fit "
            "leaves: give more `substeps`, or judge the law by "
            "`simulation.Adaptive()`.",
            stacklevel=3,
        )


def warn_of_lines(group: tuple[Recording, ...], fit: Refined) -> None:
    """Say where inputs are taken for straight lines that are smooth, if that is no
    small part of what a fit leaves."""
    if not is_concrete(fit.rmse, *(each.u for each in group)):
        return
    left = fit.rmse / fit.spread
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
