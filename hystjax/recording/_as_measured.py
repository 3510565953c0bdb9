"""Records as they are given, one or several of a device, and as they were measured: in
a steady state or one that settles first, with dropouts, and with samples that count
less than others; how noisy they are; and samples that do not belong."""

import itertools
import math
import os
from collections.abc import Mapping, Sequence
from typing import Any, Literal, TypeAlias

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Bool, Float

from .._core import checks
from .._core.checks import InputError, described, is_concrete, warn
from .._core.compiling import jit
from .._core.show import Card, Shown, quantity
from ..signals.excitation import AbstractExcitation
from ._long import LongRecording
from ._notation import differ
from ._recording import FIELDS, Column, Past, Recording, seconds


def as_recording(given: Any, call: str, name: str = "recording") -> Recording:
    """A recording, as it was given.

    **Arguments:** what was given; the `call`, with its arguments in order, such as
    `judge(model, recording)`; and the name of this one.

    **Raises:** `InputError` for a batch, and for something else, with what is likely to
    be meant.
    """
    if isinstance(given, Recording):
        if given.t.ndim != 1:
            raise InputError(
                f"`{name}` holds a batch, with arrays of shape {given.t.shape}; call "
                "this under `jax.vmap`, or take the recordings apart."
            )
        return given
    if isinstance(given, LongRecording):
        some = f"window(0, {min(len(given), 10_000)})"
        raise InputError(
            f"`{name}` must be a `Recording` in memory, and a `LongRecording` stays on "
            "disk, for `hystjax.identify` alone. `long.window(start, stop)` makes a "
            f"`Recording` of some rows, such as `long.{some}`."
        )
    raise InputError(
        f"`{name}` must be a `Recording`, got {described(given)}. {_likely(given)}"
        f"The order is `{call}`."
    )


def as_group(
    recordings: Recording | Sequence[Recording],
    call: str = "identify(recordings, library)",
) -> tuple[Recording, ...]:
    """One or several recordings as a tuple; the `call` is for messages.

    **Raises:** `InputError` when there is none, one is a batch, their units or names
    differ, or something else was given.
    """
    several = isinstance(recordings, list | tuple)
    group = tuple(recordings) if several else (recordings,)
    group = tuple(as_recording(each, call, "recordings") for each in group)
    if not group:
        raise InputError("`recordings` is empty; pass at least one recording.")
    _check_alike(group)
    return group


def _check_alike(group: tuple[Recording, ...]) -> None:
    """Raise `InputError` unless all recordings have the units and names of the first:
    a law has one unit for its input, and one for its output."""
    first = group[0]
    cures = {
        "units": "Convert the columns to one unit each, and give that as `units`.",
        "names": "If they are the same quantities, give them the same names: "
        "`dataclasses.replace(recording, names=...)`.",
    }
    for kind, cure in cures.items():
        for number, other in enumerate(group):
            own, others = getattr(first, kind), getattr(other, kind)
            spelt = kind == "units" and all(map(_same_unit, own, others))
            if own != others and not spelt:
                raise InputError(
                    f"`recordings` must be of one device, and the {kind} of recording "
                    f"{number} are {others}, those of recording 0 {own}. {cure}"
                )


def _same_unit(one: str, other: str) -> bool:
    """Whether two units are one, however they are spelt; none is another one."""
    return bool(one) == bool(other) and not differ(one, other)


def _likely(value: Any) -> str:
    """What is likely to be wrong."""
    if isinstance(value, AbstractExcitation):
        return "`excitation.path(t)` is its input at times t. "
    if all(hasattr(value, name) for name in "tuw"):  # such as a trajectory
        return "`hystjax.Recording(x.t, x.u, x.w)` makes one of such an x. "
    if isinstance(value, eqx.Module):
        return "Were the arguments swapped? "
    if isinstance(value, np.ndarray | jax.Array):
        return "`hystjax.Recording(t, u, w)` makes one of three columns. "
    if isinstance(value, str | os.PathLike):
        return "`hystjax.Recording.from_csv` reads a file. "
    if hasattr(value, "columns"):
        return "`hystjax.Recording.from_pandas` makes one of a frame. "
    if isinstance(value, Sequence | Mapping):
        return "Give one recording at a time. "
    return ""


