"""Residuals of simulated against measured output, as a function of what is fitted;
whether a law forgets its initial value; and where fits start."""

import itertools
import math
from dataclasses import replace
from typing import Any, Literal, TypeAlias

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._core import checks
from .._core.checks import InputError
from ..library import at
from ..models import AbstractModel
from ..signals import Signals
from ..simulation import first_state
from ._choices import AbstractLoss, Parameters
from ._samples import (
    Drive,
    Samples,
    at_samples,
    flat,
    pulls,
    remembered,
    signals,
    state_like,
    states,
)


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
_FIRMNESS = 10.0  # weight of a law that does not fade, against a misfit of 1
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
    told = jax.make_jaxpr(start)(zero).jaxpr
    read = itertools.chain(told.outvars, *(step.invars for step in told.eqns))
    return "output" if any(x is told.invars[0] for x in read) else "nothing"


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

    def run(self, unknowns: Unknowns, gain: Float[Array, ""] | None = None) -> Run:
        """The simulation of some unknowns.

        **Arguments:** `gain`, by which trajectories are drawn to the measured output.
        """
        samples, model = self.samples, self.parameters.build(unknowns.values)
        memory = remembered(model, samples) if self.memory is None else self.memory
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
        segments = jax.tree.map(lambda leaf: self._cut(leaf, length), drive)
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
        the root of the number of samples), of the gaps, and of fading.

        **Arguments:** `horizon`, the share of samples that counts; `gap_weight`;
        `gain` of nudging.
        """
        run = self.run(unknowns, gain)
        gaps = jnp.where(jnp.isfinite(run.gaps), run.gaps, _LOST)
        misfit = self._misfit(run.outputs, horizon)
        return misfit, gap_weight * gaps, self._unfading(unknowns, run)

    def gains(self, unknowns: Unknowns, run: Run) -> Float[Array, " r"]:
        """Of a law, the logarithm of the factor by which a difference in the output
        grows over each recording; over ten cycles of its input, where it has fewer."""
        model = self.parameters.build(unknowns.values)
        rows = run.states[..., 0], run.memory, signals(self.samples)
        gains = jax.vmap(lambda *row: exponents(model, *row)[1])(*rows)
        return self.samples.pace * gains

    def cost(self, unknowns: Unknowns, run: Run) -> Float[Array, ""]:
        """Half the sum of squared residuals of a run."""
        misfit, unfading = self._misfit(run.outputs, 1.0), self._unfading(unknowns, run)
        return (jnp.sum(misfit**2) + jnp.sum(unfading**2)) / 2

    def _misfit(
        self, outputs: Float[Array, "r n"], horizon: Float[Array, ""] | float
    ) -> Float[Array, "r n"]:
        samples = self.samples
        n = samples.w.shape[1]
        counts = jnp.arange(n) < horizon * n
        misfit = self.loss.signed_root(outputs - samples.w)
        lost = _LOST * samples.spread
        misfit = jnp.where(jnp.abs(misfit) < lost, misfit, lost)  # NaN is lost too
        unit = samples.spread * jnp.sqrt(samples.scored)
        return jnp.sqrt(samples.weight * counts) * misfit / unit

    def _starts(
        self, unknowns: Unknowns, model: AbstractModel, held: Any, now: Signals
    ) -> Float[Array, "r pieces d"]:
        """Where the pieces start, the first of each recording as the model has it if
        that is not fitted: its parameters may have a say."""
        if self.free == "state":
            return unknowns.starts
        first = self.samples.w[:, 0]
        if self.free == "output":  # without weight it would be anything
            first = jnp.where(self.samples.weight[:, 0] > 0, unknowns.first, first)
        first = _first_row(held), _first_row(now), first
        return unknowns.starts.at[:, 0].set(_measured_starts(model, *first))

    def _unfading(self, unknowns, run: Run):
        if not self.fading:
            return jnp.zeros(0)
        gained = jnp.nan_to_num(self.gains(unknowns, run))
        most = math.log(self.fading) - _SAFETY
        return _FIRMNESS * jax.nn.relu(gained - most)

    def _cut(self, leaf, length):
        """Rows of steps (R, m, ...) as (R pieces, length substeps, ...), the last piece
        filled up with steps of no length."""
        steps = length * self.samples.substeps
        extra = self.pieces * steps - leaf.shape[1]
        width = ((0, 0), (0, extra)) + ((0, 0),) * (leaf.ndim - 2)
        return jnp.pad(leaf, width).reshape(-1, steps, *leaf.shape[2:])


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
    held = at_samples(remembered(model, samples), samples)
    w = samples.w if first is None else samples.w.at[:, 0].set(first)
    here = jax.tree.map(lambda leaf: leaf[:, rows], (held, signals(samples), w))
    measured = jax.vmap(lambda *row: _measured_starts(model, *row))(*here)
    unknowns = Unknowns(values, measured, w[:, 0])
    if measured.shape[-1] <= 1 or pieces == 1:
        return unknowns
    single = replace(objective, pieces=1)
    run = single.run(replace(unknowns, starts=measured[:, :1]))
    return replace(unknowns, starts=run.states[:, rows])


def _measured_starts(
    model: AbstractModel, m: Any, now: Signals, w: Float[Array, " s"]
) -> Float[Array, "s d"]:
    """States, flattened, where the memory, the input and the output are these."""
    return jax.vmap(lambda *row: flat(first_state(model, *row)))(m, now, w)


def _first_row(rows: Any) -> Any:
    """Of arrays (R, n, ...) those at the first sample."""
    return at(rows, (slice(None), 0))


_HALVINGS = 4  # of the way to a start from which the record is lost


def check_starts(starts: int, key) -> None:
    """Raise `InputError` for no starts, and for several without a key."""
    if checks.whole("starts", starts) < 1:
        raise InputError(f"`starts` must be at least 1, got {starts}.")
    if starts > 1 and key is None:
        raise InputError("several `starts` need a `key`, such as `jax.random.key(0)`.")
    if starts > 1:
        checks.key("key", key)


def first_values(
    parameters: Parameters, starts: int, spread: float, key
) -> Float[Array, "s p"]:
    """Where each of the fits starts: the model's own values first."""
    values = parameters.values()
    if starts == 1:
        return values[None]
    shape = (starts - 1, len(values))
    changes = jax.random.uniform(key, shape, values.dtype, -spread, spread)
    return jnp.concatenate([values[None], values * (1 + changes)])


def within_reach(
    objective: Objective, first: Float[Array, "s p"]
) -> Float[Array, "s p"]:
    """Where fits start, half as far from the first of them, and again, where the model
    loses the record: few lead back from there, and all others would wait for it."""
    single = replace(objective, pieces=1)
    change = first - first[0]

    def lost(values):
        model = single.parameters.build(values)
        there = eqx.tree_at(lambda o: o.parameters.model, single, model)
        unknowns = first_unknowns(there)
        return there.cost(unknowns, there.run(unknowns)) > FAR**2 / 2

    def halve(_, share):
        far = jax.vmap(lost)(first[0] + share[:, None] * change)
        return jnp.where(far, share / 2, share)

    share = jax.lax.fori_loop(0, _HALVINGS, halve, jnp.ones_like(first[:, 0]))
    return first[0] + share[:, None] * change
