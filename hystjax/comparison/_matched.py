"""Models that flow, and others that are not linear in their numbers, by trajectory
matching: without each block and to all samples, side by side in one program."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._core.errors import InputError
from .._core.jit import jit
from ..discovery import discover
from ..discovery._layout import NONE, Layout, refined_without
from ..library import Polynomial
from ..models import AbstractModel
from ..recording import Recording
from ..refinement import LevenbergMarquardt
from ..refinement._refine import fades
from ..simulation import FixedStep, metrics, simulate
from ._case import Case, Fit

_SOLVER, _STEPS = LevenbergMarquardt(rtol=1e-5), 30
_FAR = 0.3  # of the output's range, beyond which a guess is none
_FADING = 0.1  # as `discover` asks of laws


def law(case: Case) -> Fit:
    """A sparse law of first order, as `discover` chooses it."""
    solution = discover(case.group, Polynomial(2), weights=case.weights)
    found = solution.value.compact()
    return _matched(case, found, solution.stats["why"], _FADING)


def guessed(
    guess: Callable[[Recording], AbstractModel], *fixed: str
) -> Callable[[Case], Fit]:
    """A model from what it guesses of the record that goes farthest, its numbers fitted
    but those `fixed`."""

    def fit(case: Case) -> Fit:
        model = guess(case.widest)
        _check_near(model, case)
        return _matched(case, model, fixed=fixed)

    return fit


def _check_near(model: AbstractModel, case: Case) -> None:
    """That a guess is near enough to be worth a fit, which takes far longer."""
    record, method = case.widest, FixedStep(case.layout.samples.substeps)
    run = simulate(model, record, method=method, throw=False)
    missed = float(metrics.nrmse(record.w, run.w))
    if not missed < _FAR:
        raise InputError(
            f"what it guesses misses the output by {100 * missed:.0f} % of its range: "
            "a device of another kind, or an output that is not centred."
        )


def _matched(case: Case, model: AbstractModel, note="", fading=0.0, fixed=()) -> Fit:
    for each in case.group:
        model.check_times(each.t, each.clocked)
    names = [name for name in model.parameters() if name.split("[")[0] in fixed]
    fading = fading if fades(model) else 0.0
    ends = _refined(case.layout, model, tuple(names), fading, case.layout.count)
    values, outputs = jax.device_get(ends)
    whole = {name: jnp.asarray(x[-1]) for name, x in values.items()}
    model = model.with_parameters(whole).settled()
    return Fit(model, outputs, len(whole), note)


@jit
def _refined(
    layout: Layout, model: AbstractModel, fixed: tuple[str, ...], fading: float, count
) -> tuple[dict[str, Float[Array, " b"]], Float[Array, "b r n"]]:
    starts = layout.samples.w[:, 0]

    def fit(block):
        objective, end, run, _ = refined_without(
            layout, model, block, starts, _SOLVER, _STEPS, fixed=fixed, fading=fading
        )
        names = objective.parameters.names
        return dict(zip(names, end.unknowns.values, strict=True)), run.outputs

    return jax.vmap(fit)(jnp.array([*range(count), NONE]))