_ALIKE = 1e-3  # of the input's range, by which its periods may differ


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
    repeat itself so, for uneven samples, for a lead-in that is longer than a period,
    and for what is no recording.
    """
    recording = as_recording(recording, "steady(recording, period)")
    checks.concrete("`steady`", recording)
    period = checks.whole("period", period)
    count = len(recording) // period if period >= 3 else 0
    if count < 2:
        raise InputError(
            f"`period={period}` must be 3 samples or more, and the recording hold two "
            f"periods; it has {len(recording)} samples."
        )
    lead_in = period // 2 if lead_in is None else checks.whole("lead_in", lead_in)
    if not 0 <= lead_in <= period:
        raise InputError(
            f"`lead_in` must be between 0 and the period of {period} samples, got "
            f"{lead_in}."
        )
    checks.evenly_spaced("`steady`", recording.t[: count * period], "to whole periods")
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
    return led_in(mean, None, lead_in, periodic=True, what="`steady`")


def led_in(
    recording: Recording,
    weights: Float[Array, " n"] | None,
    lead_in: int,
    periodic: bool,
    what: str = "`periodic=True`",
) -> tuple[Recording, Float[Array, " m"]]:
    """What is simulated of a recording, and the weights of its samples: none in the
    lead-in.

    **Arguments:**

    - `recording`, `weights`: of n samples, all alike where there are no weights.
    - `lead_in`: in samples; the first ones, so that m = n, or if the recording is
        `periodic` as many more before it, m = lead_in + n, in which it goes round as
        often as that takes. Memory starts another period before.
    - `periodic`: whether the recording is of whole periods.
    - `what`: what takes it for that, for messages.

    **Raises:** `InputError` for a lead-in that is no number of samples or leaves none,
    and if `periodic` for uneven samples, and an input that does not close.
    """
    n = len(recording)
    lead_in = checked_lead_in(lead_in, n, periodic)
    if weights is None:
        weights = jnp.ones(n, recording.t.dtype)
    if not periodic:
        return recording, weights * (np.arange(n) >= lead_in)
    checks.evenly_spaced(what, recording.t, "to whole periods")
    checks.whole_periods(what, recording.u, recording.w)
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
    does. Warns where the first is not, which free runs start from.
    """
    checks.keywords("bridged", fields, ("t", "u", "w", *FIELDS))
    output = checks.vector("w", w)
    checks.concrete("`bridged`", output)
    values = np.asarray(output)
    known = ~np.isnan(values)
    if np.sum(known) < 3:
        raise InputError(
            f"`w` has {np.sum(known)} values that are not NaN, and 3 are needed."
        )
    numbers = np.arange(len(values)) if t is None else seconds(t)
    rows = np.asarray(checks.vector("t", numbers))
    if len(rows) == len(values):  # else the recording will say so
        values = np.interp(rows, rows[known], values[known])
    recording = Recording(t, u, values, **fields)
    if not known[0]:
        first = int(np.argmax(known))
        warn(
            f"the first {first} values of `w` are NaN, and free runs start from the "
            f"first: that of row {first} stands there. Leave these rows out, by "
            f"`recording.window({first}, {len(values)})` and `weights[{first}:]`, or "
            "give `judge` and `simulate` a `w0`.",
        )
    return recording, jnp.asarray(known, recording.t.dtype)


def all_across(
    recordings: Sequence[Recording], weights: Sequence[Array] | None
) -> tuple[Recording, ...]:
    """The recordings with straight lines in place of outputs that have no weight, for
    what looks at all of them; as they are where none has one, and so are left out."""
    if weights is None:
        return tuple(recordings)
    return tuple(
        across(each, known) if np.any(np.asarray(known) > 0) else each
        for each, known in zip(recordings, weights, strict=True)
    )


def from_known(recording: Recording, weights: Float[Array, " n"]) -> Recording:
    """The recording with the first output that has a weight for its first, where that
    has none and is like none that has: from there runs begin."""
    if not is_concrete(weights) or float(weights[0]) > 0 or not np.any(weights):
        return recording
    known = np.flatnonzero(np.asarray(weights) > 0)
    begun, seen = recording.w[0], recording.w[known]
    alike = (jnp.min(seen) <= begun) & (begun <= jnp.max(seen))
    begun = jnp.where(alike, begun, seen[0])
    return eqx.tree_at(lambda each: each.w, recording, recording.w.at[0].set(begun))


def across(recording: Recording, weights: Float[Array, " n"]) -> Recording:
    """One recording so.

    **Raises:** `InputError` where no output has a weight.
    """
    t, w, known = (np.asarray(x) for x in (recording.t, recording.w, weights > 0))
    if not known.any():
        raise InputError(
            "`weights` of a recording are all 0: leave that recording out, or give "
            "some of its samples a weight."
        )
    lines = jnp.asarray(np.interp(t, t[known], w[known]), w.dtype)
    return eqx.tree_at(lambda each: each.w, recording, lines)


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


