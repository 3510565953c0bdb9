"""A device made to follow a reference, sample by sample and repetition by
repetition: feedforward, feedback, and learning."""

from functools import partial
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float, PRNGKeyArray

from ._core import checks
from ._core.checks import InputError
from ._core.compiling import changed, jit
from ._core.show import Card, Shown, samples_card
from ._core.solution import RESULTS, Solution, if_sorted, outcome
from .inversion import Inverse, invert
from .inversion._follow import Task, advanced, reach, started
from .inversion._invert import seen_of, steps_of, task_of
from .models import AbstractModel, AbstractSequenceModel, as_model
from .models._numbers import number
from .recording import Recording
from .signals import Signals
from .signals.excitation import AbstractExcitation
from .simulation import FixedStep, from_start

__all__ = [
    "PID",
    "Learning",
    "Tracking",
    "control",
]


def __dir__() -> list[str]:
    return __all__


class Loop(NamedTuple):
    """What a loop keeps from sample to sample.

    **Attributes:** the `integral`, input units; the `error` before, and its derivative
    as it was filtered, `slope`.
    """

    integral: Float[Array, ""]
    error: Float[Array, ""]
    slope: Float[Array, ""]


class Now(NamedTuple):
    """What a loop is given at a sample.

    **Attributes:** the `error` that was measured; lengths of the sample intervals
    `behind` (0 at the first sample) and `ahead`, s; the feedforward input at the end of
    the one ahead; and the lowest and highest input there.
    """

    error: Float[Array, ""]
    behind: Float[Array, ""]
    ahead: Float[Array, ""]
    feedforward: Float[Array, ""]
    low: Float[Array, ""]
    high: Float[Array, ""]


class PID(eqx.Module):
    """Feedback: proportional, integral, derivative.

    What is measured at a sample decides the input at the next: with the error
    e = reference - measured and the sample interval h

        u[k + 1] = feedforward[k + 1] + kp e[k] + z[k + 1] + kd d[k],
        z[k + 1] = z[k] + ki h e[k],    z[0] = 0,
        d[k] = (filter d[k - 1] + e[k] - e[k - 1]) / (filter + h),    d[0] = 0.

    The integral goes as far as the limits of u, and not beyond.

    **Attributes:** scalars.

    - `kp`: input over output units.
    - `ki`: the same, per s.
    - `kd`: the same, times s.
    - `filter`: time constant of a low-pass of the derivative, s, 0 for none.

    **Source:** Åström and Hägglund (1995), *PID Controllers: Theory, Design, and
    Tuning*, ISBN 1-55617-516-7, of which this is the conditional integration.
    """

    kp: Float[Array, ""] = eqx.field(converter=number, default=0.0)
    ki: Float[Array, ""] = eqx.field(converter=number, default=0.0)
    kd: Float[Array, ""] = eqx.field(converter=number, default=0.0)
    filter: Float[Array, ""] = eqx.field(converter=number, default=0.0)

    def __check_init__(self):
        checks.positive("filter", self.filter, zero=True)

    def __call__(self, loop: Loop, now: Now) -> tuple[Float[Array, ""], Loop]:
        """The next input, and what is kept."""
        usual = self.filter + now.behind
        changed = self.filter * loop.slope + now.error - loop.error
        known = now.behind > 0
        slope = jnp.where(known, changed / jnp.where(known, usual, 1.0), 0.0)
        rest = now.feedforward + self.kp * now.error + self.kd * slope
        more = self.ki * now.ahead * now.error
        # Upwards no further than the upper limit, which may be behind already.
        up = jnp.clip(now.high - rest - loop.integral, 0, jnp.maximum(more, 0))
        down = jnp.clip(now.low - rest - loop.integral, jnp.minimum(more, 0), 0)
        integral = loop.integral + jnp.where(more > 0, up, down)
        u = jnp.clip(rest + integral, now.low, now.high)
        return u, Loop(integral, now.error, slope)


