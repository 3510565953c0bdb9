"""A device made to follow a reference, sample by sample."""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..models import AbstractModel
from ..signals import Grid, Signals
from ..simulation import step
from ..simulation._march import parted
from ._roots import Step, careful, quick


class Task(eqx.Module):
    """What is to be followed.

    **Attributes:**

    - `t`, `reference`: times, s, and the output there, shape (n,).
    - `u`: the input at the start, where the device has been until then.
    - `m`: the state of its memory there.
    - `low`, `high`: least and greatest input; `speed`: how much it may change a second.
    - `guess`: an input difference to start from, positive.
    """

    t: Float[Array, " n"]
    reference: Float[Array, " n"]
    u: Float[Array, ""]
    m: Any
    low: Float[Array, ""]
    high: Float[Array, ""]
    speed: Float[Array, ""]
    guess: Float[Array, ""]


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
    return model.start(task.m, now, task.reference[0]), task.m


def reach(task: Task, row: Any):
    """Least and greatest input at the end of an interval; a start outside of the limits
    comes back as fast as it may."""
    t, later, u, _ = row
    most = jnp.where(later > t, task.speed * (later - t), jnp.inf)
    most = jnp.where(jnp.isnan(most), jnp.inf, most)
    low = jnp.minimum(jnp.maximum(task.low, u - most), u + most)
    return low, jnp.maximum(jnp.minimum(task.high, u + most), low)


def _searched(model: AbstractModel, task: Task, way: Way, allowed: Any) -> Any:
    """Inputs, and how far outputs are off, by secants; and if these miss a sample, all
    over with intervals that hold a root where they do."""

    def run(slowly: bool):
        return _run(model, task, way, allowed, slowly)

    if way.slowly is not None:
        return run(way.slowly)
    fast = run(False)
    done = jnp.all(jnp.abs(fast[1]) <= allowed)
    return jax.lax.cond(done, lambda: fast, lambda: run(True))


def _run(model, task, way, allowed, slowly: bool):
    """Inputs at the ends of the intervals, how far outputs are off, and states."""
    state = started(model, task)
    flows = bool(jax.tree.leaves(state[0]))
    t, later, targets = _rows(task, way, flows)

    def follow(carry, row):
        state, u, slopes = carry
        row = row[0], row[1], u, row[2]

        def answer(v):
            return answered(model, way, state, row, v)

        here = Step(u, *reach(task, row), slopes)
        found = quick(answer, here)
        if slowly:  # by intervals, where secants are not enough
            found = jax.lax.cond(
                jnp.abs(found.off) <= allowed,
                lambda: found,
                lambda: careful(answer, here, found, task.guess, allowed),
            )
        return (found.state, found.u, found.slopes), (found.u, found.off)

    first = t[0], jnp.where(later[0] > t[0], later[0], task.t[1]), task.u, targets[0]
    slopes = _slopes(model, way, state, first, task.guess)
    carry = state, task.u, slopes
    return jax.lax.scan(follow, carry, (t, later, targets))[1]


def _slopes(model, way, state, row, guess):
    """How much the output changes with the input, upwards and downwards."""
    u = row[2]
    ends = u + guess * jnp.array([-1.0, 0.0, 1.0])
    below, here, above = jax.vmap(lambda v: answered(model, way, state, row, v)[1])(
        ends
    )
    return jnp.stack([(above - here) / guess, (here - below) / guess])


def found(model: AbstractModel, task: Task, way: Way, allowed: Any) -> Any:
    """The inputs, with derivatives in whatever of the model and the task has any."""
    still = jax.lax.stop_gradient(eqx.filter((model, task), eqx.is_array))
    fixed = eqx.combine(still, (model, task))
    u, _ = _searched(*fixed, way, allowed)
    return _differentiable((model, task), u=u, way=way)


@eqx.filter_custom_jvp
def _differentiable(device: Any, *, u, way):
    return u


@_differentiable.def_jvp
def _(primals, tangents, *, u, way):
    (device,), (changes,) = primals, tangents
    moving, still = parted(device, changes)

    def inputs(moving):
        model, task = eqx.combine(moving, still)
        return _polished(model, task, way, u)

    return u, jax.jvp(inputs, (moving,), (changes,))[1]


def _polished(model, task, way, inputs):
    """The inputs after one more step of Newton's method each: what has the derivatives
    of a root, wherever the search was."""
    state = started(model, task)
    t, later, targets = _rows(task, way, bool(jax.tree.leaves(state[0])))

    def follow(carry, row):
        state, u = carry
        t, later, target, v = row

        def off(v):
            return answered(model, way, state, (t, later, u, target), v)[1]

        slope = jax.lax.stop_gradient(jax.grad(off)(v))
        held = slope == 0  # at a limit, or where nothing answers
        v = v - jnp.where(held, 0.0, off(v) / jnp.where(held, 1.0, slope))
        state, _ = answered(model, way, state, (t, later, u, target), v)
        return (state, v), v

    return jax.lax.scan(follow, (state, task.u), (t, later, targets, inputs))[1]


def reached(model: AbstractModel, task: Task, way: Way, inputs: Any) -> Followed:
    """What the device does under inputs that were found, and by which margin."""
    state = started(model, task)
    flows = bool(jax.tree.leaves(state[0]))
    t, later, _ = _rows(task, way, flows)

    def follow(carry, row):
        state, u = carry
        t, later, v = row
        after = advanced(model, state, ((t, u), (later, v)), way.substeps)
        return (after, v), after

    _, states = jax.lax.scan(follow, (state, task.u), (t, later, inputs))
    u = inputs
    if flows or way.immediate:
        u = jnp.concatenate([task.u[None], inputs])
        states = jax.tree.map(
            lambda a, b: jnp.concatenate([jnp.asarray(a)[None], b]), state, states
        )
    du = jnp.diff(u) / jnp.diff(task.t)
    du = jnp.append(du, du[-1])
    x, m = states
    w = jax.vmap(model.output)(x, m, Signals(task.t, u, du))
    usual = jnp.sqrt(jnp.mean(jnp.diff(u) ** 2))
    usual = jnp.where(usual > 0, usual, task.guess)
    lengths = jnp.diff(task.t)
    ends = task.t + jnp.append(lengths, lengths[-1])

    def margin(x, m, t, later, u):
        row = t, later, u, jnp.zeros_like(u)
        return jnp.min(_slopes(model, way._replace(substeps=1), (x, m), row, usual))

    margins = jax.vmap(margin)(x, m, task.t, ends, u)
    return Followed(u, w, margins)
