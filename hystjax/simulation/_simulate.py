"""Simulate a law along an input, make recordings so, and judge a law by free run, as
the device was measured."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float, PRNGKeyArray

from .._core import checks
from .._core.checks import InputError, is_concrete, warn
from .._core.compiling import alone, changed, jit
from .._core.show import Card, Curve, Shown, moment, quantity, samples_card
from .._core.solution import (
    RESULTS,
    Solution,
    ended,
    ended_in_words,
    if_sorted,
    raise_unless_successful,
)
from ..models import AbstractModel, AbstractSequenceModel, Beyond, as_model
from ..models._base import names_and_units
from ..models._sequence import fitting, no_numbers, warn_of_units
from ..recording import Recording, as_recording
from ..recording._as_measured import checked_lead_in, led_in
from ..signals import AbstractInputPath
from ..signals.excitation import AbstractExcitation
from . import metrics
from ._steps import AbstractSimulation, Adaptive, Automatic, flows


class Trajectory(Shown):
    """A simulated output.

    **Attributes:**

    - `t`: times, shape (n,), s.
    - `u`: input, shape (n,).
    - `w`: simulated output, shape (n,); not finite from where a law diverges.
    - `result`: a member of `hystjax.RESULTS`.
    - `stats`: `num_steps`; `error`, of `w`, where the method estimates it; and for laws
        that keep the range they were fitted on `beyond`, a `models.Beyond`: how far
        the input leaves that.
    - `names`, `units`: of input and output.
    - `clocked`: whether `t` are times, or number the samples of a recording without a
        clock.
    """

    t: Float[Array, " n"]
    u: Float[Array, " n"]
    w: Float[Array, " n"]
    result: RESULTS
    stats: dict[str, Any]
    names: tuple[str, str] = eqx.field(static=True, default=("input", "output"))
    units: tuple[str, str] = eqx.field(static=True, default=("", ""))
    clocked: bool = eqx.field(static=True, default=True)

    def _card(self) -> Card | None:
        if not is_concrete(self.result._value):
            return None
        return samples_card(f"Trajectory: {ended_in_words(self.result)}", self)


def simulate(
    model: AbstractModel | AbstractSequenceModel | Solution,
    inputs: Recording | AbstractInputPath,
    *,
    w0: ArrayLike | None = None,
    method: AbstractSimulation = Automatic(),
    throw: bool = True,
) -> Trajectory:
    """Integrate a law along an input (free run: no measured output enters but `w0`).

    **Arguments:**

    - `model`: the law, or the `Solution` of a fit; or a sequence model, which is asked
        for its response instead.
    - `inputs`: a recording, whose input and interpolation are used, or an input path.
        Memory starts from what came before it, where that is known.
    - `w0`: output at the first sample; by default the recording's. Laws of the value
        w = f(u) and operators do not look at it, and need none.
    - `method`: `simulation.Automatic()` (fast, as many steps as its estimate of the
        error asks for), `simulation.Adaptive()` (Diffrax, the reference) or
        `simulation.FixedStep()`; no matter to sequence models.
    - `throw`: whether to raise when the law diverges, or to say so in `result`.

    **Returns:** a `Trajectory` at the sample times.

    **Raises:** `InputError` when `w0` is not one finite number, or missing where it is
    needed for a bare path, when a recording has no clock and the law depends on the
    rate, and when samples are not at the interval of a sequence model;
    `ComputationError` when the law diverges (with the time at which it does). Warns
    where the input goes farther or faster than those that the law was fitted on, by how
    much and from when, and of a recording in other units than the model.
    """
    checks.answers(throw=throw)
    model = as_model(model, "simulate(model, recording)")
    trajectory = free_run(model, inputs, w0, method)
    warn_beyond(model, trajectory.stats.get("beyond"), trajectory.clocked)
    if not throw:
        return trajectory
    return raise_unless_successful(
        trajectory, lambda lost: f"{where_lost(lost)} {no_numbers(model)}"
    )


def free_run(model, inputs, w0, method) -> Trajectory:
    """As `simulate`, of a model, and whatever comes of it."""
    checks.kind("method", method, AbstractSimulation, "simulation.Adaptive()")
    if not isinstance(inputs, AbstractInputPath):
        as_recording(inputs, "simulate(model, recording)", "inputs")
    if w0 is None and not isinstance(inputs, Recording):
        if needs_start(model):
            raise InputError(
                "`w0`, the output at the first sample, is needed with an input path; "
                "only a recording has one of its own."
            )
        w0 = 0.0
    w0 = None if w0 is None else first_output(w0)
    if isinstance(inputs, Recording):
        (inputs,) = fitting(model, (inputs,))
        warn_of_units(model, inputs)
    else:
        model.check_times(inputs.t, True)
    # Without its range: what is compiled for a guess serves the fit too.
    bare = model if model.fitted_range is None else model.fitted_on(None)
    trajectory = with_beyond(model, _by(method, bare, inputs, w0))
    if not isinstance(inputs, Recording):
        return changed(trajectory, names=model.names, units=model.units)
    named = names_and_units(model, inputs)
    return changed(trajectory, **named, clocked=inputs.clocked)


def needs_start(model: AbstractModel | AbstractSequenceModel) -> bool:
    """Whether a run depends on the output at the first sample."""
    return not isinstance(model, AbstractModel) or flows(model)


def _by(method, model, inputs, w0) -> Trajectory:
    """The run by a method, or by the one that it leaves to others what it loses."""
    trajectory = _by_parts(method, model, inputs, w0)
    if method.otherwise is None or not _unsettled(trajectory):
        return trajectory
    other = _by_parts(method.otherwise, model, inputs, w0)
    failed = not ended(other.result, RESULTS.successful)
    return trajectory if failed and _nearly_known(trajectory) else other


def _by_parts(method, model, inputs, w0) -> Trajectory:
    """The run by the first part of a method after which no other is wanted, each a
    program of its own; by all of it where nobody can look at how a part ends."""
    *first, last = method.parts if alone(model, inputs, w0) else (method,)
    for part in first:
        run = _of_its_size(part, model, inputs, w0)
        if not _unsettled(run):
            return run
    return _of_its_size(last, model, inputs, w0)


_FAR_LESS = 0.1  # of what an output is taken for


def _of_its_size(method, model, inputs, w0) -> Trajectory:
    """The run by a method that is told of what order the output is: that of a
    recording, or of the first output, until it turns out to be far less."""
    scale = None
    while True:
        run, taken = _simulate(model, model.rows_in_use, inputs, w0, method, scale)
        if not method.scaled or not is_concrete(run.w):
            return run
        scale = np.asarray(np.max(np.abs(np.asarray(run.w))))
        if not 0 < scale < _FAR_LESS * taken:
            return run


def with_beyond(model, trajectory: Trajectory) -> Trajectory:
    """The trajectory and where its input leaves what the law was fitted on."""
    known = model.fitted_range
    if known is None:
        return trajectory
    any_rate = model.rate_independent is True
    beyond = known.left_by(trajectory.t, trajectory.u, any_rate)
    return changed(trajectory, stats=trajectory.stats | {"beyond": beyond})


def warn_beyond(model, beyond: Beyond | None, clocked: bool) -> None:
    """Warn where an input leaves what the law was fitted on, if that is known.
    Recordings that do are judged all the same, and show what it is worth there."""
    if beyond is None or not is_concrete(beyond.since) or not beyond.noticed:
        return
    said = beyond.in_words(model.fitted_range, model.units[0], clocked)
    warn(said)


def _unsettled(trajectory: Trajectory) -> bool:
    """Whether it is known that steps were too long, or may have been: they lose stiff
    laws too."""
    result = trajectory.result
    if not is_concrete(result._value):
        return False
    return bool(ended(result, RESULTS.inaccurate, RESULTS.diverged))


_NEARLY = 0.01  # of the largest output


def _nearly_known(trajectory: Trajectory) -> bool:
    """Whether an output is finite, and half as long steps hardly change it: that of a
    law that chatters about a limit, which no method follows closely."""
    traced = not is_concrete(trajectory.w)
    if traced or not ended(trajectory.result, RESULTS.inaccurate):
        return False
    size = float(jnp.max(jnp.abs(trajectory.w)))
    # Of a method of one's own nobody may know it.
    return float(trajectory.stats.get("error", jnp.inf)) <= _NEARLY * size


def first_output(w0: ArrayLike) -> Array:
    """One finite number; arrays of one number are taken for it."""
    try:
        first = jnp.asarray(w0)
    except (TypeError, ValueError):
        first = jnp.zeros(0)
    if first.size != 1 or jnp.iscomplexobj(first):
        raise InputError(
            "`w0` must be one number, the output at the first sample, got "
            f"{checks.described(w0)}; simulate from several with `jax.vmap`."
        )
    if is_concrete(first) and not np.all(np.isfinite(first)):
        raise InputError(f"`w0` must be finite, got {w0}.")
    # Of one type, whatever it came as: JAX compiles for each.
    return first.reshape(()).astype(jnp.result_type(float, first))


@jit
def _simulate(model, rows, inputs, w0, method, scale):
    """The run, and the size that its output is taken for, if there is no `scale` that
    of what is known of it."""
    model = model.restricted(rows)
    t, inputs = inputs.t, _in_order(inputs)
    path, w0 = _start(inputs, w0)
    if scale is None:
        size = jnp.max(jnp.abs(inputs.w if isinstance(inputs, Recording) else w0))
        scale = jnp.where(size > 0, size, 1.0).astype(path.t.dtype)
    w, result, stats = model.free_run(method, path, w0, scale)
    run = Trajectory(t, path.samples()[0], w, if_sorted(result, t), stats)
    return run, scale


def _in_order(inputs):
    """With other times where they do not increase, at which Diffrax would raise for all
    lanes; the result says what is wrong."""
    good, n = jnp.all(jnp.diff(inputs.t) > 0), inputs.t.shape[0]
    times = jnp.where(good, inputs.t, jnp.arange(n, dtype=inputs.t.dtype))
    return changed(inputs, t=times)


def _start(inputs, w0) -> tuple[AbstractInputPath, Array]:
    """The input between samples, and the output at the first."""
    if isinstance(inputs, Recording):
        path, w0 = inputs.path, inputs.w[0] if w0 is None else w0
    else:
        path = inputs
    return path, jnp.asarray(w0, path.t.dtype)


def where_lost(trajectory: Trajectory, first: int = 0) -> str:
    """From when on an output, or its input, is not finite, in words; rows count from
    `first`."""
    if not is_concrete(trajectory.w):  # while its derivative is being taken
        return ""
    lost = np.flatnonzero(~np.isfinite(np.asarray(trajectory.w + 0 * trajectory.u)))
    if not lost.size:
        return ""
    time = f"t = {moment(trajectory.t[lost[0]])} s, " if trajectory.clocked else ""
    return f"It was lost at {time}row {first + lost[0]}."


def generate(
    model: AbstractModel | Solution,
    excitation: AbstractExcitation,
    t: ArrayLike,
    *,
    w0: ArrayLike = 0.0,
    additive: ArrayLike = 0.0,
    multiplicative: ArrayLike = 0.0,
    key: PRNGKeyArray | None = None,
    method: AbstractSimulation = Adaptive(),
) -> Recording:
    """The recording that a device with a known law would give.

    **Arguments:**

    - `model`: the law.
    - `excitation`: the input as a function of time.
    - `t`: sample times, shape (n,), s.
    - `w0`: output at the first sample, output units.
    - `additive`: standard deviation of white Gaussian noise on the output, relative to
        the output's own standard deviation.
    - `multiplicative`: standard deviation of noise that multiplies the output by
        1 + noise.
    - `key`: a `jax.random` key; needed with noise.
    - `method`: how the law is integrated.

    **Returns:** a `Recording` that knows its input between the samples.

    **Raises:** `InputError` for noise without a key or a negative level;
    `ComputationError` when the law diverges.
    """
    model = as_model(model, "generate(model, excitation, t)")
    checks.kind(
        "excitation", excitation, AbstractExcitation, "excitation.Sine(1.0, 1.0)"
    )
    for name, level in (("additive", additive), ("multiplicative", multiplicative)):
        checks.positive(name, checks.number(name, level), zero=True)
    times = checks.vector("t", t)
    trajectory = simulate(model, excitation.path(times), w0=w0, method=method)
    w = _with_noise(trajectory.w, additive, multiplicative, key)
    return Recording(
        times,
        trajectory.u,
        w,
        names=model.names,
        units=model.units,
        interpolation=excitation.interpolation,
    )


def _with_noise(w, additive, multiplicative, key) -> Array:
    if key is None:
        if is_concrete(additive, multiplicative) and additive == multiplicative == 0:
            return w
        raise InputError("noise needs a `key`, such as `key=jax.random.key(0)`.")
    checks.key("key", key)
    first, second = jax.random.split(key)
    grown = w * (1 + multiplicative * jax.random.normal(first, w.shape, w.dtype))
    return grown + additive * jnp.std(w) * jax.random.normal(second, w.shape, w.dtype)


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
    - `w0`, `periodic`, `lead_in`: as `judge` was given them; and `whole`, the recording
        with the lead-in, `None` where that is `recording`.
    """

    recording: Recording
    trajectory: Trajectory
    errors: dict[str, Array]
    weights: Float[Array, " n"] | None = None
    w0: ArrayLike | None = None
    periodic: bool = eqx.field(default=False, static=True)
    lead_in: int | None = eqx.field(default=None, static=True)
    whole: Recording | None = None

    def alike(self, model: AbstractModel | AbstractSequenceModel) -> "Judgement":
        """Another law on the same samples, run as this one was; by `Automatic`."""
        recording, weights = self.recording, self.weights
        if self.whole is not None:
            recording = self.whole
            if weights is not None:  # those of the lead-in do not count
                left_out = jnp.zeros(len(recording) - len(weights))
                weights = jnp.concatenate([left_out, weights])
        return judge(
            model,
            recording,
            w0=self.w0,
            weights=weights,
            periodic=self.periodic,
            lead_in=self.lead_in,
        )

    def begun(self) -> str:
        """What the run began from, in words."""
        if self.periodic:
            return "In the steady state that the law comes to"
        start = "the first sample's output" if self.w0 is None else "a given output"
        behind = "" if self.whole is None else f", after {self.lead_in} samples more"
        return f"From {start} alone{behind}"

    @property
    def succeeded(self) -> bool:
        """Whether the free run reached the end. Concrete judgements only."""
        return bool(ended(self.trajectory.result, RESULTS.successful))

    def in_words(self) -> dict[str, str]:
        """The errors with their units, ratios in per cent, by what they are called;
        none for a law that diverges. Ratios to an output that stands still, or is
        zero, are undefined. Concrete judgements only."""
        errors = {name: float(value) for name, value in self.errors.items()}
        if not np.isfinite(errors["max_error"]):
            return {}
        told = {label: f"{100 * errors[name]:.4g} %" for name, label in RATIOS.items()}
        told["R²"] = f"{errors['r2']:.6g}"
        ratios = zip(told, (*RATIOS, "r2"), strict=True)
        told |= {x: "undefined" for x, name in ratios if not np.isfinite(errors[name])}
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
        were `bridged`, are simulated but not judged; a run begins at the first output
        whatever its weight, unless there is a `w0`. All count alike by default.
    - `periodic`: whether the recording is of whole periods of its input, evenly
        sampled, the first row not again at the end, of a device that has settled. The
        law is then judged in its steady state, in which it comes round to where it was:
        on the period after a lead-in.
    - `lead_in`: number of samples in which the law settles, which are not judged: the
        first of the recording, none by default; if `periodic`, of as many periods
        before it as that takes, by default nine of them.

    **Returns:** a `Judgement`, of the samples after the lead-in. If `periodic`, its
    `trajectory.stats["unsettled"]` is the largest difference between the period judged
    and the one before, output units; without a `lead_in` there is none. A law that
    diverges does not raise.

    **Raises:** `InputError` as `simulate` does, for weights of another length, negative
    ones, and none that is positive, for a lead-in that leaves nothing to judge, and for
    a recording that is not `periodic` but said to be. Warns where the law has not
    settled, and where the last row of a period is its first again.
    """
    checks.answers(periodic=periodic)
    model = as_model(model, "judge(model, recording)")
    as_recording(recording, "judge(model, recording)")
    lead_in = None if lead_in is None else checks.whole("lead_in", lead_in)
    asked = {"w0": w0, "periodic": periodic, "lead_in": lead_in}
    known = None if weights is None else checks.weights(weights, recording.w)
    whole = recording
    if periodic:
        lead_in = _PERIODS * len(recording) if lead_in is None else lead_in
        whole, _ = led_in(recording, None, lead_in, periodic)
    run = free_run(model, whole, w0, method)
    if periodic:
        run = with_beyond(model, last_period(run, recording))
    elif lead_in:
        asked["whole"] = recording
        recording, run, known = _behind(lead_in, recording, run, known)
        run = with_beyond(model, run)
    if known is not None and is_concrete(known) and not np.any(np.asarray(known) > 0):
        raise InputError("no sample has a weight, and there is nothing to judge.")
    errors = _errors(recording.w, run.w, known)
    return Judgement(recording, run, errors, known, **asked)


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


def last_period(run: Trajectory, recording: Recording) -> Trajectory:
    """The end of a run as that along the recording, and how it differs from the period
    before, as far as that was run. Warns where it does."""
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
        warn(
            f"the law has not settled: its last period differs by up to {by} from the "
            "one before. Give a longer `lead_in`; a law that never forgets how it "
            "began has no steady state.",
        )


def _errors(w, w_hat, weights) -> dict[str, Array]:
    if not is_concrete(w, w_hat, weights):
        return _measured_traced(w, w_hat, weights)
    # Not by JAX, which would compile for every length.
    w, w_hat = np.asarray(w), np.asarray(w_hat)
    weights = None if weights is None else np.asarray(weights)
    with np.errstate(all="ignore"):  # of outputs that are not finite
        return jax.device_put(_measured(w, w_hat, weights))


def _measured(w, w_hat, weights) -> dict[str, Any]:
    measures = (
        metrics.nrmse,
        metrics.relative_error,
        metrics.relative_squared_error,
        metrics.r2,
        metrics.rmse,
        metrics.max_error,
    )
    return {measure.__name__: measure(w, w_hat, weights) for measure in measures}


_measured_traced = jit(_measured)


def error_table(judgements: Mapping[str, Judgement]) -> list[list[str]]:
    """Errors by rows as cells of text, headings first; ratios in per cent."""
    check_judgements(judgements)
    checks.concrete("`hystjax.report.error_table`", judgements)
    table = [["rows", *RATIOS.values(), "R²", "largest error"]]
    for rows, judgement in judgements.items():
        told = judgement.in_words() or {"NRMSE": "diverged"}
        table.append([rows, *(told.get(each, "") for each in table[0][1:])])
    return table


def check_judgements(judgements: Any) -> None:
    """Raise `InputError` unless they are some, by the names of rows."""
    named = isinstance(judgements, Mapping) and len(judgements) > 0
    if not named or not all(isinstance(x, Judgement) for x in judgements.values()):
        raise InputError(
            "`judgements` must hold what `hystjax.judge` returned, by what its rows "
            "are, such as {'fitted': judge(law, record)}; got "
            f"{'none' if judgements == {} else checks.described(judgements)}."
        )
