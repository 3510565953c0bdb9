"""Judge a law by free run, as the device was measured."""

import warnings
from dataclasses import replace
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from .._core import checks
from .._core.checks import InputError, is_concrete
from .._core.compiling import jit
from .._core.show import Card, Curve, Shown, quantity
from .._core.solution import RESULTS, Solution, ended_in_words
from ..models import AbstractModel, AbstractSequenceModel, as_model
from ..recording import Recording, as_recording
from ..recording._as_measured import checked_lead_in, led_in
from . import metrics
from ._adaptive import Automatic
from ._fixed_step import AbstractSimulation
from ._simulate import Trajectory, free_run, with_beyond

_PERIODS = 9  # in which a model settles by default, before the one that is judged
_SETTLED = 1e-3  # of the output's range, by which two periods may differ


class Judgement(Shown):
    """How well a law reproduces a recording from its initial value alone.

    **Attributes:**

    - `recording`: what was judged, n samples.
    - `trajectory`: the free run; `trajectory.result` tells whether it diverged.
    - `errors`: scalars by name: `nrmse`, `relative_error`, `relative_squared_error` and
        `r2` as ratios, `rmse` and `max_error` in output units. Not finite for a law
        that diverges.
    - `weights`: of the samples in these errors, shape (n,); `None` where all count
        alike.
    """

    recording: Recording
    trajectory: Trajectory
    errors: dict[str, Array]
    weights: Float[Array, " n"] | None = None

    @property
    def succeeded(self) -> bool:
        """Whether the free run reached the end. Concrete judgements only."""
        return bool(self.trajectory.result == RESULTS.successful)

    def in_words(self) -> dict[str, str]:
        """The errors with their units, ratios in per cent, by what they are called;
        none for a law that diverges. Concrete judgements only."""
        errors = {name: float(value) for name, value in self.errors.items()}
        if not np.isfinite(errors["nrmse"]):
            return {}
        told = {label: f"{100 * errors[name]:.4g} %" for name, label in RATIOS.items()}
        told["R²"] = f"{errors['r2']:.6g}"
        unit = self.recording.units[1]
        return told | {"largest error": quantity(errors["max_error"], unit)}

    def _card(self) -> Card | None:
        record, run = self.recording._card(), self.trajectory
        if record is None or not is_concrete(run.w, *self.errors.values()):
            return None
        told = self.in_words() or {"NRMSE": ended_in_words(run.result)}
        count = len(self.recording)
        if self.weights is not None:
            judged = np.sum(np.asarray(self.weights) > 0)
            count = f"{judged} of {count}"
        title = f"Judgement of {count} samples: NRMSE {told.pop('NRMSE')}"
        free = Curve(np.asarray(run.u), np.asarray(run.w))
        curves = (*record.curves, free)
        return Card(title, tuple(told.items()), curves=curves, axes=record.axes)


RATIOS = {
    "nrmse": "NRMSE",
    "relative_error": "relative error",
    "relative_squared_error": "squared error",
}


def judge(
    model: AbstractModel | AbstractSequenceModel | Solution,
    recording: Recording,
    *,
    w0: ArrayLike | None = None,
    weights: ArrayLike | None = None,
    periodic: bool = False,
    lead_in: int | None = None,
    method: AbstractSimulation = Automatic(),
) -> Judgement:
    """Simulate a law along a recording and measure how far it gets from it.

    Judge on rows that the law was not fitted on: errors on its own rows flatter it.

    **Arguments:** `model`, `w0` and `method` as for `simulate`, and

    - `recording`: what the law is held against.
    - `weights`: of the samples, shape (n,); those of weight 0, such as dropouts that
        were `bridged`, are simulated but not judged. All count alike by default.
    - `periodic`: whether the recording is of whole periods of its input, evenly
        sampled, of a device that has settled. The law is then judged in its steady
        state, in which it comes round to where it was: on the period after a lead-in.
    - `lead_in`: number of samples in which the law settles, which are not judged: the
        first of the recording, none by default; if `periodic`, of as many periods
        before it as that takes, by default nine of them.

    **Returns:** a `Judgement`, of the samples after the lead-in. If `periodic`, its
    `trajectory.stats["unsettled"]` is the largest difference between the period judged
    and the one before, output units. A law that diverges does not raise.

    **Raises:** `InputError` as `simulate` does, for weights of another length, negative
    ones, and none that is positive, for a lead-in that leaves nothing to judge, and for
    a recording that is not `periodic` but said to be. Warns where the law has not
    settled.
    """
    model = as_model(model, "judge(model, recording)")
    as_recording(recording, "judge(model, recording)")
    known = None if weights is None else checks.weights(weights, recording.w)
    whole = recording
    if periodic:
        lead_in = _PERIODS * len(recording) if lead_in is None else lead_in
        whole, _ = led_in(recording, None, lead_in, periodic)
    run = free_run(model, whole, w0, method)
    if periodic:
        run = with_beyond(model, _last_period(run, recording))
    elif lead_in:
        recording, run, known = _behind(lead_in, recording, run, known)
        run = with_beyond(model, run)
    if known is not None and is_concrete(known) and not np.any(np.asarray(known) > 0):
        raise InputError("no sample has a weight, and there is nothing to judge.")
    return Judgement(recording, run, _errors(recording.w, run.w, known), known)


def _behind(lead_in: int, recording: Recording, run: Trajectory, weights):
    """A recording, its run and its weights without the lead-in."""
    n = len(recording)
    judged = n - checked_lead_in(lead_in, n, periodic=False)
    checks.enough_samples("a judgement after its lead-in", judged, 3)
    t, u, w = (_last(judged, x) for x in (run.t, run.u, run.w))
    weights = None if weights is None else _last(judged, weights)
    run = replace(run, t=t, u=u, w=w)
    return recording.window(lead_in, n), run, weights


def _last(count: int, row: Float[Array, " n"]) -> Float[Array, " c"]:
    return checks.rows(row, slice(len(row) - count, None))


def _last_period(run: Trajectory, recording: Recording) -> Trajectory:
    """The end of a run as that along the recording, and how it differs from the period
    before, as far as that was run."""
    n, stats = len(recording), run.stats
    common = min(n, len(run.w) - n)
    if common:
        before = _last(common, checks.rows(run.w, slice(len(run.w) - n)))
        apart = jnp.max(jnp.abs(_last(common, run.w) - before))
        stats = stats | {"unsettled": apart}
        _warn_unsettled(apart, recording)
    w = _last(n, run.w)
    return replace(run, t=recording.t, u=recording.u, w=w, stats=stats)


def _warn_unsettled(apart: Float[Array, ""], recording: Recording) -> None:
    if not is_concrete(apart, recording.w):
        return
    if float(apart) > _SETTLED * np.ptp(np.asarray(recording.w)):
        by = quantity(float(apart), recording.units[1], 3)
        warnings.warn(
            f"the law has not settled: the period that is judged differs by up to {by} "
            "from the one before. Give a longer `lead_in`; a law that never forgets "
            "how it began has no steady state.",
            stacklevel=4,
        )


@jit
def _errors(w, w_hat, weights) -> dict[str, Any]:
    measures = (
        metrics.nrmse,
        metrics.relative_error,
        metrics.relative_squared_error,
        metrics.r2,
        metrics.rmse,
        metrics.max_error,
    )
    return {measure.__name__: measure(w, w_hat, weights) for measure in measures}
