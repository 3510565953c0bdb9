"""Find samples of the output that do not belong, and repair them."""

import itertools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Bool, Float

from .._core import checks
from .._core.compiling import jit
from ._recording import Recording

_WINDOW = 9  # samples: three that fix a parabola, and a majority to agree with it
_OFFSETS = (_WINDOW // 2, 0, _WINDOW - 1)  # windows around, after and before a sample
_TRIPLES = np.array(list(itertools.combinations(range(_WINDOW - 1), 3)))
_NORMAL = 1.4826  # standard deviation of normal numbers over their median magnitude


class Outliers(eqx.Module):
    """Which samples of an output are bad, and the recording without them.

    **Attributes:**

    - `mask`: shape (n,), true where a sample is bad.
    - `repaired`: the recording, with outputs predicted from their neighbours there.
    - `deviation`: of each sample from that prediction, shape (n,), output units.
    - `limit`: the deviation from which on a sample is bad, output units.
    """

    mask: Bool[Array, " n"]
    repaired: Recording
    deviation: Float[Array, " n"]
    limit: Float[Array, ""]


@jit
def outliers(
    recording: Recording, *, threshold: ArrayLike = 10.0, floor: ArrayLike = 0.01
) -> Outliers:
    """Find outputs that their neighbours contradict.

    Each sample is predicted by the parabola that most of its eight neighbours agree on:
    of all that pass through three of them, the one with the least median distance from
    the eight. That is done for the neighbours around it, before it and after it, and
    the closest prediction counts: a corner at a turning point is smooth from one side.
    Nine samples must be so close together that the output is almost a parabola there;
    where bad samples crowd all three windows, a good one may be taken for bad too.

    **Arguments:**

    - `recording`: with gross errors in a few of its outputs.
    - `threshold`: least deviation of an outlier, as a multiple of the typical one: 1.48
        times their median.
    - `floor`: least deviation of an outlier, as a share of the output's own spread (so
        measured as well), which matters for records without noise.

    **Returns:** `Outliers`.

    **Raises:** `InputError` when there are fewer than nine samples, or `threshold` or
    `floor` is negative.

    **Source:** Rousseeuw (1984), least median of squares, doi
    10.1080/01621459.1984.10477105.
    """
    checks.positive("threshold", threshold, zero=True)
    checks.positive("floor", floor, zero=True)
    t, w = recording.t, recording.w
    checks.enough_samples("`outliers`", t.shape[0], _WINDOW)
    predicted = _predictions(t, w)
    deviation = jnp.abs(w - predicted)
    limit = jnp.maximum(
        threshold * _NORMAL * jnp.median(deviation),
        floor * _NORMAL * jnp.median(jnp.abs(w - jnp.median(w))),
    )
    mask = deviation > limit
    repaired = eqx.tree_at(
        lambda each: each.w, recording, jnp.where(mask, predicted, w)
    )
    return Outliers(mask, repaired, deviation, limit)


def _predictions(t, w):
    """Of every sample, the closest of its windows' predictions."""
    n = t.shape[0]
    row = jnp.arange(n)
    options = []
    for offset in _OFFSETS:
        start = jnp.clip(row - offset, 0, n - _WINDOW)
        options.append(jax.vmap(_prediction, (None, None, 0, 0))(t, w, row, start))
    options = jnp.stack(options)
    best = jnp.argmin(jnp.abs(options - w), axis=0)
    return jnp.take_along_axis(options, best[None], axis=0)[0]


def _prediction(t, w, row, start):
    """Of one sample, from the others of the window that begins at `start`."""
    others = start + jnp.arange(_WINDOW - 1)
    others = others + (others >= row)
    reach = t[start + _WINDOW - 1] - t[start]
    times, values = (t[others] - t[row]) / reach, w[others]
    at = jnp.append(times, 0.0)
    lines = jax.vmap(lambda triple: _parabola(times[triple], values[triple], at))
    fits = lines(_TRIPLES)
    misfit = jnp.median(jnp.abs(fits[:, :-1] - values), axis=1)
    return fits[jnp.argmin(misfit), -1]


def _parabola(x, y, at):
    """Values at `at` of the parabola through three points."""
    a, b, c = x
    first = (at - b) * (at - c) / ((a - b) * (a - c))
    second = (at - a) * (at - c) / ((b - a) * (b - c))
    third = (at - a) * (at - b) / ((c - a) * (c - b))
    return y[0] * first + y[1] * second + y[2] * third
