"""What laws are held against: samples, blocks of them that are left out in turn, and
inputs that go beyond the recorded ones."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Bool, Float, Int

from .. import refinement
from .._core.compiling import jit
from ..models import AbstractModel
from ..recording import Recording
from ..refinement import (
    LevenbergMarquardt,
    Objective,
    Samples,
    Squares,
    Unknowns,
    first_unknowns,
    free_of,
    minimise,
    parameters,
)
from ..refinement._objective import Run, begun_at
from ..refinement._solve import Minimum
from ..signals import Grid, Signals

# Blocks, each of which is one more refinement of every law that is judged by them: of
# all recordings together, and at most where whole recordings are left out.
_BLOCKS, _MOST = 6, 10
_LEAST = 30  # samples of a stretch
KEPT = -1  # what samples that are never left out belong to
NONE = -2  # the block that is left out of a fit to all
# Half ranges from the middle, within which outputs beyond are to stay: three times as
# fast, one in proportion to the rate gets three, and a little more between samples.
NEAR = 3.1

_LARGER, _FASTER, _SLOWER = (1.5, 1.0), (1.0, 3.0), (1.0, 0.5)  # amplitude and rate
_BEYOND = (_LARGER, _FASTER, _SLOWER)
# Of multisines: how many, and their frequencies, from a fifth of the input's own to
# twice that.
_WAVES, _LINES, _SLOWEST, _FASTEST = 4, 4, 0.2, 2.0
# How much farther outputs may get there. Backwards, the last, the input is as large as
# it was, but a record that only rises does not tell where it leads: only laws that run
# away are to be known by it, which get a thousand times as far and more.
# Of stacks with slow lags, which nothing else gives away, that is less.
_BACKWARDS, _BACKWARDS_OF_ALL = 5.0, 3.0
# Times more steps there: under larger inputs, over longer steps, and backwards from an
# output far from where the law leads, steps that are too long make laws run away that
# do not (8 were needed, on an MR damper).
_FINER = 8


class Layout(eqx.Module):
    """R recordings of up to n samples.

    **Attributes:**

    - `samples`: what is matched.
    - `blocks`: which block each sample belongs to, from 0 on, shape (R, n); -1 for
        none.
    - `outside`: the same recordings with inputs of 1.5 times the amplitude, three times
        as fast, half as fast, and backwards: what no output is known of. `None` where
        laws are not held against these.
    """

    samples: Samples
    blocks: Int[Array | np.ndarray, "r n"]
    outside: Samples | None

    @property
    def count(self) -> int:
        """The number of blocks."""
        return int(np.max(self.blocks)) + 1

    def without(
        self, block: Int[ArrayLike, ""], starts: Float[Array, " r"]
    ) -> tuple[Samples, Bool[Array, "r n"]]:
        """The samples, those of a block without weight, and which these are.

        What a free run begins with stays known, as well as all samples tell it by
        `starts`: else its start would go wherever the other blocks like.
        """
        samples = self.samples
        out = jnp.asarray(self.blocks == block)
        first = jnp.where(out[:, 0], starts, samples.w[:, 0])
        out = out.at[:, 0].set(False)
        seen = replace(
            samples,
            w=samples.w.at[:, 0].set(first),
            weight=jnp.where(out, 0.0, samples.weight),
        )
        return seen, out

    def beyond(self, objective: Objective, unknowns: Unknowns) -> Float[Array, "c r n"]:
        """Outputs under the inputs beyond the recorded ones, of which there must be
        some; those under an input that ran backwards in the order of the samples."""
        outside = self.outside
        assert outside is not None
        values, last = unknowns.values, self.samples.w[:, -1]
        rows = jax.tree.map(lambda x: x[-len(last) :], _rows(outside))
        # Of a device behind an offset or beside a spring the state is not the output.
        starts = begun_at(objective, replace(outside, **rows), values, last)
        starts = jnp.broadcast_to(starts[:, None], unknowns.starts.shape)
        backwards = Unknowns(values, starts, last)
        each = [*[unknowns] * len(_BEYOND), backwards]
        outputs = self._outputs(objective, outside, each)
        return outputs.at[-1].set(outputs[-1, :, ::-1])

    def otherwise(
        self, objective: Objective, unknowns: Unknowns
    ) -> Float[Array, "c r n"]:
        """Outputs under inputs of other waveforms, of which there must be some."""
        assert self.outside is not None
        waves = multisines(self.outside, len(self.samples.w))
        count = len(waves.w) // len(self.samples.w)
        return self._outputs(objective, waves, [unknowns] * count)

    def _outputs(
        self, objective: Objective, samples: Samples, each: Sequence[Unknowns]
    ) -> Float[Array, "c r n"]:
        """Outputs of one law along other samples, c times as many recordings, which
        begin as each of c unknowns says."""
        every = jax.tree.map(lambda *x: jnp.concatenate(x), *each)
        far = replace(objective, samples=samples, memory=None)
        outputs = far.run(replace(every, values=each[0].values)).outputs
        return outputs.reshape(-1, *self.samples.w.shape)

    def in_its_own_steps(self) -> "Layout":
        """The same with the inputs beyond in as many steps as the samples have: enough
        to see of most laws that they stay near."""
        if self.outside is None:
            return self
        return replace(self, outside=outside(self.samples))

    def distance(self, objective: Objective, unknowns: Unknowns) -> Float[Array, ""]:
        """How far they get from the middle of the recorded outputs, over half of their
        range, and backwards a fifth of it; 0 where there are no such inputs."""
        if self.outside is None:
            return jnp.zeros(())
        return self.from_middle(self.beyond(objective, unknowns))

    def from_middle(
        self, outputs: Float[Array, "c r n"], backwards: float = _BACKWARDS
    ) -> Float[Array, ""]:
        """The same of outputs that are known; backwards that over `backwards`."""
        samples = self.samples
        known = samples.weight > 0
        high = jnp.max(jnp.where(known, samples.w, -jnp.inf), axis=1)
        low = jnp.min(jnp.where(known, samples.w, jnp.inf), axis=1)
        middle, half = (high + low)[:, None] / 2, (high - low)[:, None] / 2
        allowed = jnp.array([*[1.0] * len(_BEYOND), backwards], outputs.dtype)
        allowed = allowed[:, None, None]
        distance = jnp.abs(outputs - middle) / half / allowed
        distance = jnp.where(known, distance, 0.0)
        return jnp.max(jnp.where(jnp.isfinite(distance), distance, jnp.inf))


def layout(
    recordings: Sequence[Recording],
    weights: Sequence[Float[ArrayLike, " _n"]] | None,
    substeps: int,
    beyond: bool,
) -> Layout:
    """Recordings as laws are held against them, and whether beyond them too."""
    samples = refinement.samples(recordings, weights, substeps)
    if beyond:
        finer = refinement.samples(recordings, weights, _FINER * substeps)
        kept = outside(finer)
    else:
        kept = None
    rows = blocks(recordings, np.asarray(samples.weight) > 0)
    _, numbers = np.unique(rows[rows != KEPT], return_inverse=True)
    rows[rows != KEPT] = numbers
    return Layout(samples, jnp.asarray(rows), kept)


class WithoutBlock(NamedTuple):
    """A model refined without a block: what it was refined by, where that ended, and
    its run through all samples; and which were left out."""

    objective: Objective
    end: Minimum
    run: Run
    out: Bool[Array, "r n"]


def refined_without(
    layout: Layout,
    model: AbstractModel,
    block: Int[ArrayLike, ""],
    starts: Float[Array, " r"],
    solver: LevenbergMarquardt,
    max_steps: int,
    *,
    fixed: Sequence[str] = (),
    fading: float,
) -> WithoutBlock:
    """Refine a model by all samples but those of a block, from its own numbers and the
    first outputs `starts`."""
    seen, out = layout.without(block, starts)
    objective = _matching(model, seen, fixed, fading)
    first = first_unknowns(objective, starts)
    end = minimise(objective, first, solver, max_steps)
    return WithoutBlock(objective, end, objective.run(end.unknowns), out)


def weighted_error(
    weighted: Float[Array, "r n"], weight: Float[Array, "r n"]
) -> Float[Array, ""]:
    """The root mean square of residuals that are multiplied by the roots of their
    weights, over those that have some in `weight`; infinite where one is not finite, 0
    where there are none."""
    total = jnp.sum(weight)
    squares = jnp.sum(jnp.where(weight > 0, weighted**2, 0.0))
    mean = squares / jnp.where(total > 0, total, 1.0)
    return jnp.sqrt(jnp.where(jnp.isfinite(mean), mean, jnp.inf))


@jit
def farthest(layout: Layout, model: AbstractModel) -> Float[Array, ""]:
    """How far the output of a model gets from the middle of the recorded ones, over
    half of their range, under inputs beyond theirs; backwards a third of that."""
    outputs = outputs_beyond(layout, model, layout.samples.w[:, 0])
    return layout.from_middle(outputs, _BACKWARDS_OF_ALL)


def outputs_beyond(
    layout: Layout, model: AbstractModel, starts: Float[Array, " r"]
) -> Float[Array, "c r n"]:
    """Outputs of a model under the inputs beyond the recorded ones, which begin as they
    begin there."""
    objective = _matching(model, layout.samples)
    return layout.beyond(objective, first_unknowns(objective, starts))


def _matching(
    model: AbstractModel,
    samples: Samples,
    fixed: Sequence[str] = (),
    fading: float = 0.0,
) -> Objective:
    names = parameters(model, fixed, {}, {})
    return Objective(names, samples, Squares(), 1, fading, free_of(model)).prepared()


def blocks(
    recordings: Sequence[Recording], scored: Bool[np.ndarray, "r n"]
) -> Int[np.ndarray, "r n"]:
    """Which block each sample belongs to; those that do not count to none, for they
    judge nothing.

    Of three recordings and more whole ones are left out, of many those together whose
    inputs have about the same range: a law is then judged at amplitudes, or rates, that
    it has not seen. Otherwise blocks are stretches, and begin where a cycle does if
    there are as many; a recording's first stretch is none of them, for what the device
    does as it is switched on it does only there. Neighbouring samples are no
    independent ones: single samples left out would judge nothing but the noise.

    **Source:** Roberts et al. (2017), doi 10.1111/ecog.02881.
    """
    lengths = [len(each) for each in recordings]
    rows = np.full((len(lengths), max(lengths)), KEPT)
    inputs = [np.asarray(each.u) for each in recordings]
    if len(lengths) > 2:
        order = np.argsort([np.ptp(u) for u in inputs], kind="stable")
        parts = np.array_split(order, min(_MOST, len(lengths)))
        for i, block in ((i, block) for block, part in enumerate(parts) for i in part):
            rows[i, : lengths[i]] = block
        return np.where(scored, rows, KEPT)
    first = 0
    for row, u, some in zip(rows, inputs, scored, strict=True):
        counting = np.flatnonzero(some)
        if not len(counting):
            continue
        count = max(1, min(_BLOCKS // len(lengths), len(counting) // _LEAST - 1))
        cuts = _cuts(u, counting, count + 1)
        stretch = np.searchsorted(cuts, counting, side="right") - 1
        row[counting] = np.where(stretch < 0, KEPT, first + stretch)
        first += count
    return rows


def _cuts(
    u: Float[np.ndarray, " n"], counting: Int[np.ndarray, " m"], count: int
) -> Int[np.ndarray, " c"]:
    """Where blocks after the first begin: evenly by the samples that count, but with a
    cycle where that leaves none much shorter than the others."""
    m = len(counting)
    even = counting[np.linspace(0, m, count + 1).astype(int)[1:-1]]
    middle = (np.max(u) + np.min(u)) / 2
    rising = np.flatnonzero((u[:-1] < middle) & (u[1:] >= middle)) + 1
    if not len(rising):
        return even
    nearest = rising[np.argmin(np.abs(rising[:, None] - even), axis=0)]
    shortest = np.min(np.diff([0, *np.searchsorted(counting, nearest), m]))
    return nearest if shortest > m / (2 * count) else even


@jit
def outside(samples: Samples) -> Samples:
    """The recordings with larger, faster, slower and backward inputs, one after the
    other; their outputs stay what they were, and are nothing to compare with.

    Backwards an input does what it did, in another order: a law that is to be used must
    bear it, and where a record only rises, one that no falling input has taught to come
    down again does not.
    """
    grid = samples.grid
    ends = jnp.concatenate([grid.start.u, grid.end.u], axis=1)
    low, high = jnp.min(ends, axis=1), jnp.max(ends, axis=1)
    # About zero, where the input comes by it; a bias stays what it is.
    about = jnp.where(low * high <= 0, 0.0, (low + high) / 2)[:, None]
    each = [_scaled(samples, about, *how) for how in _BEYOND]
    each.append(_backwards(samples))
    return _together(each)


def _rows(samples: Samples) -> dict[str, Any]:
    """What has a row for each recording."""
    names = ("t", "w", "weight", "known", "grid", "past", "pace")
    return {name: getattr(samples, name) for name in names}


def _together(each: Sequence[Samples]) -> Samples:
    """Recordings one after the other."""
    rows = jax.tree.map(lambda *x: jnp.concatenate(x), *map(_rows, each))
    return replace(each[0], **rows)


def multisines(outside: Samples, count: int) -> Samples:
    """So many recordings, the first of those with inputs beyond the recorded ones, with
    inputs of other waveforms: multisines of the same root mean square about the same
    mean and of frequencies about their own, and the same upside down.

    A sine, however large, leads outputs where it always does. Slow and fast together
    lead them elsewhere.

    **Source:** Rice (1944), doi 10.1002/j.1538-7305.1944.tb00874.x, for the frequency
    of an input that is no sine, by its root mean squares and those of its slope.
    """
    first = replace(outside, **jax.tree.map(lambda x: x[:count], _rows(outside)))
    t, steps = first.t[:, :1], first.grid.steps
    u, du = first.grid.middle.u, first.grid.middle.du

    def mean(x):
        return jnp.sum(steps * x, axis=1, keepdims=True) / jnp.sum(
            steps, axis=1, keepdims=True
        )

    middle = mean(u)
    variance = mean((u - middle) ** 2)
    # A recording whose input rests, beside others, stays at rest.
    own = jnp.sqrt(mean(du**2) / jnp.where(variance > 0, variance, 1.0))

    def waved(lines, phases, sign):
        amplitude = sign * jnp.sqrt(2 / len(lines) * variance)

        def signals(now: Signals) -> Signals:
            u, du = middle, jnp.zeros_like(middle)
            for line, phase in zip(lines, phases, strict=True):
                angle = line * own * (now.t - t) + phase
                u += amplitude * jnp.sin(angle)
                du += amplitude * line * own * jnp.cos(angle)
            return Signals(now.t, u, du)

        return replace(first, grid=Grid(steps, *map(signals, first.grid[1:])))

    return _together([waved(*wave, sign) for wave in _waves() for sign in (1.0, -1.0)])


def _waves() -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Frequencies, over the input's own, and phases of each multisine: by multiples of
    the golden ratio, which leave no gaps."""
    golden = (np.sqrt(5) - 1) / 2
    for i in range(_WAVES):
        lines = (np.arange(_LINES) + i * golden % 1) / _LINES
        phases = 2 * np.pi * ((i * _LINES + np.arange(_LINES)) * golden % 1)
        yield _SLOWEST + (_FASTEST - _SLOWEST) * lines, phases


def _backwards(samples: Samples) -> Samples:
    grid, t = samples.grid, samples.t

    def mirrored(now: Signals) -> Signals:
        first, last = t[:, :1], t[:, -1:]
        back = Signals(first + last - now.t, now.u, -now.du)
        return jax.tree.map(lambda leaf: leaf[:, ::-1], back)

    stages = mirrored(grid.end), mirrored(grid.middle), mirrored(grid.start)
    times = (t[:, :1] + t[:, -1:] - t)[:, ::-1]
    return replace(samples, t=times, grid=Grid(grid.steps[:, ::-1], *stages))


def _scaled(samples: Samples, about, amplitude: float, rate: float) -> Samples:
    def signals(now: Signals) -> Signals:
        u = about + amplitude * (now.u - about)
        return Signals(now.t / rate, u, amplitude * rate * now.du)

    def grid(each: Grid | None) -> Grid | None:
        if each is None:
            return None
        return Grid(each.steps / rate, *map(signals, each[1:]))

    return replace(
        samples,
        t=samples.t / rate,
        grid=grid(samples.grid),
        past=grid(samples.past),
    )