class Learning(eqx.Module):
    """Iterative learning: the reference is repeated, each time from the same state, and
    the error of one time corrects the feedforward of the next,

        feedforward += gain * smoothed(reference - measured).

    On a device of slope s errors fall by the factor 1 - gain s each time; of noise
    learning keeps the less, the smaller the gain and the longer the smoothing.
    Smoothing looks ahead as well as back, so that it shifts nothing: one low-pass run
    forwards and then backwards. Slow errors pass it whole and fast ones are learned
    later, but none is learned with the wrong sign.

    **Attributes:**

    - `gain`: input over output units, a scalar.
    - `smoothing`: time constant of the low-pass, s, a scalar; 0 for none.
    - `repetitions`: how many times the reference is run, the first included.

    **Source:** Arimoto, Kawamura and Miyazaki (1984), doi 10.1002/rob.4620010203.
    """

    gain: Float[Array, ""] = eqx.field(converter=number)
    smoothing: Float[Array, ""] = eqx.field(converter=number, default=0.0)
    repetitions: int = eqx.field(
        converter=partial(checks.whole, "repetitions"), static=True, default=10
    )

    def __check_init__(self):
        checks.positive("smoothing", self.smoothing, zero=True)
        if self.repetitions < 1:
            raise InputError(
                "`repetitions` counts the first run too and must be at least 1, got "
                f"{self.repetitions}."
            )

    def correction(
        self, t: Float[Array, " n"], error: Float[Array, " n"]
    ) -> Float[Array, " n"]:
        """What is added to the feedforward after errors, reference - measured, at the
        times `t`."""
        some = self.smoothing > 0
        kept = jnp.exp(-jnp.diff(t) / jnp.where(some, self.smoothing, 1.0))
        kept = jnp.where(some, kept, 0.0)

        def follow(before, row):
            kept, now = row
            now = now + kept * (before - now)
            return now, now

        def low_pass(x, kept):
            later = jax.lax.scan(follow, x[0], (kept, x[1:]))[1]
            return jnp.concatenate([x[:1], later])

        forward = low_pass(error, kept)
        return self.gain * low_pass(forward[::-1], kept[::-1])[::-1]


class Tracking(Shown):
    """A device that was led along a reference.

    **Attributes:** each of shape (n,), but for the last three.

    - `t`: times, s.
    - `reference`: what the output was to be.
    - `u`: the input at these times, straight in between.
    - `w`: the output, without the noise of the sensor.
    - `measured`: what the sensor said.
    - `error`: by how much `w` is off the reference.
    - `names`, `units`, `clocked`: as of a `Trajectory`.
    """

    t: Float[Array, " n"]
    reference: Float[Array, " n"]
    u: Float[Array, " n"]
    w: Float[Array, " n"]
    measured: Float[Array, " n"]
    error: Float[Array, " n"]
    names: tuple[str, str] = eqx.field(static=True, default=("input", "output"))
    units: tuple[str, str] = eqx.field(static=True, default=("", ""))
    clocked: bool = eqx.field(static=True, default=True)

    def _card(self) -> Card | None:
        return samples_card("Tracking: a device under control", self)