def noise_on(
    recording: Recording, known: Bool[np.ndarray, " n"] | None = None
) -> float:
    """The standard deviation of the white noise on its output, or on the part of it
    that is `known`: straight lines across dropouts have none."""
    w, t = np.asarray(recording.w), np.asarray(recording.t)
    return noise(w, t) if known is None else noise(w[known], t[known])


def noise_on_all(
    recordings: Sequence[Recording],
    weights: Float[Array, "records n"],
    sizes: Sequence[float] | None = None,
) -> float:
    """The root mean square of the white noise on the samples that have a weight, of
    each recording over its size where there are `sizes`; rows of `weights` are as long
    as the longest recording."""
    known = np.asarray(weights) > 0
    noises = np.array(
        [noise_on(x, row[: len(x)]) for x, row in zip(recordings, known, strict=True)]
    )
    shares = noises if sizes is None else noises / np.asarray(sizes)
    return math.sqrt(np.average(shares**2, weights=np.sum(known, axis=1)))


def _checked(weights, recordings) -> list[Array]:
    counted = hasattr(weights, "__len__")
    got = len(weights) if counted else described(weights)
    if got != len(recordings):
        raise InputError(
            f"`weights` needs one array for each of the {len(recordings)} recordings, "
            f"got {got}."
        )
    pairs = zip(weights, recordings, strict=True)
    return [checks.weights(weight, recording.w) for weight, recording in pairs]


NORMAL = 1.4826  # from the median of absolute deviations to a standard deviation
_CUT = 2.0  # standard deviations within which differences count beside corners
_INSIDE = 0.7737  # variance of what of a normal variable of variance 1 is within
_TURNS = 20  # until that hardly changes
_BLOCKS, _BLOCK = 32, 4096  # of a long column, what is looked at
_MOST = 1024  # samples of the widest half window


def noise(x: Float[np.ndarray, " n"], t: Float[np.ndarray, " n"]) -> float:
    """The standard deviation of white noise in a column that is smooth without it, over
    times or numbers `t`, by the median of what parabolas through three samples miss of
    the fourth; corners and glitches are too few to count.

    **Source:** differences as in Rice (1984), doi 10.1214/aos/1176346788; divided, for
    uneven sampling, as in Gasser, Sroka and Jennen-Steinmetz (1986), doi
    10.1093/biomet/73.3.625.
    """
    return _typical(_missed(x, t))


def noise_beside_corners(
    x: Float[np.ndarray, " n"], t: Float[np.ndarray, " n"]
) -> float:
    """What `noise` is, but where few samples a cycle make corners many: the root mean
    square of what is missed, less what is beyond twice that, found in turns.

    **Source:** the trimmed mean of squares of Huber (1981), *Robust Statistics*, 5.
    """
    missed = _missed(x, t)
    sigma = _typical(missed)
    for _ in range(_TURNS):
        inner = missed[missed <= _CUT * sigma]
        sigma = float(np.sqrt(np.mean(inner**2) / _INSIDE)) if inner.size else 0.0
    return sigma


def _missed(
    x: Float[np.ndarray, " n"], t: Float[np.ndarray, " n"]
) -> Float[np.ndarray, " m"]:
    """What parabolas through three samples miss of the fourth, where it is any, divided
    so that it has the standard deviation of the noise; none where most is nothing."""
    if len(x) < 4:
        return np.empty(0)
    times, values = (
        np.lib.stride_tricks.sliding_window_view(_excerpts(each), 4, axis=1)
        for each in (t, x)
    )
    apart = times[..., :, None] - times[..., None, :] + np.eye(4)
    weights = 1 / np.prod(apart / apart[..., :1, 1:2], axis=-1)
    weights /= np.linalg.norm(weights, axis=-1, keepdims=True)
    # From a value near by, so that an offset is not rounded into noise.
    missed = np.abs(np.sum(weights * (values - values[..., :1]), axis=-1))
    # Equally spaced times are not quite equal, nor are then exactly straight lines.
    moved = missed[missed > 1e-12 * np.ptp(x)]
    # Where most differences are exactly zero, what is left are corners of straight
    # lines. Where few are, the column is rounded, and zeros hide its noise.
    return moved if len(moved) >= 0.3 * missed.size else np.empty(0)


def _typical(missed: Float[np.ndarray, " m"]) -> float:
    return float(NORMAL * np.median(missed)) if missed.size else 0.0


def quantum(x: Float[np.ndarray, " n"]) -> float:
    """The step of a column that was rounded, 0 where neighbours are hardly ever
    equal."""
    steps = np.abs(np.diff(_excerpts(x), axis=1))
    moved = steps[steps > 0]
    if not moved.size or moved.size > 0.9 * steps.size:
        return 0.0
    return float(np.min(moved))


