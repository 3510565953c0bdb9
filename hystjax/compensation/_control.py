"""A device led along a reference, sample by sample, and repetition by repetition."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float, PRNGKeyArray

from .._core import checks
from .._core.errors import InputError
from .._core.jit import jit
from .._core.show import Card, Shown, samples_card
from .._core.solution import RESULTS, Solution, if_sorted, outcome
from ..inversion import Inverse, invert
from ..inversion._follow import Task, advanced, reach, started
from ..inversion._invert import task_of
from ..models import AbstractModel, AbstractSequenceModel, as_model
from ..recording import Recording
from ..signals import Signals
from ..signals.excitation import AbstractExcitation
from ..simulation import FixedStep
from ._schemes import PID, Learning, Loop, Now


class Tracking(Shown):
    """A device that was led along a reference.

    **Attributes:** each of shape (n,).

    - `t`: times, s.
    - `reference`: what the output was to be.
    - `u`: the input at these times, straight in between.
    - `w`: the output, without the noise of the sensor.
    - `measured`: what the sensor said.
    - `error`: by how much `w` is off the reference.
    """

    t: Float[Array, " n"]
    reference: Float[Array, " n"]
    u: Float[Array, " n"]
    w: Float[Array, " n"]
    measured: Float[Array, " n"]
    error: Float[Array, " n"]

    def _card(self) -> Card | None:
        return samples_card("Tracking: a device under control", self.t, self.u, self.w)


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
    limits: tuple[float, float] | None = None,
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
        that of a feedforward of numbers, or 0. A law of the rate keeps it for its first
        sample, and starts at the first of the reference; what follows at once is led to
        the first input from there.
    - `limits`: least and greatest input.
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
    noise without a key, inputs of another length than the reference, and limits that
    are none.

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
    model = as_model(device, "control(device, reference, t)")
    if not isinstance(model, AbstractModel):
        raise InputError(
            f"a {type(model).__name__} maps whole sequences, and has no step to be led "
            "by; fit a model that has one, such as a law, and take that."
        )
    _check_schemes(feedback, learning)
    given = _given(feedforward)
    if u0 is None and given is not None and not isinstance(reference, Recording):
        u0 = given[0]
    task = task_of(model, reference, t, u0, limits, speed)
    if feedforward is None:
        given = jnp.full_like(task.t, task.u)
    elif given is None:
        options = {"u0": u0, "limits": limits, "speed": speed, "method": method}
        compensator: Any = feedforward  # a model, or the solution that has one
        given = invert(compensator, reference, t, **options).value.u
    checks.same_length(reference=task.reference, feedforward=given)
    drawn = _drawn(noise, key, learning, task.t)
    model = model.restricted(model.rows_in_use())
    learning = Learning(0.0, repetitions=1) if learning is None else learning
    return _controlled(
        model, task, method.substeps, given, feedback or PID(), learning, drawn
    )


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


def _given(feedforward: Any) -> Array | None:
    """Inputs that are known; `None` for models and for nothing."""
    if isinstance(feedforward, Solution):
        feedforward = feedforward.value
    if isinstance(feedforward, Inverse):
        return feedforward.u
    if feedforward is None or isinstance(
        feedforward, AbstractModel | AbstractSequenceModel
    ):
        return None
    inputs = checks.vector("feedforward", feedforward)
    checks.finite("feedforward", inputs)
    return inputs


def _drawn(noise, key, learning, t) -> Float[Array, "r n"]:
    """The sensor's noise in each repetition."""
    shape = (1 if learning is None else learning.repetitions, len(t))
    checks.positive("noise", noise, zero=True)
    if key is None:
        if not checks.is_concrete(noise) or noise != 0:
            raise InputError("`noise` needs a `key`, such as `key=jax.random.key(0)`.")
        return jnp.zeros(shape, t.dtype)
    checks.key("key", key)
    return noise * jax.random.normal(key, shape, t.dtype)


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
    # The range of a reference that never changes is none to measure errors by.
    stroke = jnp.max(task.reference) - jnp.min(task.reference)
    every = 100 / stroke * jnp.sqrt(jnp.mean(errors**2, axis=-1))
    run, error = jax.tree.map(lambda each: each[-1], (runs, errors))
    value = Tracking(task.t, task.reference, run.u, run.w, run.w + noise[-1], error)
    stats = {
        "rms": every[-1],
        "largest": 100 / stroke * jnp.max(jnp.abs(error)),
        "saturated": jnp.mean((run.u <= low) | (run.u >= high)),
        "integral": run.integral,
        "repetitions": every,
    }
    result = outcome(jnp.all(jnp.isfinite(runs.w)), RESULTS.diverged)
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
    return jax.tree.map(lambda a, b: jnp.append(a, b), _Run(u, w, zero), later)
