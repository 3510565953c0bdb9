"""The objective of trajectory matching: recordings laid out as one batch, whatever
their lengths; the simulated states of its segments; the residuals of simulated against
measured output, as a function of what is fitted; whether a law forgets its initial
value; and where fits start."""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, Literal, NamedTuple, TypeAlias

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Bool, Float

from .._core import checks
from .._core.checks import InputError
from .._core.compiling import depends, jit
from ..least_squares import root_of
from ..library import at, sampled
from ..models import AbstractModel, Leg
from ..recording import Recording
from ..recording._as_measured import Weights, from_known, led_in, weights_of
from ..signals import Grid, Signals
from ..simulation import first_state, flow, march
from ._choices import AbstractLoss, Parameters

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
    - `known`: whether an output was measured, (R, n): it may draw trajectories, though
        in a lead-in it has no weight.
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
    known: Bool[Array, "r n"]
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
) -> tuple[tuple[Recording, ...], list[Array] | None, list[Array] | None]:
    """Recordings and the weights of their samples, if there are any, with a lead-in, as
    `refine` takes it; where they begin with an output that has no weight, with one that
    has. Last, the weights as they were given: a lead-in does not count, but is
    measured."""
    checks.answers(periodic=periodic)
    known = None if weights is None else weights_of(recordings, weights)
    if not periodic and not lead_in:
        if known is not None:
            recordings = tuple(map(from_known, recordings, known))
        return recordings, known, known
    led = []
    for each, weight in zip(recordings, known or [None] * len(recordings), strict=True):
        count = len(each) if lead_in is None else lead_in
        whole, counted = led_in(each, weight, count, periodic)
        rows = np.arange(len(each) - len(whole), len(each)) % len(each)
        own = jnp.ones_like(counted) if weight is None else checks.rows(weight, rows)
        led.append((from_known(whole, own), counted, own))
    begun, counted, own = zip(*led, strict=True)
    return begun, list(counted), list(own)


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
    known: Sequence[Array] | None = None,
) -> tuple[Samples, ...]:
    """`samples` for several numbers of steps a sample interval, by one program; the
    outputs that are `known` have a weight there, by default in `weights`."""
    if weights is None:
        weights = [np.ones(len(each), each.t.dtype) for each in recordings]
    group = tuple(recordings)
    weights = weights_of(group, weights)
    return _laid_out(group, weights, weights if known is None else known, substeps)


def pulls(samples: Samples, gain: Float[Array, ""] | None) -> Pull | None:
    """What draws trajectories to the measured output: a gain, zero but for steps that
    start at a sample, other than the first, whose output is known; nothing without a
    gain."""
    if gain is None:
        return None
    targets, known = (
        jnp.repeat(x[:, :-1], samples.substeps, axis=1)
        for x in (samples.w, samples.known)
    )
    steps = jnp.arange(targets.shape[1])
    drawn = (steps > 0) & (steps % samples.substeps == 0) & known
    return Pull(jnp.where(drawn, gain, 0.0), targets)


def remembered(model: AbstractModel, samples: Samples) -> tuple[Any, Any, Any]:
    """What the model's memory holds at the start, the middle and the end of every step,
    PyTrees of arrays with leading axes (R, m)."""
    memory = model.memory

    def along(grid: Grid, past: Grid | None):
        m = memory.start(at((grid if past is None else past).start, 0))
        if past is not None:
            *_, ends = memory.along(m, past)
            m = memory.resumed(at(ends, -1), at(grid.start, 0))
        return memory.along(m, grid)

    return jax.vmap(along)(samples.grid, samples.past)


def at_samples(steps: tuple[Any, Any, Any], samples: Samples) -> Any:
    """Of what is known at the start, the middle and the end of every step that at the
    samples, shape (R, n, ...)."""
    each, count = partial(sampled, every=samples.substeps), len(samples.w)
    return jax.vmap(each, axis_size=count)(steps)  # of no arrays, without memory


def signals(samples: Samples) -> Signals:
    """The input at the samples, with right limits of its derivative, shape (R, n)."""
    return at_samples(samples.grid[1:], samples)


@jit
def _laid_out(recordings, weights, known, substeps) -> tuple[Samples, ...]:
    return tuple(_stepped(recordings, weights, known, each) for each in substeps)


