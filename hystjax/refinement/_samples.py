"""Recordings laid out for trajectory matching: one batch, whatever their lengths."""

from collections.abc import Sequence
from typing import TypeAlias

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from .. import _checks
from .._errors import InputError
from .._jit import jit
from .._recording import Recording
from ..interpolation import Grid

Pulls: TypeAlias = tuple[Float[Array, "r m"], Float[Array, "r m"], Float[Array, "r m"]]


class Samples(eqx.Module):
    """R recordings padded to one length n: padded samples have no weight and their
    steps no length, so that they change nothing.

    **Attributes:**

    - `t`, `w`, `weight`: sample times, output, and weights, each (R, n). A residual is
        the square root of the weight times simulated minus measured.
    - `grid`: of each recording, its arrays of shape (R, m) with m = substeps (n - 1).
    - `scored`: number of samples with weight, a float: derivatives pass by.
    - `spread`: root mean square of the output about its mean, over weighted samples.
    - `substeps`: integration steps a sample interval.
    """

    t: Float[Array, "r n"]
    w: Float[Array, "r n"]
    weight: Float[Array, "r n"]
    grid: Grid
    scored: Float[Array, ""]
    spread: Float[Array, ""]
    substeps: int = eqx.field(static=True)


def samples(
    recordings: Sequence[Recording],
    weights: Sequence[Float[ArrayLike, " _n"]] | None,
    substeps: int,
) -> Samples:
    """Lay out recordings of any lengths and rates.

    **Arguments:** `weights`, one array for each recording, shape (n,), zero or more;
    all ones by default.

    **Raises:** `InputError` for weights of another length, or negative ones.
    """
    if weights is None:
        weights = [np.ones(len(each), each.t.dtype) for each in recordings]
    group = tuple(recordings)
    return _laid_out(group, _checked(weights, group), substeps)


def pulls(samples: Samples, gain: Float[Array, ""]) -> Pulls:
    """What draws trajectories to the measured output before each of m steps: the gain,
    zero but for steps that start at a sample later than the first; and the time and the
    output there."""
    steps = jnp.arange(samples.substeps * (samples.w.shape[1] - 1))
    gains = jnp.where((steps > 0) & (steps % samples.substeps == 0), gain, 0.0)
    times, outputs = (
        jnp.repeat(leaf[:, :-1], samples.substeps, axis=1)
        for leaf in (samples.t, samples.w)
    )
    return jnp.broadcast_to(gains, times.shape), times, outputs


def at_samples(samples: Samples) -> tuple[Float[Array, "r n"], Float[Array, "r n"]]:
    """u and u' (right limits) at the sample times, shape (R, n)."""
    _, u, du = samples.grid

    def pick(stages):
        ends = stages[0][:, :: samples.substeps], stages[2][:, -1:]
        return jnp.concatenate(ends, axis=1)

    return pick(u), pick(du)


@jit
def _laid_out(recordings, weights, substeps: int) -> Samples:
    longest = max(len(recording) for recording in recordings)
    rows = [
        _padded(recording, weight, substeps, longest)
        for recording, weight in zip(recordings, weights, strict=True)
    ]
    t, w, weight, grid = jax.tree.map(lambda *leaves: jnp.stack(leaves), *rows)
    scored = jnp.sum(weight > 0, dtype=weight.dtype)
    return Samples(t, w, weight, grid, scored, _spread(w, weight), substeps)


def _spread(w: Float[Array, "r n"], weight: Float[Array, "r n"]) -> Float[Array, ""]:
    total = jnp.sum(weight)
    mean = jnp.sum(weight * w) / total
    return jnp.sqrt(jnp.sum(weight * (w - mean) ** 2) / total)


def _padded(recording: Recording, weight, substeps: int, longest: int):
    """Times, outputs, weights and grid of one recording."""
    extra = longest - len(recording)
    steps, u, du = recording.path.grid(substeps)
    u, du = jax.tree.map(lambda leaf: _held(leaf, extra * substeps), (u, du))
    return (
        _held(recording.t, extra),
        _held(recording.w, extra),
        jnp.pad(weight, (0, extra)),
        Grid(jnp.pad(steps, (0, extra * substeps)), u, du),
    )


def _held(row: Float[Array, " n"], extra: int) -> Float[Array, " m"]:
    """A row that keeps its last value for so many more."""
    return jnp.pad(row, (0, extra), mode="edge")


def _checked(weights, recordings) -> list[Array]:
    if len(weights) != len(recordings):
        raise InputError(
            f"`weights` needs one array for each of the {len(recordings)} recordings, "
            f"got {len(weights)}."
        )
    arrays = [_checks.vector("weights", weight) for weight in weights]
    for array, recording in zip(arrays, recordings, strict=True):
        _checks.same_length(weights=array, w=recording.w)
        _checks.finite("weights", array)
        _checks.positive("weights", array, zero=True)
    return arrays
