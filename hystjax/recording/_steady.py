"""A record of a periodic input, once the device has settled, as one period."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._core import checks
from .._core.errors import InputError
from ._recording import Recording

_ALIKE = 1e-3  # of the input's range, by which its periods may differ


def steady(
    recording: Recording, period: int, *, lead_in: int | None = None
) -> tuple[Recording, Float[Array, " n"]]:
    """One period of a settled device, the mean of all whole ones, after a lead-in.

    With white noise a fit to the mean is the fit to all periods, at a fraction of the
    cost. Where a model starts the device was not at rest: the samples of the lead-in,
    in which it settles, have no weight.

    **Arguments:**

    - `recording`: two periods or more; the device has settled before the first sample.
    - `period`: of the input, in samples.
    - `lead_in`: samples before the period, at most another one; half of one by default.

    **Returns:** the recording, and the weight of its samples, for `weights=[...]` of
    `refine` and `discover`.

    **Raises:** `InputError` for fewer than two periods, for an input that does not
    repeat itself so, and for a lead-in that is longer than a period.
    """
    checks.concrete("`steady`", recording)
    count = len(recording) // period if period >= 3 else 0
    if count < 2:
        raise InputError(
            f"`period={period}` must be 3 samples or more, and the recording hold two "
            f"periods; it has {len(recording)} samples."
        )
    lead_in = period // 2 if lead_in is None else lead_in
    if not 0 <= lead_in <= period:
        raise InputError(
            f"`lead_in` must be between 0 and the period of {period} samples, got "
            f"{lead_in}."
        )
    u, w = (
        np.asarray(x[: count * period]).reshape(count, period)
        for x in (recording.u, recording.w)
    )
    apart = float(np.max(np.ptp(u, axis=0)))
    if apart > _ALIKE * np.ptp(u):
        raise InputError(
            f"the input does not repeat itself every {period} samples: its periods "
            f"differ by up to {apart:.3g}. Check `period`, and leave out rows before "
            "the first whole one with `window`."
        )
    part = recording.window(period - lead_in, 2 * period)
    mean = jnp.tile(jnp.asarray(np.mean(w, axis=0)), 2)[period - lead_in :]
    weight = (jnp.arange(len(part)) >= lead_in).astype(mean.dtype)
    return eqx.tree_at(lambda each: each.w, part, mean), weight
