"""Records with dropouts of the output."""

from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._core import checks
from .._core.errors import InputError
from ._recording import Column, Recording


def bridged(
    t: Any, u: Column, w: Column, **fields: Any
) -> tuple[Recording, Float[Array, " n"]]:
    """A recording across the dropouts of its output, and which samples those are.

    A device goes on while nobody looks: a model is simulated through all of the input,
    and held against the output where there is one. Rows cannot be left out for that,
    and in their place are straight lines from one known output to the next, which by
    their weight of 0 nothing is fitted to.

    **Arguments:**

    - `t`, `u`: times and input, as for `Recording`.
    - `w`: output, shape (n,), NaN where it is not known.
    - `fields`: `names`, `units` and others, as for `Recording`.

    **Returns:** the recording, and the weight of its samples, 1 or 0, shape (n,): for
    `weights=` of `judge`, and `weights=[...]` of `identify`, `refine` and `discover`.

    **Raises:** `InputError` where fewer than 3 outputs are known, and as `Recording`
    does.
    """
    output = checks.vector("w", w)
    checks.concrete("`bridged`", output)
    values = np.asarray(output)
    known = ~np.isnan(values)
    if np.sum(known) < 3:
        raise InputError(
            f"`w` has {np.sum(known)} values that are not NaN, and 3 are needed."
        )
    rows = np.arange(len(values)) if t is None else np.asarray(t)
    if len(rows) == len(values):  # else the recording will say so
        values = np.interp(rows, rows[known], values[known])
    recording = Recording(t, u, values, **fields)
    return recording, jnp.asarray(known, recording.t.dtype)
