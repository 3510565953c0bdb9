"""Recordings laid out for trajectory matching, one batch, whatever their lengths, and
the simulated states of its segments."""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float

from .._core.compiling import jit
from ..library import at
from ..models import AbstractModel, Leg
from ..recording import Recording
from ..recording._as_measured import Weights, led_in, weights_of
from ..signals import Grid, Signals
from ..simulation import first_state, flow, march

# Over which laws are to forget: a short record lets even those forget little that do.
_CYCLES = 10.0


class Pull(NamedTuple):
    """What draws trajectories to the measured output before each of m steps: by which
    share of the distance, and to where."""

    gain: Float[Array, "*batch m"]
    target: Float[Array, "*batch m"]


class Drive(NamedTuple):
    """What m steps need to know besides the state: the input, the pull if there is one,
    and the memory at the start, the middle and the end of each."""

    grid: Grid
    pull: Pull | None
    memory: tuple[Any, Any, Any]


def states(
    model: AbstractModel,
    starts: Float[Array, "segments d"],
    drive: Drive,
    substeps: int,
) -> Float[Array, "segments n d"]:
    """Flowing states at the sample times of a batch of segments.

    **Arguments:** the model; states at the start of each segment, flattened to d
    numbers; what drives the segments, along the first axis of its arrays; and steps a
    sample interval.
    """

    def run(start, drive):
        legs = jax.vmap(model.legs)(drive.memory, drive.grid)
        path = march(_step, model, state_like(model, start), (drive, legs))
        return jax.vmap(flat)(path)[::substeps]

    return _each_segment(run, starts, drive)


def _step(model: AbstractModel, x: Any, row: tuple[Drive, tuple[Leg, ...]]) -> Any:
    """The state after a step, drawn to the measured output before it."""
    drive, legs = row
    if drive.pull is not None:
        x = _drawn(model, x, drive.pull, drive.memory[0], drive.grid.start)
    return flow(model, x, legs)


def _drawn(model: AbstractModel, x: Any, pull: Pull, m: Any, now: Signals) -> Any:
    """A state moved along the outputs that a start may have, towards a measured one; or
    a new start there, where the state has been lost."""
    kept = jnp.all(jnp.isfinite(flat(x)))
    return jax.tree.map(
        lambda leaf, there, here: jnp.where(
            kept, leaf + pull.gain * (there - here), there
        ),
        x,
        model.start(m, now, pull.target),
        model.start(m, now, model.output(x, m, now)),
    )


def flat(x: Any) -> Float[Array, " d"]:
    """A state as d numbers."""
    return ravel_pytree(x)[0]


def state_like(model: AbstractModel, row: Float[Array, " d"]) -> Any:
    """A flattened state in the model's own structure."""
    zero = jnp.zeros((), row.dtype)
    now = Signals(zero, zero, zero)
    like = first_state(model, model.memory.start(now), now, zero)
    return ravel_pytree(like)[1](row)


def _each_segment(function: Callable, starts, drive: Drive):
    """`vmap`, but for a lone segment, whose loop over scalars is faster than one over
    arrays of length 1."""
    if starts.shape[0] > 1:
        return jax.vmap(function)(starts, drive)
    lone = jax.tree.map(lambda leaf: leaf[0], (starts, drive))
    return jax.tree.map(lambda leaf: leaf[None], function(*lone))


class Samples(eqx.Module):
    """R recordings padded to one length n: padded samples have no weight and their
    steps no length, so that they change nothing.

    **Attributes:**

    - `t`, `w`, `weight`: sample times, output, and weights, each (R, n). A residual is
        the square root of the weight times simulated minus measured.
    - `unit`: by which weights were divided to have mean 1 where they are positive:
        their scale is no matter to a fit.
    - `grid`: of each recording, its arrays of shape (R, m) with m = substeps (n - 1).
    - `past`: steps up to the first sample, where any are known, shape (R, _).
    - `scored`: number of samples with weight, a float: derivatives pass by.
    - `spread`: root mean square of the output about its mean, over weighted samples.
    - `pace`: of each recording, how many of it make ten cycles of its input, at least
        1, shape (R,).
    - `substeps`: integration steps a sample interval.
    """

    t: Float[Array, "r n"]
    w: Float[Array, "r n"]
    weight: Float[Array, "r n"]
    unit: Float[Array, ""]
    grid: Grid
    past: Grid | None
    scored: Float[Array, ""]
    spread: Float[Array, ""]
    pace: Float[Array, " r"]
    substeps: int = eqx.field(static=True)


def as_measured(
    recordings: tuple[Recording, ...],
    weights: Weights | None,
    lead_in: int | None,
    periodic: bool,
) -> tuple[tuple[Recording, ...], Weights | None]:
    """Recordings and their weights with a lead-in, as `refine` takes it."""
    if not periodic and not lead_in:
        return recordings, weights
    known = [None] * len(recordings)
    if weights is not None:
        known = weights_of(recordings, weights)
    led = [
        led_in(each, weight, len(each) if lead_in is None else lead_in, periodic)
        for each, weight in zip(recordings, known, strict=True)
    ]
    return tuple(each for each, _ in led), [weight for _, weight in led]


def samples(
    recordings: Sequence[Recording],
    weights: Weights | None,
    substeps: int,
) -> Samples:
    """Lay out recordings of any lengths and rates.

    **Arguments:** `weights`, all ones by default.

    **Raises:** `InputError` for weights of another length, or negative ones.
    """
    return each_of(recordings, weights, (substeps,))[0]


