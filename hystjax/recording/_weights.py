"""How much the samples of recordings count."""

from collections.abc import Sequence
from typing import Literal, TypeAlias

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from .._core import checks
from .._core.errors import InputError
from ._noise import noise
from ._recording import Recording

Weights: TypeAlias = Sequence[Float[ArrayLike, " _n"]] | Literal["range", "noise"]
"""Of the samples, one array for each recording, shape (n,); or by what whole recordings
are weighed: the inverse square of the range of each, or of the noise on it."""


def weights_of(recordings: Sequence[Recording], given: Weights) -> list[Array]:
    """The weights of the samples of each recording, shape (n,).

    **Raises:** `InputError` for arrays of another length, or negative ones, and where
    there is no noise to weigh by.
    """
    if not isinstance(given, str):
        return _checked(given, recordings)
    checks.concrete(f"`weights={given!r}`", [each.w for each in recordings])
    if given == "range":
        sizes = [float(np.ptp(np.asarray(each.w))) for each in recordings]
    elif given == "noise":
        sizes = [noise(np.asarray(each.w), np.asarray(each.t)) for each in recordings]
    else:
        raise InputError(
            f'`weights` must be arrays, "range" or "noise", got {given!r}.'
        )
    if min(sizes) <= 0:
        raise InputError(
            f"`weights={given!r}` cannot weigh recording {int(np.argmin(sizes))}: its "
            f"{given} is zero. Give arrays, or leave that recording out."
        )
    pairs = zip(recordings, sizes, strict=True)
    return [jnp.full(len(each), size**-2.0, each.t.dtype) for each, size in pairs]


def _checked(weights, recordings) -> list[Array]:
    if len(weights) != len(recordings):
        raise InputError(
            f"`weights` needs one array for each of the {len(recordings)} recordings, "
            f"got {len(weights)}."
        )
    pairs = zip(weights, recordings, strict=True)
    return [checks.weights(weight, recording.w) for weight, recording in pairs]
