"""The input that makes a device follow; and inverses that are known: that of plays in
parallel, which is plays in parallel again, and that of relays that stand as a
staircase, of which the input has to come to a level."""

from dataclasses import replace
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Bool, Float

from .._core import checks
from .._core.checks import InputError, is_concrete
from .._core.compiling import changed, jit
from .._core.show import Card, Shown, samples_card
from .._core.solution import RESULTS, AbstractFindings, Solution, if_sorted, outcome
from ..library import AbstractMemory, Plays, Staircase
from ..library._memory import along_turns
from ..library._operators import Play, Stop
from ..models import (
    AbstractModel,
    AbstractSequenceModel,
    Beyond,
    as_model,
    check_answers,
    comes_late,
    sees,
)
from ..models._base import names_and_units
from ..models._sequence import warn_of_units
from ..recording import LongRecording, Recording, as_recording
from ..refinement import deviations, known_covariance
from ..signals import AbstractInputPath, Linear, Signals
from ..signals.excitation import AbstractExcitation, times_of
from ..simulation import FixedStep, first_state
from ..simulation._simulate import warn_beyond
from ._follow import (
    Followed,
    Task,
    Way,
    at_roots,
    comes_closer,
    driven,
    followed,
    found,
    sized,
    started,
    steps_hold,
)

_NOTHING = 1e-12  # of the steepest slope


class Stack(NamedTuple):
    """w = offset + sum of weights[i] play(u, radii[i]).

    **Attributes:** radii, rising from 0; `slopes`, sums of the weights up to each: of a
    first loading, and of every branch after a turn; and the offset. Of NumPy, until
    they are part of a program.
    """

    radii: Any
    slopes: Any
    offset: Any

    @property
    def margin(self) -> float:
        """The least slope, negative if not all have one sign; 0 for rounding of 0."""
        least = float(np.min(np.sign(self.slopes[0]) * self.slopes))
        return 0.0 if abs(least) < _NOTHING * np.max(np.abs(self.slopes)) else least


def stack_of(model: AbstractModel) -> Stack | None:
    """The model as plays in parallel, where it says that it is: a sum of the input,
    plays and stops of it, and a constant."""
    if not is_concrete(*jax.tree.leaves(model)) or model.target != "value":
        return None
    with jax.ensure_compile_time_eval():  # known numbers stay known under `jit`
        addends = model.settled().addends()
    if addends is None:
        return None
    weights: dict[float, float] = {0.0: 0.0}
    offset = 0.0
    for value, term in addends:
        (variable, power), *others = term.factors or ((None, 1),)
        if others or power != 1:
            return None
        if variable is None:
            offset += value
        elif variable.name == "u":
            weights[0.0] += value
        elif isinstance(variable, Play) and variable.of == "u":
            radius = float(variable.radius)
            if isinstance(variable, Stop):  # the input less a play
                weights[0.0] += value
                value = -value
            weights[radius] = weights.get(radius, 0.0) + value
        else:
            return None
    radii = np.array(sorted(weights))
    slopes = np.cumsum([weights[r] for r in radii])
    return Stack(radii, slopes, offset)


def unstacked(
    stack: Stack,
    plays: Float[Array, " k"],
    t: Float[Array, " n"],
    w: Float[Array, " n"],
) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
    """The inputs at which the stack has the outputs w, exactly, and its outputs there.

    A branch of the stack bends where the input has gone twice a radius from its turn;
    at that output the branch of the inverse does. Its radii so are the outputs of a
    first loading, and its slopes the inverse ones.

    **Arguments:** the stack; its plays before; and times and outputs.

    **Source:** Krejčí and Kuhnen (2001), doi 10.1049/ip-cta:20010375.
    """
    stack = jax.tree.map(lambda x: jnp.asarray(x, w.dtype), stack)
    sign, own = jnp.sign(stack.slopes[0]), jnp.diff(stack.slopes, prepend=0.0)
    loading = jnp.cumsum(jnp.abs(stack.slopes[:-1]) * jnp.diff(stack.radii))
    radii = jnp.concatenate([jnp.zeros(1, w.dtype), loading])
    weights = sign * jnp.diff(1 / jnp.abs(stack.slopes), prepend=0.0)
    # Where the inverse's plays stand: what the output would be if all plays of smaller
    # radii had come no further than this one.
    beyond = own @ plays - jnp.cumsum(own * plays)
    first = sign * (stack.slopes * plays + beyond)
    u = _run(radii, first, t, sign * (w - stack.offset)) @ (sign * weights)
    forward = _run(stack.radii, plays, t, u)
    return u, forward @ own + stack.offset