def half_window(x: Float[np.ndarray, " n"], sigma: float, times: float) -> int:
    """Half the samples that a column with noise `sigma` typically takes to move by so
    many `times` that: over them it may be smoothed, and loses little beside noise."""
    if sigma == 0:
        return 0
    block = _excerpts(x)
    lag = 1
    # The fast four fifths decide, so that rests do not.
    while lag < min(2 * _MOST, block.shape[1] // 4):
        moved = np.abs(block[:, lag:] - block[:, :-lag])
        # Noise alone moves as many by less than 1.81 of its standard deviations.
        if np.quantile(moved, 0.8) >= sigma * np.hypot(times, 1.81):
            break
        lag *= 2
    return lag // 2


def glitches(x: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """The column without samples, one or two in a row, that leap out of it: ten times
    as far from the median of the five around them as neighbours typically lie apart."""
    typical = float(np.quantile(np.abs(np.diff(_excerpts(x), axis=1)), 0.95))
    before, after = np.diff(x[:-1]), np.diff(x[1:])
    # A leap is needed to get out: where there is none, medians are not.
    leaps = np.flatnonzero(np.maximum(np.abs(before), np.abs(after)) > 5 * typical) + 1
    if typical == 0 or not leaps.size or len(x) < 5:
        return x
    near = np.unique((leaps[:, None] + np.arange(-1, 2)).clip(0, len(x) - 1))
    start = (near - 2).clip(0, len(x) - 5)
    middle = np.median(x[start[:, None] + np.arange(5)], axis=1)
    far = np.abs(x[near] - middle) > 10 * typical
    mended = x.copy()
    mended[near[far]] = middle[far]
    return mended


def _excerpts(x: Float[np.ndarray, " n"]) -> Float[np.ndarray, "b m"]:
    """Blocks of a column, evenly along it; all of a short one."""
    if len(x) <= _BLOCKS * _BLOCK:
        return x[None]
    starts = np.linspace(0, len(x) - _BLOCK, _BLOCKS).astype(int)
    return np.lib.stride_tricks.sliding_window_view(x, _BLOCK)[starts]


_WINDOW = 9  # samples: three that fix a parabola, and a majority to agree with it
_OFFSETS = (_WINDOW // 2, 0, _WINDOW - 1)  # windows around, after and before a sample
# Of 32 bits: JAX remembers programs by other types across a switch of `jax_enable_x64`.
_TRIPLES = np.array([*itertools.combinations(range(_WINDOW - 1), 3)], np.int32)
_AT_A_TIME = 256  # samples, of 85 kB each: more do not fit into a cache


_LISTED = 10  # rows, of those that are bad


class Outliers(Shown):
    """Which samples of an output are bad, and the recording without them.

    **Attributes:**

    - `mask`: shape (n,), true where a sample is bad.
    - `repaired`: the recording, with outputs predicted from their neighbours there.
    - `deviation`: of each sample from that prediction, shape (n,), output units.
    - `limit`: the deviation from which on a sample is bad, output units; of the four at
        either end more.
    """

    mask: Bool[Array, " n"]
    repaired: Recording
    deviation: Float[Array, " n"]
    limit: Float[Array, ""]

    def _card(self) -> Card | None:
        record = self.repaired._card()
        if record is None or not is_concrete(self.mask):
            return None
        rows = np.flatnonzero(self.mask)
        least = quantity(float(self.limit), self.repaired.units[1])
        listed = ", ".join(map(str, rows[:_LISTED]))
        more = ", ..." if len(rows) > _LISTED else ""
        count = f"{len(rows)} of {len(self.mask)}"
        title = f"{count} outputs are bad: off by {least} or more"
        facts = (("rows", f"{listed}{more}"),) if len(rows) else ()
        return Card(title, facts, curves=record.curves, axes=record.axes)


@jit
def outliers(
    recording: Recording, *, threshold: ArrayLike = 10.0, floor: ArrayLike = 0.01
) -> Outliers:
    """Find outputs that their neighbours contradict.

    Each sample is predicted by the parabola that most of its eight neighbours agree on:
    of all that pass through three of them, the one with the least median distance from
    the eight. That is done for the neighbours around it, before it and after it, and
    the closest prediction counts: a corner at a turning point is smooth from one side.
    Of the first and the last four samples there is one such prediction, by a parabola
    that may go far to reach them: they may be off by as many more as it adds to noise.
    Nine samples must be so close together that the output is almost a parabola there;
    where bad samples crowd all three windows, a good one may be taken for bad too.

    **Arguments:**

    - `recording`: with gross errors in a few of its outputs.
    - `threshold`: least deviation of an outlier, as a multiple of the typical one: 1.48
        times their median.
    - `floor`: least deviation of an outlier, as a share of the output's own spread (so
        measured as well, of samples that are not at its median), which matters for
        records without noise.

    **Returns:** `Outliers`.

    **Raises:** `InputError` for what is no recording, when there are fewer than nine
    samples, or `threshold` or `floor` is negative or more than one number.

    Of a column that a converter has rounded, most samples are just what their
    neighbours tell and the others off by a step or more, so that no sample is bad that
    is off by less than four steps.

    **Source:** Rousseeuw (1984), least median of squares, doi
    10.1080/01621459.1984.10477105.
    """
    recording = as_recording(recording, "outliers(recording)")
    for name, value in (("threshold", threshold), ("floor", floor)):
        checks.number(name, value)
        checks.positive(name, value, zero=True)
    t, w = recording.t, recording.w
    checks.enough_samples("`outliers`", t.shape[0], _WINDOW)
    predicted, gain = _predictions(t, w)
    deviation = jnp.abs(w - predicted)
    apart = jnp.abs(w - jnp.median(w))
    moved = jnp.where(apart > 0, apart, jnp.nan)  # at rest for most of a record, say
    typical = NORMAL * jnp.median(deviation)
    spread = NORMAL * jnp.nan_to_num(jnp.nanmedian(moved))
    limits = threshold * typical, floor * spread, _ROUNDED_BY * _converter_step(w)
    limit = jnp.max(jnp.stack([jnp.asarray(each, w.dtype) for each in limits]))
    row = jnp.arange(t.shape[0])
    lone = jnp.minimum(row, row[::-1]) < _WINDOW // 2
    mask = deviation > limit * jnp.where(lone, gain, 1.0)
    repaired = eqx.tree_at(
        lambda each: each.w, recording, jnp.where(mask, predicted, w)
    )
    return Outliers(mask, repaired, deviation, limit)


_ROUNDED_BY = 4.0  # steps: noise of half a step is off by 3 in one of 6000 samples
_EQUAL, _NEXT = 0.1, 0.05  # least shares of neighbours that are equal, or a step apart


def _converter_step(w: Float[Array, " n"]) -> Float[Array, ""]:
    """The step of a column that was rounded, 0 where neighbours are hardly ever equal,
    or a step apart: as of levels that are seldom left."""
    apart = jnp.abs(jnp.diff(w))
    step = jnp.min(jnp.where(apart > 0, apart, jnp.inf))
    equal, next_to = jnp.mean(apart == 0), jnp.mean(jnp.abs(apart / step - 1) < 1e-6)
    return jnp.where((equal > _EQUAL) & (next_to > _NEXT), step, 0.0)


def _predictions(t, w):
    """Of every sample, the closest of its windows' predictions, and by how much that
    multiplies noise."""
    n = t.shape[0]

    def closest(row):
        starts = jnp.clip(row - jnp.array(_OFFSETS), 0, n - _WINDOW)
        several = jax.vmap(_prediction, (None, None, None, 0))
        options, gains = several(t, w, row, starts)
        best = jnp.argmin(jnp.abs(options - w[row]))
        return options[best], gains[best]

    return jax.lax.map(closest, jnp.arange(n), batch_size=_AT_A_TIME)


def _prediction(t, w, row, start):
    """Of one sample, from the others of the window that begins at `start`; and by how
    much the parabola multiplies noise on these."""
    others = start + jnp.arange(_WINDOW - 1)
    others = others + (others >= row)
    reach = t[start + _WINDOW - 1] - t[start]
    times, values = (t[others] - t[row]) / reach, w[others]
    at = jnp.append(times, 0.0)
    shares = jax.vmap(lambda triple: _parabola(times[triple], at))(_TRIPLES)
    fits = jnp.sum(values[_TRIPLES][:, :, None] * shares, axis=1)
    misfit = jnp.median(jnp.abs(fits[:, :-1] - values), axis=1)
    best = jnp.argmin(misfit)
    return fits[best, -1], jnp.linalg.norm(shares[best, :, -1])


def _parabola(x, at):
    """What multiplies three points for the values at `at` of the parabola through
    them."""
    a, b, c = x
    first = (at - b) * (at - c) / ((a - b) * (a - c))
    second = (at - a) * (at - c) / ((b - a) * (b - c))
    third = (at - a) * (at - b) / ((c - a) * (c - b))
    return jnp.stack([first, second, third])
