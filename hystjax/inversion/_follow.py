"""A device made to follow a reference, sample by sample."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ..library import at
from ..models import AbstractModel
from ..signals import AbstractInputPath, Grid, Signals
from ..simulation import first_state, from_start, step
from ..simulation._steps import parted


class Task(eqx.Module):
    """What is to be followed.

    **Attributes:**

    - `t`, `reference`: times, s, and the output there, shape (n,).
    - `u`: the input at the start, where the device has been until then.
    - `past`: what the input was before, `None` where that is not known; `m`: the state
        of the device's memory at the start.
    - `low`, `high`: least and greatest input; `speed`: how much it may change a second.
    - `guess`: an input difference to start from, positive; `None` where that is not
        known, before `sized`.
    - `size`: of outputs: the largest of the reference, or of one that is zero all along
        that at the start, or 1.
    """

    t: Float[Array, " n"]
    reference: Float[Array, " n"]
    u: Float[Array, ""]
    past: AbstractInputPath | None
    m: Any
    low: Float[Array, ""]
    high: Float[Array, ""]
    speed: Float[Array, ""]
    guess: Any
    size: Float[Array, ""]


class Followed(NamedTuple):
    """Inputs and outputs at the samples; and how much the output changes with the
    input, by steps of a typical size, in the direction in which that is less."""

    u: Float[Array, " n"]
    w: Float[Array, " n"]
    margin: Float[Array, " n"]


class Way(NamedTuple):
    """How a device is to be followed, fixed.

    **Attributes:** `substeps` of a sample interval; whether the output sees the
    `immediate` derivative of the input, as that of a damper does: then what it is at
    the start of an interval is for the input at its end to say; and whether roots are
    looked for `slowly`, or where it is `None`, if they have to be.
    """

    substeps: int
    immediate: bool
    slowly: bool | None = None


def advanced(model: AbstractModel, state: Any, ends: Any, count: int) -> Any:
    """The state after a straight line of the input, in so many steps.

    **Arguments:** the state (x, m); and times and inputs at both ends of the line.
    """
    (t, u), (later, v) = ends
    h = later - t
    du = jnp.where(h > 0, (v - u) / jnp.where(h > 0, h, 1.0), 0.0)

    def signals(share: float) -> Signals:
        return Signals(t + share * h, u + share * (v - u), du)

    x, m = state
    if not jax.tree.leaves(x):
        return x, model.memory.after(m, signals(0.0), signals(1.0)._replace(u=v))
    for i in range(count):
        stages = (signals((i + half / 2) / count) for half in range(3))
        state = step(model, state, Grid(h / count, *stages))
    return state


def answered(model: AbstractModel, way: Way, state: Any, row: Any, v: Any):
    """The state that an input leads to over a row (two times, the input before, and the
    reference), and how far the output is off."""
    t, later, u, target = row
    h = later - t
    du = jnp.where(h > 0, (v - u) / jnp.where(h > 0, h, 1.0), 0.0)
    after = advanced(model, state, ((t, u), (later, v)), way.substeps)
    if way.immediate:
        (x, m), now = state, Signals(t, u, du)
    else:
        (x, m), now = after, Signals(later, v, du)
    w = model.output(x, m, now)
    return after, w - target


def _rows(task: Task, way: Way, flows: bool):
    """Times at both ends of the intervals, and the targets of each: where nothing
    flows, the first output is reached by a stretch that takes no time."""
    t, reference = task.t, task.reference
    if way.immediate:
        return t[:-1], t[1:], reference[:-1]
    if flows:
        return t[:-1], t[1:], reference[1:]
    return jnp.concatenate([t[:1], t[:-1]]), t, reference


def started(model: AbstractModel, task: Task) -> Any:
    """The state at the first sample."""
    now = Signals(task.t[0], task.u, jnp.zeros_like(task.u))
    return first_state(model, task.m, now, task.reference[0]), task.m


def reach(task: Task, row: Any):
    """Least and greatest input at the end of an interval; a start outside of the limits
    comes back as fast as it may."""
    t, later, u, _ = row
    limited = (later > t) & jnp.isfinite(task.speed)
    # Of no speed limit, which is infinite, a derivative would be NaN.
    most = jnp.where(limited, jnp.where(limited, task.speed, 0) * (later - t), jnp.inf)
    low = jnp.minimum(jnp.maximum(task.low, u - most), u + most)
    return low, jnp.maximum(jnp.minimum(task.high, u + most), low)


def _searched(model: AbstractModel, task: Task, way: Way, allowed: Any) -> Any:
    """Inputs, and how far outputs are off, by passes over all samples; and if these
    miss one, all over with intervals that hold a root where secants do not do."""
    if way.slowly:
        return _run(model, task, way, allowed, slowly=True)
    fast = _passes(model, task, way, allowed)
    if way.slowly is not None:
        return fast
    done = jnp.all(jnp.abs(fast[1]) <= allowed)
    done &= comes_closer(model, task, way, *driven(model, task, way, fast[0]), allowed)
    return jax.lax.cond(
        done, lambda: fast, lambda: _run(model, task, way, allowed, slowly=True)
    )


def _passes(model, task, way, allowed):
    """Inputs, and how far outputs are off: guesses one after the other, and Newton's
    steps from them, one after the other again, until all are near enough. A loop whose
    body is as short as that is one kernel, where one with several steps a sample takes
    ten times as long."""

    def unfinished(state):
        i, _, off = state
        return (i < _PASSES) & ~jnp.all(jnp.abs(off) <= allowed)

    def another(state):
        i, u, _ = state
        return i + 1, *_polished(model, task, way, u, allowed)

    first = _run(model, task, way, allowed, slowly=False)
    return jax.lax.while_loop(unfinished, another, (0, *first))[1:]


def _run(model, task, way, allowed, slowly: bool):
    """Inputs at the ends of the intervals, and how far outputs are off: by guesses, or
    slowly, until they are right."""
    state = started(model, task)
    flows = bool(jax.tree.leaves(state[0]))
    t, later, targets = _rows(task, way, flows)

    def follow(carry, row):
        state, u, slopes = carry
        row = row[0], row[1], u, row[2]

        def answer(v):
            return answered(model, way, state, row, v)

        here = Step(u, *reach(task, row), slopes)
        found = quick(answer, here, _SECANTS if slowly else 0)
        if slowly:  # by intervals, where secants are not enough
            found = jax.lax.cond(
                jnp.abs(found.off) <= allowed,
                lambda: found,
                lambda: careful(answer, here, found, task, allowed),
            )
        return (found.state, found.u, found.slopes), (found.u, found.off)

    first = t[0], jnp.where(later[0] > t[0], later[0], task.t[1]), task.u, targets[0]
    slopes = _slopes(model, way, state, first, task.guess)
    carry = state, task.u, slopes
    return jax.lax.scan(follow, carry, (t, later, targets))[1]


def _slopes(model, way, state, row, guess):
    """How much the output changes with the input, upwards and downwards."""
    below, here, above = _about(model, way, state, row, guess)
    return jnp.stack([(above - here) / guess, (here - below) / guess])


def _about(model, way, state, row, guess):
    """How far outputs are off where the input falls, holds still and rises."""
    ends = row[2] + guess * jnp.array([-1.0, 0.0, 1.0])
    return jax.vmap(lambda v: answered(model, way, state, row, v)[1])(ends)


_SIZES = 2.0 ** np.arange(-100, 101)  # of input differences, whatever their unit
_MOVED = 1e-3  # of the range of the reference
_PLAIN = 1e-3  # where nothing answers


def sized(model: AbstractModel, task: Task, way: Way) -> Task:
    """The task with a difference of inputs to start from: where none is known the least
    one, of powers of two, by which the output moves at the start."""
    if task.guess is not None:
        return task
    t, reference = task.t, task.reference
    target = reference[0] if way.immediate else reference[1]
    row = t[0], t[1], task.u, target
    state = started(model, task)
    sizes = jnp.asarray(_SIZES, t.dtype)
    offs = jax.vmap(lambda size: _about(model, way, state, row, size))(sizes)
    moved = jnp.max(jnp.abs(offs - offs[:, 1:2]), axis=1)
    span = jnp.max(reference) - jnp.min(reference)
    span = jnp.where(span > 0, span, jnp.max(jnp.abs(reference)))
    answers = jnp.isfinite(moved) & (moved > _MOVED * span)
    guess = jnp.where(jnp.any(answers), sizes[jnp.argmax(answers)], _PLAIN)
    return replace(task, guess=guess)


def found(model: AbstractModel, task: Task, way: Way, allowed: Any) -> Any:
    """The inputs, with derivatives in whatever of the model and the task has any."""
    still = jax.lax.stop_gradient(eqx.filter((model, task), eqx.is_array))
    fixed = eqx.combine(still, (model, task))
    u, _ = _searched(*fixed, way, allowed)
    return at_roots(model, task, way, u)


def at_roots(model: AbstractModel, task: Task, way: Way, u: Any) -> Any:
    """Inputs that were found, with the derivatives of `found`."""
    return _differentiable((model, task), u=u, way=way)


@eqx.filter_custom_jvp
def _differentiable(device: Any, *, u, way):
    return u


@_differentiable.def_jvp
def _(primals, tangents, *, u, way):
    (device,), (changes,) = primals, tangents
    moving, still = parted(device, changes)
    roots = _differentiable(device, u=u, way=way)

    def inputs(moving):
        model, task = eqx.combine(moving, still)
        return _polished(model, task, way, roots, jnp.inf, found=True)[0]

    return roots, jax.jvp(inputs, (moving,), (changes,))[1]


def _polished(model, task, way, inputs, allowed, found=False):
    """The inputs after one more step of Newton's method each, and how far outputs then
    are off. At roots, wherever they are from, it has their derivatives: where nothing
    is off by more than `allowed`, nothing but that step is taken; and of inputs that
    are `found`, those at an end of what can be reached stay there."""
    state = started(model, task)
    t, later, targets = _rows(task, way, bool(jax.tree.leaves(state[0])))
    before = jnp.concatenate([task.u[None], inputs[:-1]])

    def follow(carry, row):
        state, u = carry
        t, later, target, v, old = row
        row = t, later, u, target

        def off(v):
            return answered(model, way, state, row, v)[1]

        # Differences are kept: where the step before has moved, this one moves along.
        moved = v + (u - old)
        there, slope = jax.jvp(off, (moved,), (jnp.ones_like(v),))
        held = slope == 0  # where nothing answers
        newton = moved - there / jnp.where(held, 1.0, slope)
        # Beyond where the interval begins slopes are others: no further than there.
        turned = ((newton - u) * (moved - u) < 0) & (jnp.abs(there) > allowed)
        newton = jnp.where(turned, u - _BEHIND * (moved - u), newton)
        low, high = reach(task, row)
        better = jnp.clip(jnp.where(held, v, newton), low, high)
        if found:
            least, most = reach(task, (t, later, old, target))
            better = jnp.where(v == least, low, jnp.where(v == most, high, better))
        v = better
        state, there = answered(model, way, state, row, v)
        return (state, v), (v, there)

    rows = t, later, targets, inputs, before
    return jax.lax.scan(follow, (state, task.u), rows)[1]


def driven(
    model: AbstractModel, task: Task, way: Way, inputs: Any
) -> tuple[Float[Array, " n"], Any]:
    """Inputs and states at the samples, under inputs that were found."""
    state = started(model, task)
    flows = bool(jax.tree.leaves(state[0]))
    t, later, _ = _rows(task, way, flows)

    def follow(carry, row):
        state, u = carry
        t, later, v = row
        after = advanced(model, state, ((t, u), (later, v)), way.substeps)
        return (after, v), after

    _, states = jax.lax.scan(follow, (state, task.u), (t, later, inputs))
    if not (flows or way.immediate):
        return inputs, states
    return jnp.concatenate([task.u[None], inputs]), from_start(state, states)


def followed(
    model: AbstractModel, task: Task, way: Way, u: Float[Array, " n"], states: Any
) -> Followed:
    """What the device does under the inputs of `driven`, and by which margin."""
    du = jnp.diff(u) / jnp.diff(task.t)
    du = jnp.append(du, du[-1])
    x, m = states
    w = jax.vmap(model.output)(x, m, Signals(task.t, u, du))
    usual = jnp.sqrt(jnp.mean(jnp.diff(u) ** 2))
    usual = jnp.where(usual > 0, usual, task.guess)
    lengths = jnp.diff(task.t)
    ends = task.t + jnp.append(lengths, lengths[-1])

    def slopes(x, m, t, later, u):
        row = t, later, u, jnp.zeros_like(u)
        return _slopes(model, way._replace(substeps=1), (x, m), row, usual)

    both = jax.vmap(slopes)(x, m, task.t, ends, u)
    falls = jnp.nansum(both) < 0  # with the input, on the whole
    return Followed(u, w, jnp.min(jnp.where(falls, -both, both), axis=1))


def comes_closer(
    model: AbstractModel,
    task: Task,
    way: Way,
    u: Float[Array, " n"],
    states: Any,
    allowed: Any,
) -> Bool[Array, ""]:
    """Whether the inputs of `driven` went where the output comes closer.

    Where that rises with the input on both sides and is too high, an input above is a
    root of the steps and not of the device, most likely: of a leap for which they are
    too few.
    """

    def closer(state, t, later, u, v, target):
        row = t, later, u, target
        below, held, above = _about(model, way, state, row, task.guess)
        rising = (below < held) & (held < above)
        return ~rising | (jnp.abs(held) <= allowed) | (held * (v - u) <= 0)

    targets = task.reference[:-1] if way.immediate else task.reference[1:]
    before, ends = at(states, slice(None, -1)), (task.t[:-1], task.t[1:])
    return jnp.all(jax.vmap(closer)(before, *ends, u[:-1], u[1:], targets))


def steps_hold(
    model: AbstractModel, task: Task, way: Way, u: Float[Array, " n"], states: Any
) -> Bool[Array, " n"]:
    """Whether the steps are short enough for the inputs of `driven`: whether half as
    long ones lead to the same output, but for a quarter of its way and a fiftieth of
    the reference. Leaps for which they are too long come to outputs that the device has
    under no input at all, and whatever follows begins there."""
    every = jnp.ones(len(task.t), bool)
    if way.immediate or not jax.tree.leaves(states[0]):
        return every

    def hold(state, t, later, u, v, plain):
        middle, end = ((t + later) / 2, (u + v) / 2), (later, v)
        du = (v - u) / (later - t)
        half = advanced(model, state, ((t, u), middle), way.substeps)
        half = advanced(model, half, (middle, end), way.substeps)
        (x, m), now = state, Signals(t, u, du)
        before = model.output(x, m, now)
        there, finer = (
            model.output(x, m, Signals(later, v, du)) for x, m in (plain, half)
        )
        allowed = jnp.abs(finer - before) / 4 + task.size / 50
        return jnp.abs(there - finer) <= allowed

    before, after = (at(states, slice(*ends)) for ends in ((None, -1), (1, None)))
    ends = task.t[:-1], task.t[1:], u[:-1], u[1:]
    held = jax.vmap(hold)(before, *ends, after)
    return every.at[1:].set(jnp.cumprod(held).astype(bool))


Answer = Callable[[Float[Array, ""]], tuple[Any, Float[Array, ""]]]
"""Of an input: the state it leads to, and how far the output then is off."""

_PASSES = 16  # at most, of which most devices need two
_BEHIND = 1e-6  # of a difference, from which a slope is that of the other direction
_SECANTS = 3  # after the first two guesses: two digits become twelve
_DOUBLINGS = 32  # of the distance at which an input on the other side is looked for
_ROUNDING = 64  # last digits: of the largest summand of an output, with a reserve
_HALVINGS = 128  # at most, of which regula falsi needs a dozen


class Step(NamedTuple):
    """What is known before a step.

    **Attributes:** the input `u` there; the lowest and highest input `low` and `high`
    at its end; and `slopes` of the output over the input, upwards and downwards, as of
    the steps before.
    """

    u: Float[Array, ""]
    low: Float[Array, ""]
    high: Float[Array, ""]
    slopes: Float[Array, "2"]


class Found(NamedTuple):
    """An input, the state it leads to, how far the output is off, and the slopes for
    the next step."""

    u: Float[Array, ""]
    state: Any
    off: Float[Array, ""]
    slopes: Float[Array, "2"]


def quick(answer: Answer, step: Step, secants: int) -> Found:
    """By the slope of the step before, and a few secants from there: enough, where the
    output is smooth in the input as long as this goes one way."""
    _, first = answer(step.u)
    rising = -first * step.slopes[0] > 0
    slope = jnp.where(rising, step.slopes[0], step.slopes[1])
    u, off = step.u, first
    later = jnp.clip(u - _ratio(first, slope), step.low, step.high)
    for _ in range(secants):
        _, there = answer(later)
        u, off, later = later, there, _secant(step, (u, off), (later, there))
    state, there = answer(later)
    new = _ratio(there - first, later - step.u)
    usable = jnp.isfinite(new) & (new != 0)
    new = jnp.where(usable, new, slope)
    up = later > step.u
    slopes = jnp.stack(
        [
            jnp.where(up, new, step.slopes[0]),
            jnp.where(up, step.slopes[1], new),
        ]
    )
    return Found(later, state, there, slopes)


def _secant(step: Step, before, now) -> Float[Array, ""]:
    (a, off_a), (b, off_b) = before, now
    moved = b - _ratio(off_b * (b - a), off_b - off_a)
    return jnp.clip(moved, step.low, step.high)


def _ratio(a, b):
    """a / b, and 0 for nothing."""
    zero = b == 0
    return jnp.where(zero, 0.0, a / jnp.where(zero, 1.0, b))


def careful(
    answer: Answer, step: Step, tried: Found, task: Task, allowed: Any
) -> Found:
    """By an interval that holds a root, however the output bends and jumps: looked for
    on both sides, twice as far each time, and then made smaller by regula falsi with
    halved weights, and by halves where that is slow.

    Where no input within reach is enough, the one of those tried that comes closest;
    and where none is closer than to stay, as in a play, towards one that is, as far as
    the speed allows.

    **Arguments:** what has been `tried`, for its slopes; the task, for its limits and a
    first distance; and how far the output may be off.

    **Source:** Dowell and Jarratt (1971), doi 10.1007/BF01934364.
    """
    u = step.u

    def off(v):
        return answer(v)[1]

    start = off(u)
    size = task.guess
    size = jnp.where(jnp.isfinite(size) & (size > 0), size, 1.0)
    slower = (step.low > task.low) | (step.high < task.high)

    def unmoved(state):
        i, _, there = state
        return (i == 0) | ((i == 1) & slower & ~(jnp.abs(there) < jnp.abs(start)))

    def search(state):
        i, *best = state
        low = jnp.where(i == 0, step.low, jnp.minimum(step.low, task.low))
        high = jnp.where(i == 0, step.high, jnp.maximum(step.high, task.high))
        within = step._replace(low=low, high=high)
        bracket, best = _bracketed(off, within, start, tuple(best), size, allowed)
        v, there = _narrowed(off, bracket, allowed)
        found = jnp.abs(there) < jnp.abs(best[1])
        return i + 1, jnp.where(found, v, best[0]), jnp.where(found, there, best[1])

    _, v, _ = jax.lax.while_loop(unmoved, search, (0, u, start))
    # A start outside of the limits is no input that may stay.
    v = jnp.clip(v, step.low, step.high)
    state, there = answer(v)
    usable = jnp.all(jnp.isfinite(tried.slopes))
    return Found(v, state, there, jnp.where(usable, tried.slopes, step.slopes))


def _bracketed(off, step: Step, start, best, size, allowed):
    """Two inputs with what they are off by, of different signs, where there are such
    within reach: one number after the other, as an array; and the best input met on the
    way, which may be enough."""
    u, low, high = step.u, step.low, step.high

    def apart(state):
        i, _, _, best, _, going = state
        return (i < _DOUBLINGS) & (jnp.abs(best[1]) > allowed) & (going > 0)

    def wider(state):
        i, inner, outer, best, steep, _ = state
        distance = size * 2.0**i
        ends = jnp.clip(u + jnp.array([-1.0, 1.0]) * distance, low, high)
        offs = jax.vmap(off)(ends)
        finite = jnp.isfinite(offs)
        moved = jnp.max(jnp.where(finite, jnp.abs(offs - start), 0.0))
        steep = jnp.maximum(steep, moved / distance)
        # Where nothing answers any more this would lead ever farther out.
        rounding = _ROUNDING * jnp.finfo(offs.dtype).eps * steep * jnp.abs(ends)
        crossed = (offs * start <= 0) & (jnp.abs(offs) > rounding)
        # Of both sides the one on which the output has gone less far past its target.
        nearer = jnp.argmin(jnp.abs(offs))
        side = jnp.where(crossed[0] & crossed[1], nearer, jnp.argmax(crossed))
        known = inner[1]
        near = (
            jnp.where(jnp.any(crossed), inner[0][side], u),
            jnp.where(jnp.any(crossed), known[side], start),
        )
        far = ends[side], offs[side]
        closer = jnp.argmin(jnp.where(finite, jnp.abs(offs), jnp.inf))
        better = jnp.abs(offs[closer]) + rounding[closer] < jnp.abs(best[1])
        best = tuple(
            jnp.where(better, new, old)
            for new, old in zip((ends[closer], offs[closer]), best, strict=True)
        )
        still = (ends[0] > low) | (ends[1] < high)
        going = jnp.where(jnp.any(crossed) | ~still, 0, 1)
        bracket = jnp.stack([near[0], near[1], far[0], far[1]])
        bracket = jnp.where(jnp.any(crossed), bracket, outer)
        return i + 1, (ends, offs), bracket, best, steep, going

    inner = jnp.stack([u, u]), jnp.stack([start, start])
    unknown = jnp.stack([u, start, u, start])
    begin = jnp.array(0), inner, unknown, best, jnp.zeros_like(u), jnp.array(1)
    _, _, bracket, best, *_ = jax.lax.while_loop(apart, wider, begin)
    return bracket, best


def _narrowed(off, bracket: Float[Array, "4"], allowed):
    """The input of those tried within a bracket that is nearest to a root, and by how
    much it is off: at a jump, that on the better side."""
    (a, off_a, b, off_b), eps = bracket, jnp.finfo(bracket.dtype).eps

    def wide(state):
        i, a, _, b, _, _, least = state
        rounding = 4 * eps * (jnp.abs(a) + jnp.abs(b))
        close = jnp.abs(least) <= allowed
        return (i < _HALVINGS) & ~close & (jnp.abs(b - a) > rounding)

    def smaller(state):
        i, a, off_a, b, off_b, best, least = state
        straight = b - _ratio(off_b * (b - a), off_b - off_a)
        middle = (a + b) / 2
        inside = (straight - a) * (straight - b) < 0
        # Every third by halves: a jump would make the others crawl.
        v = jnp.where(inside & (i % 3 < 2), straight, middle)
        there = off(v)
        across = there * off_b <= 0
        # The end that stays counts half, so that the next secant passes the root.
        a, off_a = jnp.where(across, b, a), jnp.where(across, off_b, 0.5 * off_a)
        better = jnp.abs(there) < jnp.abs(least)
        best, least = jnp.where(better, v, best), jnp.where(better, there, least)
        return i + 1, a, off_a, v, there, best, least

    nearer = jnp.abs(off_a) < jnp.abs(off_b)
    best, least = jnp.where(nearer, a, b), jnp.where(nearer, off_a, off_b)
    begin = jnp.array(0), *bracket, best, least
    *_, best, least = jax.lax.while_loop(wide, smaller, begin)
    return best, least