def control(
    device: AbstractModel | AbstractSequenceModel | Solution,
    reference: Recording | AbstractExcitation | ArrayLike,
    t: ArrayLike | None = None,
    *,
    feedforward: AbstractModel | Solution | Inverse | ArrayLike | None = None,
    feedback: PID | None = None,
    learning: Learning | None = None,
    noise: ArrayLike = 0.0,
    key: PRNGKeyArray | None = None,
    u0: ArrayLike | None = None,
    limits: tuple[ArrayLike, ArrayLike] | None = None,
    speed: float | None = None,
    method: FixedStep = FixedStep(1),
) -> Solution:
    """Lead a device along a reference, and see how far it gets from it.

    The input of a device is the sum of a feedforward, known before, and of what a loop
    makes of the errors that a noisy sensor shows: what is measured at one sample
    decides the input at the next, to which it goes straight. With learning the
    reference is repeated, and the errors of one time correct the feedforward of the
    next. The device is any model with a step, and a twin of a real one where its law is
    another than the one that compensates it.

    **Arguments:**

    - `device`: the model that is led.
    - `reference`, `t`: what its output is to be, as for `hystjax.invert`: a recording,
        or an excitation or numbers, shape (n,), at the times `t`, s.
    - `feedforward`: a model, whose inverse is taken; or inputs, shape (n,), or what
        `hystjax.invert` found. A constant gain is the inverse of a straight line,
        `SparseModel.from_terms({"u": gain}, target="value")`. The input stays where it
        starts by default.
    - `feedback`: a `hystjax.compensation.PID`; none by default.
    - `learning`: a `hystjax.compensation.Learning`; none by default.
    - `noise`: standard deviation of the sensor's white Gaussian noise, output units;
        with a `key` of `jax.random`.
    - `u0`: the input before, where the device rests: by default a recording's first,
        that of a feedforward of numbers or of what `invert` found, or 0. A law of the
        rate keeps it for its first sample, and starts at the first of the reference;
        what follows at once is led to the first input from there.
    - `limits`: least and greatest input; a feedforward beyond them counts as the limit.
    - `speed`: most that the input may change a second.
    - `method`: the steps, of the device and of the inverse.

    **Returns:** a `Solution`: `value` is a `Tracking`, of the last repetition; `result`
    says `diverged` where the output did not stay finite. `stats`: `rms` and `largest`,
    of the error of the true output, in % of the stroke, which is the range of the
    reference; `saturated`, the share of samples at which the input is at a limit;
    `integral`, what the loop's integral adds to the input, shape (n,); and
    `repetitions`, the rms error of each, in %, shape (repetitions,).

    Everything has derivatives, in gains and in the numbers of device and compensator;
    seeds, references and gains are run side by side with `jax.vmap`.

    An output that sees the derivative of the input is that at the end of an interval.

    **Raises:** `InputError` for devices that are maps of sequences or come late, for
    noise without a key, constant references, inputs of another length than the
    reference, and limits that are none.

    **Example:**

    ```python
    device = hj.models.PrandtlIshlinskii([0.0, 0.2, 0.5], [0.5, 0.3, 0.2])
    known = hj.models.PrandtlIshlinskii([0.0, 0.25], [0.55, 0.45])  # roughly
    t = np.linspace(0, 4, 2001)
    loop = hj.compensation.PID(ki=20.0)
    for feedback in (None, loop):
        run = hj.control(device, np.sin(t), t, feedforward=known, feedback=feedback)
        print(f"{run.stats['rms']:.2f} % of the stroke")
    ```
    """
    model = as_model(device, "control(device, reference, t)", "device")
    if not isinstance(model, AbstractModel):
        raise InputError(
            f"{checks.described(model)} maps whole sequences, and has no step to be "
            "led by; fit a model that has one, such as a law, and take that."
        )
    _check_schemes(feedback, learning)
    given, before = _given(feedforward)
    if u0 is None and not isinstance(reference, Recording):
        u0 = before
    task = task_of(model, reference, t, u0, limits, speed, "control")
    no_stroke = "without a stroke no error is a share of it."
    checks.not_constant("reference", task.reference, no_stroke)
    if feedforward is None:
        given = jnp.full_like(task.t, task.u)
    elif given is None:
        options = {"u0": u0, "limits": limits, "speed": speed, "method": method}
        compensator: Any = feedforward
        if isinstance(compensator, Solution):  # how certain a fit is does not matter
            compensator = compensator.value
        given = invert(compensator, reference, t, **options).value.u
    checks.same_length(reference=task.reference, feedforward=given)
    drawn = _drawn(noise, key, learning, task.t)
    model = model.restricted(model.rows_in_use)
    learning = Learning(0.0, repetitions=1) if learning is None else learning
    run = _controlled(
        model, task, steps_of(method), given, feedback or PID(), learning, drawn
    )
    return changed(run, value=changed(run.value, **seen_of(model, reference)))


def _check_schemes(feedback: Any, learning: Any) -> None:
    for name, value, kind in (
        ("feedback", feedback, PID),
        ("learning", learning, Learning),
    ):
        if value is not None and not isinstance(value, kind):
            raise InputError(
                f"`{name}` must be a `hystjax.compensation.{kind.__name__}` or None, "
                f"got {checks.described(value)}."
            )


