"""Records as they were measured: of a device in its steady state or one that settles
first, with dropouts, and with samples that count less than others.
"""

from collections.abc import Sequence
from typing import Any, Literal, TypeAlias

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from .._core import checks
from .._core.checks import InputError
from ._noise import noise
from ._recording import Column, Past, Recording

_ALIKE = 1e-3  # of the input's range, by which its periods may differ
_LEAP = 2.0  # times the largest step of an input, that whole periods may end with


def steady(
    recording: Recording, period: int, *, lead_in: int | None = None
) -> tuple[Recording, Float[Array, " n"]]:
    """One period of a settled device, the mean of all whole ones, after a lead-in.

    With white noise a fit to the mean is the fit to all periods, at a fraction of the
    cost. Where a model starts the device was not at rest: the samples of the lead-in,
    in which it settles, have no weight. (`refine` and `judge` make their own lead-in of
    a period alone, `lead_in=0` here, by `periodic=True`.)

    **Arguments:**

    - `recording`: two periods or more; the device has settled before the first sample.
    - `period`: of the input, in samples.
    - `lead_in`: samples before the period, at most another one; half of one by default.

    **Returns:** the recording, and the weight of its samples, for `weights=[...]` of
    `refine` and `discover`.

    **Raises:** `InputError` for fewer than two periods, for an input that does not
    repeat itself so, for uneven samples, and for a lead-in that is longer than a
    period.
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
    part = recording.window(period, 2 * period)
    mean = eqx.tree_at(lambda each: each.w, part, jnp.asarray(np.mean(w, axis=0)))
    return led_in(mean, None, lead_in, periodic=True)


def led_in(
    recording: Recording,
    weights: Float[Array, " n"] | None,
    lead_in: int,
    periodic: bool,
) -> tuple[Recording, Float[Array, " m"]]:
    """What is simulated of a recording, and the weights of its samples: none in the
    lead-in.

    **Arguments:**

    - `recording`, `weights`: of n samples, all alike where there are no weights.
    - `lead_in`: in samples; the first ones, so that m = n, or if the recording is
        `periodic` as many more before it, m = lead_in + n, in which it goes round as
        often as that takes. Memory starts another period before.
    - `periodic`: whether the recording is of whole periods.

    **Raises:** `InputError` for a lead-in that is no number of samples or leaves none,
    and if `periodic` for uneven samples, and an input that does not close.
    """
    n = len(recording)
    lead_in = checked_lead_in(lead_in, n, periodic)
    if weights is None:
        weights = jnp.ones(n, recording.t.dtype)
    if not periodic:
        return recording, weights * (np.arange(n) >= lead_in)
    _check_closed(recording)
    rows = np.arange(-lead_in, n)
    u, w = (checks.rows(x, rows % n) for x in (recording.u, recording.w))
    step = (recording.t[-1] - recording.t[0]) / (n - 1)
    before = recording.t[0] - step * np.arange(lead_in + n, 0, -1)
    earlier = np.arange(-lead_in - n, -lead_in)
    whole = Recording(
        jnp.concatenate([before[n:], recording.t]),
        u,
        w,
        names=recording.names,
        units=recording.units,
        interpolation=recording.interpolation.elsewhere(recording.t, recording.u),
        clocked=recording.clocked,
        past=Past(before[:n], checks.rows(recording.u, earlier % n)),
    )
    return whole, checks.rows(weights, rows % n) * (rows >= 0)


def checked_lead_in(lead_in: int, n: int, periodic: bool) -> int:
    """A number of samples before, or if not `periodic` among, those of a recording."""
    lead_in = checks.whole("lead_in", lead_in)
    if lead_in < 0 or not (periodic or lead_in < n):
        raise InputError(
            f"`lead_in` counts samples, from 0 to less than the {n} of the recording"
            f" unless that is `periodic`; got {lead_in}."
        )
    return lead_in


def _check_closed(recording: Recording) -> None:
    """Raise `InputError` for an input that cannot go round."""
    checks.evenly_spaced("`periodic=True`", recording.t, "to whole periods")
    if not checks.is_concrete(recording.u):
        return
    u = np.asarray(recording.u)
    leap, largest = abs(u[0] - u[-1]), np.max(np.abs(np.diff(u)))
    if leap > _LEAP * largest:
        raise InputError(
            "`periodic=True` takes whole periods of the input, which goes on from the "
            f"last row as at the first: here it would leap by {leap:.3g}, and between "
            f"rows it changes by {largest:.3g} at most. Choose the rows of whole "
            "periods with `window`."
        )


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
        sizes = [noise_on(each) for each in recordings]
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


def noise_on(recording: Recording) -> float:
    """The standard deviation of the white noise on its output."""
    return noise(np.asarray(recording.w), np.asarray(recording.t))


def _checked(weights, recordings) -> list[Array]:
    if len(weights) != len(recordings):
        raise InputError(
            f"`weights` needs one array for each of the {len(recordings)} recordings, "
            f"got {len(weights)}."
        )
    pairs = zip(weights, recordings, strict=True)
    return [checks.weights(weight, recording.w) for weight, recording in pairs]