def _stepped(recordings, weights, known, substeps: int) -> Samples:
    longest = max(len(recording) for recording in recordings)
    rows = [
        _padded(*each, substeps, longest)
        for each in zip(recordings, weights, known, strict=True)
    ]
    t, w, weight, known, grid = jax.tree.map(lambda *leaves: jnp.stack(leaves), *rows)
    scored = jnp.sum(weight > 0, dtype=weight.dtype)
    unit = jnp.sum(weight) / scored
    weight = weight / unit
    spread, past = _spread(w, weight), _past(recordings)
    pace = jax.vmap(_pace)(grid)
    more = unit, grid, past, scored, spread, pace, substeps
    return Samples(t, w, weight, known > 0, *more)


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


def _longer(rows: Any, last: Any, extra: int) -> Any:
    """A PyTree of rows, and so many more that are all like the `last`, of one row."""
    return jax.tree.map(
        lambda leaf, one: jnp.concatenate([leaf, jnp.repeat(one, extra, axis=0)]),
        rows,
        last,
    )


def _spread(w: Float[Array, "r n"], weight: Float[Array, "r n"]) -> Float[Array, ""]:
    total = jnp.sum(weight)
    mean = jnp.sum(weight * w) / total
    return jnp.sqrt(jnp.sum(weight * (w - mean) ** 2) / total)


def _padded(recording: Recording, weight, known, substeps: int, longest: int):
    """Times, outputs, weights, which are known, and grid of one recording."""
    extra = longest - len(recording)
    return (
        _held(recording.t, extra),
        _held(recording.w, extra),
        jnp.pad(weight, (0, extra)),
        jnp.pad(known, (0, extra)),
        _extended(recording.path.grid(substeps), extra * substeps),
    )


def _held(row: Float[Array, " n"], extra: int) -> Float[Array, " m"]:
    """A row that keeps its last value for so many more."""
    return jnp.pad(row, (0, extra), mode="edge")


class Fading(eqx.Module):
    """How a law contracts or expands along an input: two trajectories that start close
    together come together where the derivative of w' with respect to w is negative.

    **Attributes:**

    - `exponent`: its mean over time, 1/s: negative for a law that forgets.
    - `gain`: logarithm of the factor by which a difference in w grows over the whole
        recording.
    - `largest`: its largest value, 1/s.
    - `where`: the time of that, s.
    - `share`: share of the samples at which it is positive.
    """

    exponent: Float[Array, ""]
    gain: Float[Array, ""]
    largest: Float[Array, ""]
    where: Float[Array, ""]
    share: Float[Array, ""]


def exponents(
    model: AbstractModel, w: Float[Array, " n"], m: Any, now: Signals
) -> tuple[Float[Array, " n"], Float[Array, ""]]:
    """The derivative of w' with respect to w at each sample, 1/s, and its integral."""
    ones = jnp.ones_like(w)
    rates = jax.vmap(model.rate)
    local = jax.jvp(lambda w: rates(w, m, now), (w,), (ones,))[1]
    # u' is the right limit: constant over the step that follows.
    return local, jnp.sum(local[:-1] * jnp.diff(now.t))


def fading(model: AbstractModel, w: Float[Array, " n"], m: Any, now: Signals) -> Fading:
    """Measure fading along a trajectory of a law (one whose state is its output)."""
    local, gain = exponents(model, w, m, now)
    row = jnp.argmax(local)
    t = now.t
    # Samples that fill up a short recording stand still.
    real = jnp.append(True, jnp.diff(t) > 0)
    share = jnp.sum(jnp.where(real, local > 0, 0.0)) / jnp.sum(real)
    return Fading(gain / (t[-1] - t[0]), gain, local[row], t[row], share)


FAR = 1e3  # residual over the output's spread from which a trajectory is lost
_LOST = 1e6  # residual over the output's spread of a trajectory that has blown up
_UNFADING = 10.0  # weight of a law that does not fade, against a misfit of 1
# Residual, over the output's spread, of a first output without weight that is a spread
# off: behind a lead-in that forgets it one sample's noise would take it far.
_UNSEEN = 0.01
_SAFETY = 1e-3  # by which the penalty of laws that do not fade starts early


Free: TypeAlias = Literal["state", "output", "nothing"]
"""What is fitted of where a recording starts: the state there; the output, of which the
model says what its state is; or nothing, so that it is as the first sample is."""


def free_of(model: AbstractModel) -> Free:
    """What is fitted unless something else is asked for: all that a noisy first sample
    would tell."""
    if not model.hidden:
        return "state"
    zero = jnp.zeros(())
    now = Signals(zero, zero, zero)

    def start(seen):
        return flat(model.start(model.memory.start(now), now, seen))

    # A model that starts the same whatever was seen has nothing of it to fit: a column
    # of zeros would be an unknown that nothing determines.
    return "output" if depends(start, zero) else "nothing"


