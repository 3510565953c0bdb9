"""Residuals of simulated against measured output, as a function of what is fitted."""

import math
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float

from ..models import AbstractModel
from ._fading import exponents
from ._losses import AbstractLoss
from ._parameters import Parameters
from ._samples import Samples, at_samples, pulls
from ._sensitivity import state_like, states

_LOST = 1e6  # residual over the output's spread of a trajectory that has blown up
_FIRMNESS = 10.0  # weight of a law that does not fade, against a misfit of 1
_SAFETY = 1e-3  # by which the penalty of laws that do not fade starts early


class Unknowns(eqx.Module):
    """What is fitted, in natural units.

    **Attributes:**

    - `values`: of the free parameters, shape (p,).
    - `starts`: states at the start of each piece of each recording, (R, pieces, d).
    """

    values: Float[Array, " p"]
    starts: Float[Array, "r pieces d"]


class Objective(eqx.Module):
    """Everything that residuals depend on but the unknowns.

    **Attributes:** `parameters`, `samples`, `loss` as their names say; `pieces` a
    recording is cut into; `fading`, the share of a difference in the output that a law
    may keep over a recording without being penalised, 0 for any;
    `free_starts`, whether recordings start where the fit likes, or where the model says
    they do.
    """

    parameters: Parameters
    samples: Samples
    loss: AbstractLoss
    pieces: int = eqx.field(static=True)
    fading: float = eqx.field(static=True)
    free_starts: bool = eqx.field(static=True)

    def states(
        self, unknowns: Unknowns, gain: Float[Array, ""] | None = None
    ) -> tuple[Float[Array, "r n d"], Any]:
        """Simulated states, and the gaps between pieces over the states' size.

        **Arguments:** `gain`, by which trajectories are drawn to the measured output.
        """
        samples = self.samples
        recordings, n = samples.w.shape
        pieces, d = unknowns.starts.shape[1:]
        length = -(-(n - 1) // pieces)
        pull = None if gain is None else pulls(samples, gain)
        grid, pull = jax.tree.map(
            lambda leaf: self._cut(leaf, length), (samples.grid, pull)
        )
        starts = self._starts(unknowns)
        path = states(
            unknowns.values,
            starts.reshape(-1, d),
            self.parameters,
            grid,
            pull,
            substeps=samples.substeps,
        ).reshape(recordings, pieces, length + 1, d)
        whole = path[:, :, :-1].reshape(recordings, -1, d)
        whole = jnp.concatenate([whole, path[:, -1, -1:]], axis=1)[:, :n]
        size = jax.lax.stop_gradient(jnp.std(whole, axis=(0, 1)))
        gaps = path[:, :-1, -1] - starts[:, 1:]
        return whole, gaps / jnp.where(size > 0, size, 1.0)

    def observed(
        self, unknowns: Unknowns, whole: Float[Array, "r n d"]
    ) -> Float[Array, "r n"]:
        """The outputs of simulated states."""
        model = self.parameters.build(unknowns.values)
        return jax.vmap(lambda t, rows: model.observe(t, _unflat(model, rows)))(
            self.samples.t, whole
        )

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
        whole, gaps = self.states(unknowns, gain)
        misfit = self._misfit(self.observed(unknowns, whole), horizon)
        gaps = jnp.where(jnp.isfinite(gaps), gaps, _LOST)
        return misfit, gap_weight * gaps, self._unfading(unknowns, whole)

    def gains(
        self, unknowns: Unknowns, whole: Float[Array, "r n d"]
    ) -> Float[Array, " r"]:
        """Of a law, the logarithm of the factor by which a difference in the output
        grows over each recording."""
        model = self.parameters.build(unknowns.values)
        rows = (self.samples.t, whole[..., 0], *at_samples(self.samples))
        return jax.vmap(lambda *row: exponents(model, *row)[1])(*rows)

    def cost(
        self,
        unknowns: Unknowns,
        whole: Float[Array, "r n d"],
        outputs: Float[Array, "r n"],
    ) -> Float[Array, ""]:
        """Half the sum of squared residuals, of known states and outputs."""
        misfit, unfading = self._misfit(outputs, 1.0), self._unfading(unknowns, whole)
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

    def _starts(self, unknowns: Unknowns) -> Float[Array, "r pieces d"]:
        """Where the pieces start, the first of each recording as the model has it if
        that is not fitted: its parameters may have a say."""
        if self.free_starts:
            return unknowns.starts
        model = self.parameters.build(unknowns.values)
        return unknowns.starts.at[:, 0].set(
            _measured_starts(model, self.samples.w[:, 0])
        )

    def _unfading(self, unknowns, whole):
        if not self.fading:
            return jnp.zeros(0)
        gained = jnp.nan_to_num(self.gains(unknowns, whole))
        most = math.log(self.fading) - _SAFETY
        return _FIRMNESS * jax.nn.relu(gained - most)

    def _cut(self, leaf, length):
        """Grid rows (R, m) as (R pieces, length substeps), the last piece filled up
        with steps of no length."""
        steps = length * self.samples.substeps
        extra = self.pieces * steps - leaf.shape[1]
        return jnp.pad(leaf, ((0, 0), (0, extra))).reshape(-1, steps)


def first_unknowns(objective: Objective) -> Unknowns:
    """Where a fit starts: the model's own values; states from the measured output, or
    from a simulation where the output alone does not give them."""
    samples, parameters = objective.samples, objective.parameters
    model, values = parameters.model, parameters.values()
    n, pieces = samples.w.shape[1], objective.pieces
    rows = jnp.minimum(jnp.arange(pieces) * -(-(n - 1) // pieces), n - 1)
    measured = jax.vmap(_measured_starts, (None, 0))(model, samples.w[:, rows])
    if measured.shape[-1] == 1 or pieces == 1:
        return Unknowns(values, measured)
    path = states(
        values,
        measured[:, 0],
        parameters,
        samples.grid,
        None,
        substeps=samples.substeps,
    )
    return Unknowns(values, path[:, rows])


def _measured_starts(
    model: AbstractModel, w: Float[Array, " s"]
) -> Float[Array, "s d"]:
    """States, flattened, at samples with these outputs."""
    return jax.vmap(lambda w: _flat(model.start(w, jnp.zeros_like(w))))(w)


def _flat(state) -> Array:
    return ravel_pytree(state)[0]


def _unflat(model, rows: Float[Array, "n d"]):
    return jax.vmap(lambda row: state_like(model, row))(rows)