def _run(radii, before, t, u) -> Float[Array, "n k"]:
    """Plays at samples, from where they were before the first."""
    memory, zero = Plays(radii), jnp.zeros_like(u[0])
    # The first, of radius 0, is where the input was.
    m = memory.after(before, Signals(t[0], before[0], zero), Signals(t[0], u[0], zero))
    starts, _, ends = memory.along(m, Linear().path(t, u).grid(1))
    return jnp.concatenate([starts[:1], ends])


_ROUNDING = 1e-9  # of what the output can change by


class _Standing(NamedTuple):
    """A state on the way: the heights of the staircase, the input, and what the output
    is and was to be; the outputs to which each level would lead from here; and whether
    until here these rose with the levels, or fell."""

    heights: Any
    u: Float[Array, ""]
    w: Float[Array, ""]
    target: Float[Array, ""]
    ahead: Float[Array, " n"]
    one_way: Bool[Array, ""]


def switched(
    model: AbstractModel, memory: Staircase, task: Task
) -> tuple[Float[Array, " n"], Float[Array, " n"], Bool[Array, ""]]:
    """The inputs that bring the output as close to the reference as it comes on the way
    there, and the outputs; and whether outputs rose with the levels all along, or all
    along fell, without which the way there need not be the shortest.

    As long as the reference goes one way so does the input, and which level it has to
    come to can be told for all samples at once from the outputs that lay ahead where
    the reference turned.
    """
    levels = memory.levels
    x = model.start(task.m, _at(task.u), task.reference[0])

    def output(heights):
        return model.output(x, heights, _at(task.u))  # whatever the input is

    def outputs_ahead(heights):
        return jax.vmap(lambda u: output(memory.after(heights, _at(u), _at(u))))(levels)

    ahead = outputs_ahead(task.m)
    span = ahead[-1] - ahead[0]
    sign = jnp.sign(span)

    def after(state: _Standing, target):
        onward = sign * (target - state.target) * (levels - state.u) > 0
        off = jnp.where(onward, jnp.abs(state.ahead - target), jnp.inf)
        # Of levels that do as well the one that is least far.
        far = jnp.where(off == jnp.min(off), jnp.abs(levels - state.u), jnp.inf)
        level = jnp.argmin(far)
        moves = off[level] < jnp.abs(state.w - target)
        u = jnp.where(moves, levels[level], state.u)
        w = jnp.where(moves, state.ahead[level], state.w)
        heights = memory.after(state.heights, _at(u), _at(u))
        rises = jnp.min(sign * jnp.diff(state.ahead)) >= -_ROUNDING * jnp.abs(span)
        one_way = state.one_way & rises
        return _Standing(heights, u, w, target, outputs_ahead(heights), one_way)

    def seen(state: _Standing, target):
        return state.u, state.w, state.one_way

    w = output(task.m)
    before = _Standing(task.m, task.u, w, w, ahead, jnp.array(True))
    reference = task.reference
    first = after(before, reference[0])
    u, w, one_way = along_turns(after, first, reference, reference, seen)
    return u, w, jnp.all(one_way)


def _at(u: Float[Array, ""]) -> Signals:
    """An input that stands still, of which relays see nothing else."""
    return Signals(jnp.zeros_like(u), u, jnp.zeros_like(u))