def _given(feedforward: Any) -> tuple[Array | None, Array | None]:
    """Inputs that are known, and the input before them; `None` for models and for
    nothing."""
    if isinstance(feedforward, Solution):
        feedforward = feedforward.value
    if isinstance(feedforward, Inverse):
        first = feedforward.u[0] if feedforward.u0 is None else feedforward.u0
        return feedforward.u, first
    if feedforward is None or isinstance(
        feedforward, AbstractModel | AbstractSequenceModel
    ):
        return None, None
    inputs = checks.vector("feedforward", feedforward)
    checks.finite("feedforward", inputs)
    return inputs, inputs[0] if inputs.size else None


def _drawn(noise, key, learning, t) -> Float[Array, "r n"]:
    """The sensor's noise in each repetition."""
    shape = (1 if learning is None else learning.repetitions, len(t))
    size = checks.number("noise", noise)
    checks.positive("noise", noise, zero=True)
    if key is None:
        # By what was given: under `jit` the number is one of the program.
        if not checks.is_concrete(noise) or noise != 0:
            raise InputError("`noise` needs a `key`, such as `key=jax.random.key(0)`.")
        return jnp.zeros(shape, t.dtype)
    checks.key("key", key)
    return size * jax.random.normal(key, shape, t.dtype)


@jit
def _controlled(device, task, substeps, feedforward, feedback, learning, noise):
    """All repetitions, of which each corrects the feedforward of the next."""
    low, high = task.low, task.high

    def repeat(inputs, drawn):
        run = _run(device, task, substeps, inputs, feedback, drawn)
        off = task.reference - (run.w + drawn)
        # Beyond a limit nothing is learned that would have to be forgotten.
        better = jnp.clip(inputs + learning.correction(task.t, off), low, high)
        return better, run

    _, runs = jax.lax.scan(repeat, jnp.clip(feedforward, low, high), noise)
    errors = runs.w - task.reference
    stroke = jnp.max(task.reference) - jnp.min(task.reference)
    every = 100 / stroke * jnp.sqrt(jnp.mean(errors**2, axis=-1))
    run, error = jax.tree.map(lambda each: each[-1], (runs, errors))
    value = Tracking(task.t, task.reference, run.u, run.w, run.w + noise[-1], error)
    stats = {
        "rms": every[-1],
        "largest": 100 / stroke * jnp.max(jnp.abs(error)),
        "saturated": jnp.mean((run.u <= low) | (run.u >= high), dtype=run.u.dtype),
        "integral": run.integral,
        "repetitions": every,
    }
    finite = jnp.all(jnp.isfinite(runs.w)) & jnp.all(jnp.isfinite(runs.u))
    result = outcome(finite, RESULTS.diverged)
    return Solution(value, if_sorted(result, task.t), stats)


class _Run(NamedTuple):
    """Inputs, true outputs and what the integral adds, at the samples."""

    u: Float[Array, " n"]
    w: Float[Array, " n"]
    integral: Float[Array, " n"]


def _run(
    device: AbstractModel,
    task: Task,
    substeps: int,
    feedforward: Float[Array, " n"],
    feedback: PID,
    noise: Float[Array, " n"],
) -> _Run:
    """The reference once."""
    zero = jnp.zeros_like(task.u)
    x, m = started(device, task)
    rest = Signals(task.t[0], task.u, zero)
    # Where something flows a leap would be one of the rate, which nobody can make.
    u = task.u if jax.tree.leaves(x) else feedforward[0]
    first = rest._replace(u=u)
    m = device.memory.after(m, rest, first)
    w = device.output(x, m, first)

    def follow(carry, row):
        (state, u, w, loop), (t, later, behind, wanted, drawn, ahead) = carry, row
        h = later - t
        limits = reach(task, (t, later, u, wanted))
        now = Now(wanted - (w + drawn), behind, h, ahead, *limits)
        v, loop = feedback(loop, now)
        x, m = advanced(device, state, ((t, u), (later, v)), substeps)
        w = device.output(x, m, Signals(later, v, (v - u) / h))
        return ((x, m), v, w, loop), _Run(v, w, loop.integral)

    t, reference = task.t, task.reference
    behind = jnp.diff(t, prepend=t[:1])[:-1]
    rows = (t[:-1], t[1:], behind, reference[:-1], noise[:-1], feedforward[1:])
    begin = (x, m), u, w, Loop(zero, zero, zero)
    _, later = jax.lax.scan(follow, begin, rows)
    return from_start(_Run(u, w, zero), later)