class Unknowns(eqx.Module):
    """What is fitted, in natural units.

    **Attributes:**

    - `values`: of the free parameters, shape (p,).
    - `starts`: states at the start of each piece of each recording, (R, pieces, d).
    - `first`: outputs that recordings start with, of which a model whose output does
        not tell its state says what that is, shape (R,).
    """

    values: Float[Array, " p"]
    starts: Float[Array, "r pieces d"]
    first: Float[Array, " r"]


class Run(eqx.Module):
    """A simulation of all recordings.

    **Attributes:**

    - `outputs`: at the samples, shape (R, n).
    - `states`: that flow, shape (R, n, d).
    - `memory`: there, a PyTree of arrays with leading axes (R, n).
    - `gaps`: between pieces, over the states' size.
    """

    outputs: Float[Array, "r n"]
    states: Float[Array, "r n d"]
    memory: Any
    gaps: Array


class Objective(eqx.Module):
    """Everything that residuals depend on but the unknowns.

    **Attributes:** `parameters`, `samples`, `loss` as their names say; `pieces` a
    recording is cut into; `fading`, the share of a difference in the output that a law
    may keep over a recording, and over ten cycles, without being penalised, 0 for any;
    `free`, what is fitted of where recordings start; and the `memory` at the steps of
    all recordings, where nothing that is fitted changes it.
    """

    parameters: Parameters
    samples: Samples
    loss: AbstractLoss
    pieces: int = eqx.field(static=True)
    fading: float = eqx.field(static=True)
    free: Free = eqx.field(static=True)
    memory: tuple[Any, Any, Any] | None = None

    def prepared(self) -> "Objective":
        """The same, with what need not be computed at every step of a fit."""
        if self.parameters.change_memory:
            return self
        return replace(self, memory=remembered(self.parameters.model, self.samples))

    def remembered(self, model: AbstractModel) -> tuple[Any, Any, Any]:
        """What the model's memory holds, as `remembered` computes it where it is not
        known."""
        return remembered(model, self.samples) if self.memory is None else self.memory

    def run(self, unknowns: Unknowns, gain: Float[Array, ""] | None = None) -> Run:
        """The simulation of some unknowns.

        **Arguments:** `gain`, by which trajectories are drawn to the measured output.
        """
        samples, model = self.samples, self.parameters.build(unknowns.values)
        memory = self.remembered(model)
        held, now = at_samples(memory, samples), signals(samples)
        starts = self._starts(unknowns, model, held, now)
        whole, gaps = self._states(model, starts, memory, gain)

        def output(row, m, now):
            return model.output(state_like(model, row), m, now)

        outputs = jax.vmap(jax.vmap(output))(whole, held, now)
        outputs = jax.vmap(model.recorded)(samples.t, outputs)
        return Run(outputs, whole, held, gaps)

    def _states(self, model, starts: Float[Array, "r pieces d"], memory, gain):
        """Flowing states at the samples, and the gaps between pieces over their
        size."""
        samples = self.samples
        recordings, n = samples.w.shape
        pieces, d = starts.shape[1:]
        if d == 0:  # the memory is all there is
            return jnp.zeros((recordings, n, 0), starts.dtype), jnp.zeros(0)
        length = -(-(n - 1) // pieces)
        drive = Drive(samples.grid, pulls(samples, gain), memory)
        segments = self._cut(drive, length)
        path = states(model, starts.reshape(-1, d), segments, samples.substeps)
        path = path.reshape(recordings, pieces, length + 1, d)
        whole = path[:, :, :-1].reshape(recordings, -1, d)
        whole = jnp.concatenate([whole, path[:, -1, -1:]], axis=1)[:, :n]
        size = jax.lax.stop_gradient(jnp.std(whole, axis=(0, 1)))
        gaps = path[:, :-1, -1] - starts[:, 1:]
        return whole, gaps / jnp.where(size > 0, size, 1.0)

    def residuals(
        self,
        unknowns: Unknowns,
        horizon: Float[Array, ""] | float = 1.0,
        gap_weight: Float[Array, ""] | float = 0.0,
        gain: Float[Array, ""] | None = None,
    ) -> tuple[Array, ...]:
        """What is squared and summed: of the output (relative to its spread, divided by
        the root of the number of samples), of the gaps, of fading, and of how the
        recordings begin where that has no weight.

        **Arguments:** `horizon`, the share of samples that counts; `gap_weight`;
        `gain` of nudging.
        """
        run = self.run(unknowns, gain)
        gaps = jnp.where(jnp.isfinite(run.gaps), run.gaps, _LOST)
        misfit = self._misfit(run.outputs, horizon)
        return misfit, gap_weight * gaps, *self._held(unknowns, run)

    def gains(self, unknowns: Unknowns, run: Run) -> Float[Array, " r"]:
        """Of a law, the logarithm of the factor by which a difference in the output
        grows over each recording; over ten cycles of its input, where it has fewer."""
        model = self.parameters.build(unknowns.values)
        rows = run.states[..., 0], run.memory, signals(self.samples)
        gains = jax.vmap(lambda *row: exponents(model, *row)[1])(*rows)
        return self.samples.pace * gains

    def cost(self, unknowns: Unknowns, run: Run) -> Float[Array, ""]:
        """Half the sum of squared residuals of a run."""
        parts = self._misfit(run.outputs, 1.0), *self._held(unknowns, run)
        return jnp.sum(jnp.stack([jnp.sum(part**2) for part in parts])) / 2

    def _held(self, unknowns: Unknowns, run: Run) -> tuple[Array, Array]:
        """What keeps a fit to what it may be, besides the samples."""
        return self._unfading(unknowns, run), self._unseen(run)

    def _unseen(self, run: Run) -> Float[Array, " r"]:
        """What keeps first outputs without weight near those that the samples begin
        with: behind a long lead-in nothing else does, and they would be anything."""
        samples = self.samples
        change = (run.outputs[:, 0] - samples.w[:, 0]) / samples.spread
        unseen = (samples.weight[:, 0] == 0) & jnp.isfinite(change)
        return _UNSEEN * jnp.where(unseen, change, 0.0) / jnp.sqrt(samples.scored)

    def _misfit(
        self, outputs: Float[Array, "r n"], horizon: Float[Array, ""] | float
    ) -> Float[Array, "r n"]:
        samples = self.samples
        # A share of each recording's own samples, without those that fill it up to the
        # longest one, and without a lead-in.
        n, known = samples.w.shape[1], samples.weight > 0
        first, after = jnp.argmax(known, axis=1), n - jnp.argmax(known[:, ::-1], axis=1)
        end = first + jnp.ceil(horizon * (after - first))
        counts = jnp.arange(n) < end[:, None]
        misfit = self.loss.signed_root(outputs - samples.w)
        lost = _LOST * samples.spread
        misfit = jnp.where(jnp.abs(misfit) < lost, misfit, lost)  # NaN is lost too
        unit = samples.spread * jnp.sqrt(samples.scored)
        return root_of(samples.weight * counts) * misfit / unit

    def _starts(
        self, unknowns: Unknowns, model: AbstractModel, held: Any, now: Signals
    ) -> Float[Array, "r pieces d"]:
        """Where the pieces start, the first of each recording as the model has it if
        that is not fitted: its parameters may have a say."""
        if self.free == "state":
            return unknowns.starts
        first = unknowns.first if self.free == "output" else self.samples.w[:, 0]
        first = _first_row(held), _first_row(now), first
        return unknowns.starts.at[:, 0].set(_measured_starts(model, *first))

    def _unfading(self, unknowns, run: Run):
        if not self.fading:
            return jnp.zeros(0)
        gained = jnp.nan_to_num(self.gains(unknowns, run))
        most = math.log(self.fading) - _SAFETY
        return _UNFADING * jax.nn.relu(gained - most)

    def _cut(self, drive: Drive, length: int) -> Drive:
        """Rows of steps (R, m, ...) as (R pieces, length substeps, ...), the last
        pieces filled up with steps of no length, in which all stays as it is at the
        end: elsewhere a law may have no rate."""
        steps = length * self.samples.substeps
        extra = self.pieces * steps - drive.grid.steps.shape[1]

        def filled(drive: Drive) -> Drive:
            start, middle, end = drive.memory
            last = at(end, slice(-1, None))
            memory = [_longer(rows, last, extra) for rows in (start, middle, end)]
            pull = drive.pull
            pull = pull and _longer(pull, at(pull, slice(-1, None)), extra)
            return Drive(_extended(drive.grid, extra), pull, tuple(memory))

        return jax.tree.map(
            lambda leaf: leaf.reshape(-1, steps, *leaf.shape[2:]),
            jax.vmap(filled)(drive),
        )


def fitted(objective: Objective, unknowns: Unknowns) -> Unknowns:
    """Of unknowns those that are fitted, the others `None`: starts of pieces after the
    first always are, or pieces could not move."""
    if objective.free != "output":
        unknowns = eqx.tree_at(lambda u: u.first, unknowns, None)
    if objective.free == "state" or unknowns.starts.shape[1] > 1:
        return unknowns
    return eqx.tree_at(lambda u: u.starts, unknowns, None)


def first_unknowns(
    objective: Objective, first: Float[Array, " r"] | None = None
) -> Unknowns:
    """Where a fit starts: the model's own values; states from the measured output, or
    from a simulation where the output alone does not give them.

    **Arguments:** `first` outputs of the recordings other than the measured ones.
    """
    samples, parameters = objective.samples, objective.parameters
    model, values = parameters.model, parameters.values()
    n, pieces = samples.w.shape[1], objective.pieces
    rows = jnp.minimum(jnp.arange(pieces) * -(-(n - 1) // pieces), n - 1)
    held = at_samples(objective.remembered(model), samples)
    w = samples.w if first is None else samples.w.at[:, 0].set(first)
    here = jax.tree.map(lambda leaf: leaf[:, rows], (held, signals(samples), w))
    measured = jax.vmap(lambda *row: _measured_starts(model, *row))(*here)
    unknowns = Unknowns(values, measured, w[:, 0])
    if measured.shape[-1] <= 1 or pieces == 1:
        return unknowns
    single = replace(objective, pieces=1)
    run = single.run(replace(unknowns, starts=measured[:, :1]))
    return replace(unknowns, starts=run.states[:, rows])


def begun_at(
    objective: Objective,
    samples: Samples,
    values: Any,
    first: Float[Array, " r"],
) -> Float[Array, "r d"]:
    """States, flattened, in which the model of these values is where the output along
    samples begins at `first`."""
    model = objective.parameters.build(values)
    held = at_samples(remembered(model, samples), samples)
    return _measured_starts(
        model, _first_row(held), _first_row(signals(samples)), first
    )


def _measured_starts(
    model: AbstractModel, m: Any, now: Signals, w: Float[Array, " s"]
) -> Float[Array, "s d"]:
    """States, flattened, where the memory, the input and the output are these."""
    return jax.vmap(lambda *row: flat(first_state(model, *row)))(m, now, w)


def _first_row(rows: Any) -> Any:
    """Of arrays (R, n, ...) those at the first sample."""
    return at(rows, (slice(None), 0))


_HALVINGS = 4  # of the way to a start from which the record is lost


def check_starts(starts: int, spread: float, key) -> None:
    """Raise `InputError` for no starts, for a spread that is none, and for several
    starts without a key."""
    checks.count("starts", starts)
    size = checks.number("spread", spread)
    if checks.is_concrete(size) and not 0 <= float(size) < np.inf:
        raise InputError(f"`spread` must be zero or more and finite, got {spread!r}.")
    if starts > 1 and key is None:
        raise InputError("several `starts` need a `key`, such as `jax.random.key(0)`.")
    if starts > 1:
        checks.key("key", key)


def first_values(
    parameters: Parameters, starts: int, spread: float, key
) -> Float[Array, "s p"]:
    """Where each of the fits starts, in the units of the model's own values, which come
    first."""
    values = parameters.values()
    if starts == 1:
        return values[None]
    shape = (starts - 1, len(values))
    changes = jax.random.uniform(key, shape, values.dtype, -spread, spread)
    return jnp.concatenate([values[None], values * (1 + changes)])


def within_reach(
    objective: Objective, first: Float[Array, "s p"]
) -> Float[Array, "s p"]:
    """Where fits start, in their own units; half as far from the first of them, and
    again, where the model loses the record: few lead back from there, and all others
    would wait for it."""
    single = replace(objective, pieces=1)
    change = first - first[0]

    def by(share):
        return jax.vmap(lambda values: single.parameters.rescaled(values, 1))(
            first[0] + share[:, None] * change
        )

    def lost(values):
        model = single.parameters.build(values)
        there = eqx.tree_at(lambda o: o.parameters.model, single, model)
        unknowns = first_unknowns(there)
        return there.cost(unknowns, there.run(unknowns)) > FAR**2 / 2

    def halve(_, share):
        far = jax.vmap(lost)(by(share))
        return jnp.where(far, share / 2, share)

    share = jax.lax.fori_loop(0, _HALVINGS, halve, jnp.ones_like(first[:, 0]))
    return by(share)