_PROBE = 1e-3  # first difference of inputs, over their range


class Inverse(Shown):
    """An input, and what it makes of a device.

    **Attributes:** each of shape (n,), but for the last four.

    - `t`: times, s.
    - `u`: the input at these times, straight in between.
    - `w`: the output that it leads to.
    - `error`: by how much that is off the reference.
    - `u0`: the input before, where the device rests, a scalar; the first of `u` is
        where it leaps from there.
    - `names`, `units`, `clocked`: as of a `Trajectory`.
    """

    t: Float[Array, " n"]
    u: Float[Array, " n"]
    w: Float[Array, " n"]
    error: Float[Array, " n"]
    u0: Float[Array, ""] | None = None
    names: tuple[str, str] = eqx.field(static=True, default=("input", "output"))
    units: tuple[str, str] = eqx.field(static=True, default=("", ""))
    clocked: bool = eqx.field(static=True, default=True)

    def _card(self) -> Card | None:
        title = f"Inverse: the {self.names[0]} that leads to the {self.names[1]}"
        return samples_card(title, self)


class Inverted(AbstractFindings):
    """An input that was found. **Attributes:** the `Inverse`, the `value`, and the
    `result`; all others are what `invert` tells in `stats`, by the same names."""

    value: Inverse
    result: RESULTS
    reached: Bool[Array, " n"]
    first_missed: Float[Array, ""]
    margin: Float[Array, " n"]
    beyond: Beyond | None = None
    u_standard_errors: Float[Array, " n"] | None = None


def invert(
    model: AbstractModel | AbstractSequenceModel | Solution,
    reference: Recording | AbstractExcitation | ArrayLike,
    t: ArrayLike | None = None,
    *,
    u0: ArrayLike | None = None,
    limits: tuple[ArrayLike, ArrayLike] | None = None,
    speed: float | None = None,
    method: FixedStep = FixedStep(),
) -> Solution:
    """The input that makes the output of a device follow a reference.

    Plays in parallel are inverted as what they are, by plays of the output, exactly,
    and relays of weights of one sign by the level that the input has to come to, going
    the way of the reference, at which the output is as close to that as it gets. For
    all other models one equation a sample is solved, for the input at its end, through
    the same `step` that simulates: by Newton's method, and where that does not do, by
    intervals that hold a root. So hidden states, creep and what the memory holds are in
    it, and `simulate` with the same `method` gives the reference back. Where its steps
    are too long for a leap, so that half as long ones end elsewhere, nothing is reached
    from there on.

    An output that sees the derivative of the input, as that of a damper does, is at
    each sample made by the input at the next. The last sample then is nobody's: it is
    not `reached`, and does not count for the `result`.

    **Arguments:**

    - `model`: the device.
    - `reference`: what the output is to be: that of a recording, from whose first input
        (and what was before, where it is known) the device starts; or numbers, shape
        (n,), or an excitation, at the times `t`.
    - `t`: times, shape (n,), s; those of a recording by default.
    - `u0`: the input at the start, by default a recording's first, or else 0. A law of
        the rate keeps it for its first sample; what follows at once is led to the
        first output from there.
    - `limits`: least and greatest input. A device that starts outside of them, at its
        `u0`, comes back as soon as it may.
    - `speed`: most that the input may change a second. Where nothing answers so soon,
        as in a backlash, the input goes so fast to where something does.
    - `method`: the steps.

    **Returns:** a `Solution`: `value` is an `Inverse`; `result` says `unreachable`
    where some output cannot be had. `stats`: `reached`, where it is, shape (n,);
    `first_missed`, the time of the first sample that is not, s, or NaN; and `margin`,
    shape (n,), by how much the output changes with the input, in the direction in which
    it does so less, output over input units; that is counted the way in which it does
    on the whole. Where it is zero or less, the input is not the only one that would do:
    for a law w' = a + b u' + c |u'| it is |b| - |c|, for plays in parallel the least
    slope. Of models that know the inputs that they were
    fitted on also `beyond`, a `models.Beyond`: how far the input is outside of these;
    how fast it is does not count, for noise on a reference makes it so. Of the
    `Solution` of `hystjax.refine` also `u_standard_errors`, shape (n,), input units:
    what the covariance of the fitted numbers makes of the input at each sample for
    itself, linearised, those that were `fixed` or `tied` taken for known; NaN where the
    margin is zero.

    Derivatives of `value.u` in the model's numbers and in the reference are those of
    the roots; batches are made with `jax.vmap`.

    **Raises:** `InputError` for models that are maps of sequences or come late, for
    arrays without times or of another length, limits that are none, or do not hold
    the 0 that the input starts at without `u0`, and a speed where there is no clock.
    Warns where the input goes farther than those that the model was fitted on, by how
    much and from when.
    """
    device = as_model(model, "invert(model, reference)")
    if not isinstance(device, AbstractModel):
        raise InputError(
            f"{checks.described(device)} maps whole sequences, and has no step to "
            "invert."
        )
    task = task_of(device, reference, t, u0, limits, speed)
    free, substeps = limits is None and speed is None, steps_of(method)
    bare = device.fitted_on(None)  # of which what is compiled serves a guess too
    inverse, seen = _inverted(bare, task, substeps, free), seen_of(device, reference)
    if device.fitted_range is not None:
        t, u = inverse.value.t, inverse.value.u
        beyond = device.fitted_range.left_by(t, u, any_rate=True)
        inverse = replace(inverse, beyond=beyond)
        warn_beyond(device, beyond, seen["clocked"])
    names, covariance = known_covariance(model)
    if names:
        way = _way(bare, substeps)
        errors = _standard_errors(bare, task, way, inverse, names, covariance)
        inverse = replace(inverse, u_standard_errors=errors)
    return replace(inverse, value=changed(inverse.value, **seen)).solution()


