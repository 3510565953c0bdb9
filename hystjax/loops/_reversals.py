"""Where the input turns, under noise, and the cycles between."""

import itertools
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from .._core import checks
from .._core.checks import InputError, warn
from .._core.compiling import jit
from ..recording import Recording, as_recording
from ..recording._as_measured import glitches, half_window, noise, quantum

_SIGNIFICANT = 3.0  # noise levels from which on a swing of averages counts
_BARE = 6.0  # where nothing is averaged: neighbours differ by three all the time
_SHARE = 0.01  # of the input's range, likewise
_STRONG = 0.1  # of the range, beyond which what noise asks for may be no noise
_OWN = 2.5  # noise levels that nine of ten swings exceed where noise makes none
_SMOOTHED = 2.5  # noise levels that the input moves by within a window
_WHOLE = 1.5  # times the last step, that one more may be
_CLOSED = 0.99  # share of a swing that an end of the record has that is a tip
_HELD = 50  # part of a branch over which an input is held, at least
_SHORTEST = 1 << 15  # samples; shorter columns share a program, run in a millisecond


class Reversals(eqx.Module):
    """Where the input of a recording turns, and by what that was told.

    **Attributes:**

    - `rows`: rows of the turning points, shape (m,), rising; the first and the last row
        are among them where the input comes as far there as at its turning points.
    - `upper`: whether each is a maximum, shape (m,).
    - `threshold`: the least swing between turning points, input units.
    - `noise`: standard deviation of the input's noise, input units.
    - `window`: samples over which the input was averaged to find them, 1 for none.
    - `zeros`: rows where the input is at zero before each turning point and after the
        last one, shape (m + 1,), -1 where it is not; `None` where cycles begin at tips.
    """

    rows: Int[np.ndarray, " m"]
    upper: np.ndarray
    threshold: float
    noise: float
    window: int
    zeros: Int[np.ndarray, " z"] | None = None

    def __len__(self) -> int:
        return len(self.rows)

    def __str__(self) -> str:
        averaged = f", averaged over {self.window} samples" if self.window > 1 else ""
        return (
            f"{len(self)} reversals of more than {self.threshold:.4g} (noise "
            f"{self.noise:.2g}{averaged})"
        )

    @property
    def from_zero(self) -> bool:
        """Whether cycles begin at zero."""
        return self.zeros is not None

    @property
    def cycles(self) -> Int[np.ndarray, "c k"]:
        """The rows at which each cycle begins, turns and ends, shape (c, 3): from
        maximum to maximum or from minimum to minimum, as the first turning point is.
        Of cycles that begin at zero those at which each begins, turns, turns back and
        ends, shape (c, 4)."""
        if self.zeros is None:
            first = 2 * np.arange(max(0, (len(self) - 1) // 2))
            return self.rows[first[:, None] + np.arange(3)]
        # A record that begins at a tip has no zero before it.
        begun = int(np.any(self.zeros[:1] < 0))
        complete = len(self) - int(np.any(self.zeros[-1:] < 0))
        first = begun + 2 * np.arange(max(0, (complete - begun) // 2))
        tips = self.rows[first[:, None] + np.arange(2)]
        ends = self.zeros[first[:, None] + np.array([0, 2])]
        return np.concatenate([ends[:, :1], tips, ends[:, 1:]], axis=1)


def reversals(
    recording: Recording, *, threshold: float | None = None, begin: str = "tip"
) -> Reversals:
    """Find the turning points of the input.

    Glitches are bridged, and the input is averaged over as many samples as it takes to
    move by a few noise levels, so that it turns where the device did. A turning point
    then is an extremum from which the input comes back by more than `threshold` before
    it goes further. Sampling need not be even, and no clock is needed. The time taken
    grows as the number of samples does.

    **Arguments:**

    - `recording`: the record.
    - `threshold`: the least swing that counts, input units; with one, the input is
        not averaged. By default three standard deviations of the noise, which third
        differences tell, or six where the input moves so fast that nothing is averaged,
        or as many as noise spans where the input rests; one and a half steps of a
        rounded input; or 1 % of its range: the largest of these. An input of few
        samples a swing has large third differences without any noise: where nine of
        ten swings are large beside them, half of that is enough.
    - `begin`: where cycles do, `"tip"`, or `"zero"`, where the input passes zero, as in
        the protocols of cyclic tests: from zero to a tip, to the other one and back to
        zero. A record that begins or ends within the threshold of zero, or one step
        of the input, is there.

    **Returns:** `Reversals`, which show the threshold.

    **Raises:** `InputError` for a threshold that is not positive, an input that never
    changes, another `begin`, or `"zero"` where two turning points are on one side of
    zero.
    """
    as_recording(recording, "reversals(recording)")
    if begin not in ("tip", "zero"):
        raise InputError(f'`begin` must be "tip" or "zero", got {begin!r}.')
    checks.concrete("`hystjax.loops.reversals`", recording)
    checks.not_constant("u", recording.u, "it has no reversals.")
    checks.sized(u=recording.u, w=recording.w)
    kept = distinct(recording)
    t, u = (np.asarray(x, np.float64)[kept] for x in (recording.t, recording.u))
    u = glitches(u)
    sigma = noise(u, t if recording.clocked else np.arange(float(len(u))))
    half = 0
    if threshold is None:
        threshold, half = _by_noise(u, sigma)
    elif np.asarray(threshold).dtype.kind not in "iuf" or not (
        np.ndim(threshold) == 0 and 0 < threshold < np.inf
    ):
        raise InputError(f"`threshold` must be a positive number, got {threshold!r}.")
    smooth = averaged(u, half)
    unsure = max(_SIGNIFICANT * sigma / np.sqrt(2 * half + 1), 1.5 * quantum(u))
    rows, upper = turns(smooth, float(threshold), unsure)
    zeros = None
    if begin == "zero":
        zeros = _zeros(smooth, rows, threshold, kept)
    return Reversals(kept[rows], upper, float(threshold), sigma, 2 * half + 1, zeros)


def _zeros(u, rows, threshold, kept) -> Int[np.ndarray, " z"]:
    """Rows at which the input leaves zero for each turning point, and comes back from
    the last one; the ends of the record, where they are there or another step would
    lead there; -1 elsewhere.

    **Raises:** `InputError` where it does not pass zero between two turning points.
    """
    last = len(u) - 1
    tips = rows.tolist()
    if tips and abs(u[0]) > threshold and abs(u[0] - u[tips[0]]) > threshold:
        warn(
            f"the record begins at {u[0]:.4g}, neither at zero nor at a turning point: "
            "cycles are read from the first zero on. If the device was at rest there, "
            "remove the offset (`hystjax.loops.centred`)."
        )
    zeros = []
    for a, b in itertools.pairwise([0, *tips, last]):
        to, end = (b, 0) if len(zeros) < len(tips) else (a, last)
        beyond = np.sign(u[to]) * u[a : b + 1] > 0
        passed = a + np.flatnonzero(beyond[1:] != beyond[:-1])
        if passed.size:
            # Of several passages, which noise makes, the middle one.
            row = passed[(len(passed) - 1) // 2]
            zeros.append(row + int(abs(u[row + 1]) < abs(u[row])))
        elif a in tips and b in tips and a < b:
            raise InputError(
                f'`begin` is "zero", and between its turning points at rows {kept[a]} '
                f"and {kept[b]} the input does not pass zero. Remove an offset "
                "(`hystjax.loops.centred`), take a larger `threshold`, or let cycles "
                '`begin` at a "tip".'
            )
        else:
            # One period of samples ends one step before it comes round.
            step = abs(u[end] - u[end - 1 if end else 1])
            near = abs(u[end]) <= max(threshold, _WHOLE * step)
            zeros.append(end if near else -1)
    return np.append(kept, -1)[zeros]


def _by_noise(u: Float[np.ndarray, " n"], sigma: float) -> tuple[float, int]:
    """The least swing that counts, and over how many samples on both sides the input is
    averaged before."""
    step, reach = quantum(u), float(np.ptp(u))
    if 3 * step > reach:
        # Of two or three levels the step is no rounding but all that there is.
        return reach / 2, 0
    half = min(half_window(u, sigma, _SMOOTHED), (len(u) - 1) // 4)
    # Where an input rests, noise goes as far as the largest and the least of so many
    # samples lie apart.
    resting = 2 * np.sqrt(2 * np.log(len(u)) / (2 * half + 1))
    noisy = max(_SIGNIFICANT if half else _BARE, resting) * sigma
    least = max(1.5 * step, _SHARE * float(np.ptp(averaged(u, half))))
    if noisy > max(least, _STRONG * reach):
        # Most swings that noise makes are as small as it is. Where an input has few
        # samples a swing none is: then third differences are of the input itself.
        swings = np.abs(np.diff(u[turns(u, sigma / 2, sigma)[0]]))
        own = float(np.quantile(swings, 0.1, method="lower")) if swings.size else 0.0
        if own >= _OWN * sigma:
            noisy, half = min(_BARE * sigma, own / 2), 0
    return max(noisy, least), half


def found_in(
    call: str,
    recording: Recording,
    threshold: float | None,
    found: Reversals | None,
    begin: str = "tip",
) -> Reversals:
    """The turning points of a recording, or those that were found in it before, for a
    `call` by this name.

    **Raises:** `InputError` for those of a longer recording, or whose cycles do not
    begin at the zero that is asked for; and for a threshold beside them.
    """
    as_recording(recording, f"{call}(recording)")
    if found is None:
        return reversals(recording, threshold=threshold, begin=begin)
    if not isinstance(found, Reversals):
        raise InputError(
            "`found` must be what `hystjax.loops.reversals(recording)` returns, got "
            f"{checks.described(found)}."
        )
    if threshold is not None:
        raise InputError(
            f"`found` has a threshold of its own, {found.threshold:.4g}: give it or "
            f"`threshold`, and not both; got {threshold!r}."
        )
    if begin == "zero" and not found.from_zero:
        raise InputError(
            "`found` has cycles that begin at a tip, and `begin` asks for "
            '"zero": give it to `reversals(recording, begin="zero")`.'
        )
    if len(found) and found.rows[-1] >= len(recording):
        raise InputError(
            f"`found` are turning points of another recording, up to row "
            f"{found.rows[-1]}, and this one has {len(recording)} rows: look for its "
            "own, by `reversals(recording)` or without `found`."
        )
    return found


def half_cycles(recording: Recording) -> int:
    """Into how many stretches the turning points of the input cut a record, whose noise
    makes none: 1 where it never turns, or never changes."""
    if not np.ptp(recording.u):
        return 1
    rows = reversals(recording).rows
    return 1 + int(np.sum((rows > 0) & (rows < len(recording) - 1)))


def distinct(recording: Recording) -> Int[np.ndarray, " m"]:
    """Rows that say something: without a clock a row that repeats the one before it
    does not, and would make steps uneven that are even."""
    rows = np.arange(len(recording))
    if recording.clocked:
        return rows
    u, w = np.asarray(recording.u), np.asarray(recording.w)
    return rows[np.append(True, (np.diff(u) != 0) | (np.diff(w) != 0))]


def averaged(x: Float[np.ndarray, " n"], half: int) -> Float[np.ndarray, " n"]:
    """Means over `half` samples on both sides; over as many as there are on both at the
    ends, where the mean would lag."""
    if half == 0:
        return x
    row = np.arange(len(x))
    reach = np.minimum(half, np.minimum(row, row[::-1]))
    # Running sums of what is left beside the first sample: a large offset costs digits.
    sums = np.concatenate([[0.0], np.cumsum(x - x[0])])
    return x[0] + (sums[row + reach + 1] - sums[row - reach]) / (2 * reach + 1)


def turns(
    x: Float[np.ndarray, " n"], threshold: float, unsure: float
) -> tuple[Int[np.ndarray, " m"], np.ndarray]:
    """Rows of the turning points of a column whose swings exceed a threshold, with such
    ends as are tips of a loop, for all that values say which are `unsure` by so much;
    and whether each is a maximum."""
    # Rows more than there are repeat the last one, where nothing turns, so that columns
    # of many lengths share few programs.
    size = max(_SHORTEST, 1 << (len(x) - 1).bit_length())
    padded = np.concatenate([x, np.full(size - len(x), x[-1])])
    found = np.asarray(_confirmed(padded, np.asarray(threshold, padded.dtype)))
    rows = found[found >= 0].astype(int)
    if not len(rows):
        return _one_way(x, threshold)
    upper = np.empty(len(rows), bool)
    later = rows[1] if len(rows) > 1 else len(x) - 1
    upper[::2] = x[rows[0]] > x[later]
    upper[1::2] = ~upper[0]
    rows, upper = _with_end(x, rows, upper, threshold, unsure)
    # The start, by the same rule backwards.
    rows, upper = len(x) - 1 - rows[::-1], upper[::-1]
    back, upper = _with_end(x[::-1], rows, upper, threshold, unsure)
    return len(x) - 1 - back[::-1], upper[::-1]


def _with_end(x, rows, upper, threshold, unsure):
    """With the farthest point after the last turn, where it closes a loop: there the
    record ends before it shows that the input turned. One that is still on its way to
    the tip, by more than another step, is none: a hundredth of the swing of a sine is
    three of its period."""
    rest = x[rows[-1] :]
    end = rows[-1] + int(np.argmin(rest) if upper[-1] else np.argmax(rest))
    swing = np.ptp(rest)
    # Of a single turning point both sides are ends: the larger swing is whole.
    last = rows[-2] if len(rows) > 1 else slice(0, rows[0])
    before = np.max(np.abs(x[rows[-1]] - x[last]))
    if swing <= threshold or swing < _CLOSED * before:
        return rows, upper
    length = max(3, len(rest) // _HELD)
    last_rows = rest[: end - rows[-1] + 1][-length:]
    step = np.ptp(last_rows) / max(len(last_rows) - 1, 1)
    held = np.ptp(rest[-length:]) <= unsure
    if before - swing > max(_WHOLE * step, unsure) and not held:
        return rows, upper
    return np.append(rows, end), np.append(upper, not upper[-1])


def _one_way(x, threshold):
    """An input that never turns has its ends."""
    ends = np.sort([int(np.argmin(x)), int(np.argmax(x))])
    if abs(x[ends[1]] - x[ends[0]]) <= threshold:
        return np.empty(0, int), np.empty(0, bool)
    return ends, np.array([x[ends[0]] > x[ends[1]], x[ends[1]] > x[ends[0]]])


@jit
def _confirmed(
    x: Float[Array | np.ndarray, " n"], threshold: Float[Array | np.ndarray, ""]
) -> Int[Array, " n"]:
    """At each sample by which a turning point is certain, its row; elsewhere -1.

    The input is followed as by a play: the farthest point on the way is a turning point
    once it has been left by the threshold. Whether that point is a maximum needs no
    record: they alternate.
    """

    def sample(carry, row):
        high, at_high, low, at_low, way = carry
        value, number = row
        higher, lower = value > high, value < low
        high = jnp.where(higher, value, high)
        at_high = jnp.where(higher, number, at_high)
        low, at_low = jnp.where(lower, value, low), jnp.where(lower, number, at_low)
        down = (way >= 0) & (value < high - threshold)
        up = (way <= 0) & (value > low + threshold)
        # Before the first swing nothing went by the threshold: no turn, but perhaps an
        # end.
        place = jnp.where(down, at_high, jnp.where(up, at_low, -1))
        place = jnp.where(way == 0, -1, place)
        low, at_low = jnp.where(down, value, low), jnp.where(down, number, at_low)
        high, at_high = jnp.where(up, value, high), jnp.where(up, number, at_high)
        way = jnp.where(down, -1, jnp.where(up, 1, way))
        return (high, at_high, low, at_low, way), place

    zero = jnp.zeros((), jnp.int32)
    first = (x[0], zero, x[0], zero, zero)
    return jax.lax.scan(sample, first, (x, jnp.arange(len(x), dtype=jnp.int32)))[1]


def cycles(
    recording: Recording,
    *,
    threshold: float | None = None,
    begin: str = "tip",
    found: Reversals | None = None,
) -> tuple[Recording, ...]:
    """The cycles of a record, a recording each, from one turning point of the input to
    the next but one, both included; or from zero on.

    A cycle knows nothing of what came before it; `recording.window(start, stop)` with
    the rows of `reversals(recording).cycles` does.

    **Arguments:** the record; `threshold` and `begin` as for `reversals`; or what that
    `found`.

    **Returns:** as many recordings as there are cycles; none where the input turns less
    than twice.

    **Raises:** as `reversals` does.
    """
    found = found_in("cycles", recording, threshold, found, begin)
    columns = [np.asarray(each) for each in (recording.t, recording.u, recording.w)]
    fields = {
        "names": recording.names,
        "units": recording.units,
        "interpolation": recording.interpolation.elsewhere(recording.t, recording.u),
        "clocked": recording.clocked,
    }
    return tuple(
        Recording(*(column[start : stop + 1] for column in columns), **fields)
        for start, *_, stop in found.cycles
    )


class Rainflow(NamedTuple):
    """Cycles that a history is counted as, in the order in which they close; halves of
    cycles, which do not, come last.

    **Attributes:** all of shape (k,).

    - `range`: from its minimum to its maximum, input units.
    - `mean`: of the two, input units.
    - `count`: 1, or 0.5 for half a cycle.
    - `start`, `stop`: rows of its two turning points.
    """

    range: Float[np.ndarray, " k"]
    mean: Float[np.ndarray, " k"]
    count: Float[np.ndarray, " k"]
    start: Int[np.ndarray, " k"]
    stop: Int[np.ndarray, " k"]


def rainflow(
    recording: Recording,
    *,
    threshold: float | None = None,
    found: Reversals | None = None,
) -> Rainflow:
    """Count the cycles of a history whose amplitude changes, as materials remember
    them: an inner loop is a cycle as soon as it closes, and what is left over are half
    cycles.

    **Arguments:** as for `cycles`. The first and the last sample count as turning
    points where they are more than the threshold from their neighbours.

    **Returns:** a `Rainflow`.

    **Raises:** `InputError` where no swing exceeds the threshold, and as `reversals`
    does.

    **Source:** ASTM E1049-85 (2017), 5.4.4; Matsuishi and Endo (1968).
    """
    found = found_in("rainflow", recording, threshold, found)
    if not len(found):
        raise InputError(
            f"no swing of the input counts: it has {found}. Give a `threshold` that is "
            "smaller: by the default one a history of turning points alone is noise."
        )
    u = np.asarray(recording.u, np.float64)
    rows = _with_ends(u, found)
    full, half, stack = [], [], []
    for row in rows.tolist():
        stack.append(row)
        while len(stack) >= 3:
            a, b, c = stack[-3:]
            if abs(u[c] - u[b]) < abs(u[b] - u[a]):
                break
            if len(stack) == 3:  # it holds the first point of the history
                half.append((a, b))
                stack.pop(0)
            else:
                full.append((a, b))
                del stack[-3:-1]
    half += itertools.pairwise(stack)
    pairs = np.array([*full, *half], int).reshape(-1, 2)
    count = np.repeat([1.0, 0.5], [len(full), len(half)])
    values = u[pairs]
    spread = np.abs(values[:, 1] - values[:, 0])
    return Rainflow(spread, np.mean(values, axis=1), count, pairs[:, 0], pairs[:, 1])


def _with_ends(u: Float[np.ndarray, " n"], found: Reversals) -> Int[np.ndarray, " m"]:
    rows = found.rows
    before = [0] if abs(u[0] - u[rows[0]]) > found.threshold else []
    after = [len(u) - 1] if abs(u[-1] - u[rows[-1]]) > found.threshold else []
    return np.concatenate([before, rows, after]).astype(int)