def each_of(
    recordings: Sequence[Recording],
    weights: Weights | None,
    substeps: tuple[int, ...],
) -> tuple[Samples, ...]:
    """`samples` for several numbers of steps a sample interval, by one program."""
    if weights is None:
        weights = [np.ones(len(each), each.t.dtype) for each in recordings]
    group = tuple(recordings)
    return _laid_out(group, weights_of(group, weights), substeps)


def pulls(samples: Samples, gain: Float[Array, ""] | None) -> Pull | None:
    """What draws trajectories to the measured output, by a gain that is zero but for
    steps that start at a sample later than the first; nothing without a gain."""
    if gain is None:
        return None
    steps = jnp.arange(samples.substeps * (samples.w.shape[1] - 1))
    gains = jnp.where((steps > 0) & (steps % samples.substeps == 0), gain, 0.0)
    targets = jnp.repeat(samples.w[:, :-1], samples.substeps, axis=1)
    return Pull(jnp.broadcast_to(gains, targets.shape), targets)


def remembered(model: AbstractModel, samples: Samples) -> tuple[Any, Any, Any]:
    """What the model's memory holds at the start, the middle and the end of every step,
    PyTrees of arrays with leading axes (R, m)."""
    memory = model.memory

    def along(grid: Grid, past: Grid | None):
        m = memory.start(at((grid if past is None else past).start, 0))
        if past is not None:
            *_, ends = memory.along(m, past)
            m = at(ends, -1)
        return memory.along(m, grid)

    return jax.vmap(along)(samples.grid, samples.past)


def at_samples(steps: tuple[Any, Any, Any], samples: Samples) -> Any:
    """Of what is known at the start, the middle and the end of every step that at the
    samples, shape (R, n, ...)."""

    def pick(starts, ends):
        return jnp.concatenate([starts[:, :: samples.substeps], ends[:, -1:]], axis=1)

    return jax.tree.map(pick, steps[0], steps[2])


def signals(samples: Samples) -> Signals:
    """The input at the samples, with right limits of its derivative, shape (R, n)."""
    return at_samples(samples.grid[1:], samples)


@jit
def _laid_out(recordings, weights, substeps) -> tuple[Samples, ...]:
    return tuple(_stepped(recordings, weights, each) for each in substeps)


def _stepped(recordings, weights, substeps: int) -> Samples:
    longest = max(len(recording) for recording in recordings)
    rows = [
        _padded(recording, weight, substeps, longest)
        for recording, weight in zip(recordings, weights, strict=True)
    ]
    t, w, weight, grid = jax.tree.map(lambda *leaves: jnp.stack(leaves), *rows)
    scored = jnp.sum(weight > 0, dtype=weight.dtype)
    unit = jnp.sum(weight) / scored
    weight = weight / unit
    spread, past = _spread(w, weight), _past(recordings)
    pace = jax.vmap(_pace)(grid)
    return Samples(t, w, weight, unit, grid, past, scored, spread, pace, substeps)


def _pace(grid: Grid) -> Float[Array, ""]:
    """How many such recordings make the cycles over which laws are to forget."""
    travel = jnp.sum(jnp.abs(grid.end.u - grid.start.u))
    span = jnp.max(grid.start.u) - jnp.min(grid.start.u)
    cycles = travel / (2 * jnp.where(span > 0, span, 1.0))
    return jnp.maximum(_CYCLES / jnp.where(cycles > 0, cycles, _CYCLES), 1.0)


def _past(recordings) -> Grid | None:
    """Steps before the first samples, filled up at the front to one number by steps of
    no length, in which nothing moves."""
    paths = [recording.path for recording in recordings]
    if all(path.past is None for path in paths):
        return None

    def known(path) -> Grid:
        past = path if path.past is None else path.past
        grid = _extended(past.grid(past.least_substeps), 1, before=True)
        # Without a past of its own a recording begins with its first signals.
        return at(grid, slice(1)) if path.past is None else grid

    grids = [known(path) for path in paths]
    most = max(len(grid.steps) for grid in grids)
    filled = [_extended(g, most - len(g.steps), before=True) for g in grids]
    return jax.tree.map(lambda *leaves: jnp.stack(leaves), *filled)


def _extended(grid: Grid, extra: int, before: bool = False) -> Grid:
    """A grid with steps of no length after it, or before it."""
    signals = at(grid.start if before else grid.end, 0 if before else -1)
    held = jax.tree.map(lambda value: jnp.broadcast_to(value, (extra,)), signals)
    still = Grid(jnp.zeros(extra, grid.steps.dtype), held, held, held)
    pair = (still, grid) if before else (grid, still)
    return jax.tree.map(lambda *leaves: jnp.concatenate(leaves), *pair)


def _spread(w: Float[Array, "r n"], weight: Float[Array, "r n"]) -> Float[Array, ""]:
    total = jnp.sum(weight)
    mean = jnp.sum(weight * w) / total
    return jnp.sqrt(jnp.sum(weight * (w - mean) ** 2) / total)


def _padded(recording: Recording, weight, substeps: int, longest: int):
    """Times, outputs, weights and grid of one recording."""
    extra = longest - len(recording)
    return (
        _held(recording.t, extra),
        _held(recording.w, extra),
        jnp.pad(weight, (0, extra)),
        _extended(recording.path.grid(substeps), extra * substeps),
    )


def _held(row: Float[Array, " n"], extra: int) -> Float[Array, " m"]:
    """A row that keeps its last value for so many more."""
    return jnp.pad(row, (0, extra), mode="edge")