def seen_of(model: AbstractModel, reference: Any) -> dict[str, Any]:
    """Names and units of what a device does along a reference, and whether that has a
    clock."""
    if not isinstance(reference, Recording):
        return {"names": model.names, "units": model.units, "clocked": True}
    return {**names_and_units(model, reference), "clocked": reference.clocked}


def _inverted(model: AbstractModel, task: Task, substeps: int, free: bool) -> Inverted:
    """By what suits the model; `free` where no limits are to be kept."""
    stack = stack_of(model)
    if stack is not None and stack.margin > 0 and free:
        radii = Plays(jnp.asarray(stack.radii, task.t.dtype))
        plays = _remembered(radii, task.past, task.t[0], task.u)
        return _by_stack(task, plays, stack, np.asarray(stack.margin))
    way = _way(model, substeps)
    model = model.restricted(model.rows_in_use)
    if not is_concrete(*jax.tree.leaves((model, task))):
        return _by_roots(model, task, way)[0]
    memory = model.memory
    if isinstance(memory, Staircase) and not sees(model, "u") and free:
        by_levels, shortest = _by_levels(model, memory, task)
        if bool(shortest):
            return by_levels
    # Seldom are both needed, and each takes its time to compile.
    quick, closer = _by_roots(model, task, way._replace(slowly=False))
    if bool(closer & (quick.result == RESULTS.successful)):
        return quick
    return _by_roots(model, task, way._replace(slowly=True))[0]


def _way(model: AbstractModel, substeps: int) -> Way:
    return Way(substeps, sees(model, "du"))


@jit
def _by_stack(
    task: Task, plays: Float[Array, " k"], stack: Stack, least: ArrayLike
) -> Inverted:
    u, w = unstacked(stack, plays, task.t, task.reference)
    margin = jnp.full_like(u, least)
    return _ended(task, Followed(u, w, margin), False)


@jit
def _by_levels(
    model: AbstractModel, memory: Staircase, task: Task
) -> tuple[Inverted, Bool[Array, ""]]:
    u, w, shortest = switched(model, memory, task)
    # Between levels nothing answers.
    return _ended(task, Followed(u, w, jnp.zeros_like(u)), False), shortest


@jit
def _by_roots(
    model: AbstractModel, task: Task, way: Way
) -> tuple[Inverted, Bool[Array, ""]]:
    allowed, task = _allowed(task), sized(model, task, way)
    u = found(model, task, way, allowed)
    run = driven(model, task, way, u)
    closer = comes_closer(model, task, way, *run, allowed)
    held, along = steps_hold(model, task, way, *run), followed(model, task, way, *run)
    return _ended(task, along, way.immediate, held), closer


@jit
def _standard_errors(
    model: AbstractModel,
    task: Task,
    way: Way,
    inverse: Inverted,
    names: tuple[str, ...],
    covariance: Float[ArrayLike, "p p"],
) -> Float[Array, " n"]:
    """Of inputs that were found, as the numbers of the model are not known better."""
    own = model.parameters()
    flows = bool(jax.tree.leaves(started(model, task)[0]))
    u = inverse.value.u[1:] if flows or way.immediate else inverse.value.u

    def inputs(values: Float[Array, " p"]) -> Float[Array, " m"]:
        device = model.with_parameters(dict(zip(names, values, strict=True)))
        m = _remembered(device.memory, task.past, task.t[0], task.u)
        return at_roots(device, eqx.tree_at(lambda task: task.m, task, m), way, u)

    values = jnp.array([own[name] for name in names], task.t.dtype)
    errors = deviations(jax.jacfwd(inputs)(values), covariance)
    # The first input is known where it leads nowhere by itself.
    errors = jnp.concatenate([jnp.zeros(len(task.t) - len(u)), errors])
    return jnp.where(inverse.margin == 0, jnp.nan, errors)


def _ended(
    task: Task, followed: Followed, immediate: bool, held: ArrayLike = True
) -> Inverted:
    error = followed.w - task.reference
    reached = (jnp.abs(error) <= 64 * _allowed(task)) & held
    missed = ~reached
    if immediate:  # no input makes the last output, which is neither
        reached, missed = reached.at[-1].set(False), missed.at[-1].set(False)
    first = jnp.min(jnp.where(missed, task.t, jnp.inf))
    result = outcome(~jnp.any(missed), RESULTS.unreachable)
    return Inverted(
        value=Inverse(task.t, followed.u, followed.w, error, task.u),
        result=if_sorted(result, task.t),
        reached=reached,
        first_missed=jnp.where(jnp.isfinite(first), first, jnp.nan),
        margin=followed.margin,
    )


def _allowed(task: Task) -> Float[Array, ""]:
    """How far outputs may be off: some rounding of theirs."""
    rounding = 2**14 if task.t.dtype == jnp.float64 else 2**6
    return rounding * jnp.finfo(task.t.dtype).eps * task.size


def task_of(model, reference, t, u0, limits, speed, verb: str = "invert") -> Task:
    """What is to be followed, checked: for `invert`, and for other verbs."""
    check_answers(model)
    _check_one(reference, verb)
    if isinstance(reference, Recording):
        if t is not None:
            raise InputError("`t` is for arrays and excitations; a recording has one.")
        model.check_times(reference.t, reference.clocked)
        warn_of_units(model, reference)
        times, w = reference.t, reference.w
        u = reference.u[0] if u0 is None else checks.number("u0", u0)
        span = jnp.max(reference.u) - jnp.min(reference.u)
        still = is_concrete(span) and span == 0
        guess = None if still else _PROBE * jnp.where(span > 0, span, 1.0)
    else:
        times, w = _given(reference, t, verb)
        u = checks.number("u0", 0.0 if u0 is None else u0)
        guess = None  # whatever the unit of the input
    u = u.astype(times.dtype)
    if is_concrete(u) and not np.isfinite(np.asarray(u)):
        raise InputError(f"`u0` must be finite, got {u0}.")
    low, high = _ends((-np.inf, np.inf) if limits is None else limits)
    unknown = u0 is None and not isinstance(reference, Recording)
    if unknown and is_concrete(low, high) and not low <= 0 <= high:
        raise InputError(
            f"`limits` {limits!r} do not hold 0, where the input starts without `u0`: "
            "give that, the input at which the device is."
        )
    if speed is not None:
        check_clock(not isinstance(reference, Recording) or reference.clocked)
    fastest = checks.number("speed", np.inf if speed is None else speed)
    checks.positive("speed", fastest)
    past = reference.path if isinstance(reference, Recording) and u0 is None else None
    if comes_late(model):
        raise InputError(
            f"the output of this {type(model).__name__} comes late, and what is past "
            "cannot be changed; take its `device`, and shift the reference."
        )
    m = _remembered(model.memory, past, times[0], u)
    ends = low.astype(times.dtype), high.astype(times.dtype)
    size = _size(model, m, Signals(times[0], u, jnp.zeros_like(u)), w)
    return Task(times, w, u, past, m, *ends, fastest.astype(times.dtype), guess, size)


def check_clock(clocked: bool) -> None:
    """Raise `InputError` for a speed where no seconds are known."""
    if not clocked:
        raise InputError(
            "`speed` is the change of the input in a second, and the recording has no "
            "clock: leave it out, or give the times."
        )


def _size(model: AbstractModel, m: Any, now: Signals, w: Float[Array, " n"]):
    first = model.output(first_state(model, m, now, w[0]), m, now)
    sizes = jnp.max(jnp.abs(w)), jnp.abs(first), jnp.ones_like(first)
    return jnp.select([size > 0 for size in sizes], sizes)


def _check_one(reference: Any, verb: str) -> None:
    if isinstance(reference, Recording | LongRecording):
        as_recording(reference, f"{verb}(model, reference)", "reference")
    several = isinstance(reference, list | tuple)
    if several and any(isinstance(each, Recording) for each in reference):
        raise InputError(
            f"`reference` must be one recording, got {checks.described(reference)} of "
            f"{len(reference)}: `{verb}` follows one. Give one at a time, such as "
            "`recordings[0]`, in a loop where there are several."
        )


def _ends(limits: Any) -> tuple[Array, Array]:
    try:
        low, high = (checks.number("limits", end) for end in limits)
    except (TypeError, ValueError):  # other than two, or no numbers
        low = high = jnp.zeros(())
    if is_concrete(low, high) and not low < high:
        raise InputError(f"`limits` must be two rising numbers, got {limits!r}.")
    return low, high


def steps_of(method: Any) -> int:
    """Steps a sample interval of a method that is a `FixedStep`."""
    if not isinstance(method, FixedStep):
        raise InputError(
            f"`method` must be a `hystjax.simulation.FixedStep`, got "
            f"{checks.described(method)}: inputs are found step by step, and other "
            "methods would take other steps for each that is tried."
        )
    return method.substeps


@jit
def _remembered(
    memory: AbstractMemory, past: AbstractInputPath | None, t: Any, u: Any
) -> Any:
    """What is remembered at the first sample, of what was before, where that is known:
    compiled once, for it may be long."""
    if past is not None:
        return memory.first(past)
    return memory.start(Signals(t, u, jnp.zeros_like(u)))


def _given(reference: Any, t: ArrayLike | None, verb: str):
    if t is None:
        raise InputError(
            "`t`, the times of the reference, is needed; only a recording has its own."
        )
    times = times_of(t, f"`{verb}`")
    if isinstance(reference, AbstractExcitation):
        return times, jax.vmap(reference)(times)
    w = checks.vector("reference", reference)
    checks.same_length(t=times, reference=w)
    checks.finite("reference", w)
    return times, w
