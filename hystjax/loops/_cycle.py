"""What is read off one cycle: the area under a sampled path, by cubics where it is
smooth and with its corners where it has any; and columns with their noise, what they
are where the input turns, and their lag."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from ..recording._as_measured import glitches, half_window, noise_beside_corners
from ._reversals import averaged

_EVEN = 0.6  # of a second derivative, by which it may change from one to the next
_KINK = 4.0  # times as large as those beside it is a second derivative at a corner
_CLEAR = 30.0  # noise levels that the second difference there must have
_JITTER = 1e-3  # of a step, by which even ones may differ: rounding of times does that


def in_steps(t: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """Times from the first one in mean steps: of even times the numbers of their rows,
    so that what is said of one window holds for all."""
    rows = np.arange(float(len(t)))
    at = rows[-1] * (t - t[0]) / (t[-1] - t[0])
    return rows if np.all(np.abs(np.diff(at) - 1) <= _JITTER) else at


class _Through(NamedTuple):
    """What multiplies m times k samples for the `value` and the `slope` of the
    polynomials through them, at a place each."""

    value: Float[np.ndarray, "m k"]
    slope: Float[np.ndarray, "m k"]


def _through(
    nodes: Float[np.ndarray, "m k"], place: Float[np.ndarray, " m"]
) -> _Through:
    """Lagrange's polynomials, from where their samples are."""
    count = nodes.shape[1]
    value, slope = np.zeros(nodes.shape), np.zeros(nodes.shape)
    for own in range(count):
        others = [other for other in range(count) if other != own]
        size = np.prod(nodes[:, [own]] - nodes[:, others], axis=1)
        away = place[:, None] - nodes[:, others]
        value[:, own] = np.prod(away, axis=1) / size
        parts = [np.prod(np.delete(away, i, axis=1), axis=1) for i in range(count - 1)]
        slope[:, own] = np.sum(parts, axis=0) / size
    return _Through(value, slope)


def work(
    u: Float[np.ndarray, " n"],
    w: Float[np.ndarray, " n"],
    at: Float[np.ndarray, " n"],
    noise: tuple[float, float],
) -> Float[np.ndarray, " m"]:
    """The integral of w du from each sample to the next, shape (n - 1,).

    u and w are cubics through four samples. Near corners, at samples or between them,
    they are straight: a cubic across one would leave the path; a corner between samples
    is where both sides, continued, meet.

    **Arguments:** the columns; the times of their rows, in mean steps; and the standard
    deviation of the noise of each, by which corners are told from it.

    **Source:** corners inside of an interval as in Harten (1989), doi
    10.1016/0021-9991(89)90226-X.
    """
    straight = (w[1:] + w[:-1]) / 2 * np.diff(u)
    if len(u) < 6:
        return straight
    between = _corners(u, at, noise[0]) | _corners(w, at, noise[1])
    # What a cubic adds to the straight line, from values near by: of products of
    # columns far from zero hardly a digit would be left.
    pieces = [np.lib.stride_tricks.sliding_window_view(x, 4) for x in (w, u, at)]
    dw, du, nodes = (each - each[:, 1:2] for each in pieces)
    bulge = _cubic_work(dw, du, nodes) - dw[:, 2] * du[:, 2] / 2
    area = straight.copy()
    # Of samples much closer to each other than to the next, noise makes any cubic.
    box = np.ptp(pieces[0], axis=1) * np.ptp(pieces[1], axis=1)
    known = _smooth(u, at) & _smooth(w, at) & (np.abs(bulge) <= box)
    area[1:-1] += np.where(known, bulge, 0.0)
    rows = np.flatnonzero(between)
    area[rows] = straight[rows] + _corner_area(u, w, at, rows)
    return area


def _cubic_work(dw, du, nodes):
    """The integral of one cubic over the other, from the second to the third of four
    nodes: by three points, which are exact for it."""
    nodes = _alike(nodes)
    step, total = nodes[:, 2], np.zeros(len(dw))
    for point, weight in zip(*np.polynomial.legendre.leggauss(3), strict=True):
        value, slope = _through(nodes, step * (1 + point) / 2)
        parts = np.sum(value * dw, axis=1), np.sum(slope * du, axis=1)
        total += weight * step / 2 * parts[0] * parts[1]
    return total


def _alike(windows: Float[np.ndarray, "m k"]) -> Float[np.ndarray, "_m k"]:
    """One window instead of many that are equal, as where sampling is even."""
    return windows[:1] if np.all(windows == windows[:1]) else windows


def _bends(x: Float[np.ndarray, " n"], at: Float[np.ndarray, " n"]):
    """Second derivatives, by three samples each, shape (n - 2,)."""
    return 2 * np.diff(np.diff(x) / np.diff(at)) / (at[2:] - at[:-2])


def _smooth(x: Float[np.ndarray, " n"], at) -> Bool[np.ndarray, " m"]:
    """Whether four samples lie on a cubic that knows what is between them: its bend
    hardly changes over them. Near corners and under noise it does."""
    bends, step = _bends(x, at), (at[3:] - at[:-3]) / 3
    change = np.abs(np.diff(bends))
    least = np.finfo(float).eps * 16 * np.max(np.abs(x)) / step**2
    bend = np.maximum(np.abs(bends[1:]), np.abs(bends[:-1]))
    return change <= np.maximum(_EVEN * bend, least)


def _corners(x: Float[np.ndarray, " n"], at, noise: float) -> Bool[np.ndarray, " m"]:
    """Intervals that have a corner inside: there the second derivative is large at both
    ends, and small beside them."""
    bend, step = np.abs(_bends(x, at)), np.diff(at)[2:-2]
    least = np.maximum(_CLEAR * noise, 1e-9 * np.ptp(x)) / step**2
    inner, largest = (pick(bend[1:-2], bend[2:-1]) for pick in (np.minimum, np.maximum))
    outer = np.maximum(bend[:-3], bend[3:])
    between = np.zeros(len(x) - 1, bool)
    between[2:-2] = (largest > np.maximum(_KINK * outer, least)) & (inner > outer)
    return between


def _corner_area(u, w, at, rows):
    """What the corner inside of each interval adds to the straight line: both columns
    are continued from both sides, and meet where the one with the sharper bend does."""
    sides = [_sides(x, at, rows) for x in (u, w)]
    sharp = [
        np.abs(s.bend) / (np.ptp(x) or 1.0) for s, x in zip(sides, (u, w), strict=True)
    ]
    share = np.where(sharp[0] > sharp[1], *(each.meeting for each in sides))
    inside = (share > 0) & (share < 1)
    there = np.where(inside, share, 0.0)
    du, dw = ([s.ends[0], s.continued(there), s.ends[1]] for s in sides)
    path = (dw[0] + dw[1]) / 2 * (du[1] - du[0]) + (dw[1] + dw[2]) / 2 * (du[2] - du[1])
    chord = (dw[0] + dw[2]) / 2 * (du[2] - du[0])
    return np.where(inside, path - chord, 0.0)


class _Sides(NamedTuple):
    """A column before and after intervals from row to row: its values at both ends, the
    `step` between them, and parabolas through three samples on either side, by their
    `slopes` at the ends and by what multiplies the samples for these."""

    ends: tuple[Float[np.ndarray, " m"], Float[np.ndarray, " m"]]
    step: Float[np.ndarray, " m"]
    slopes: tuple[Float[np.ndarray, " m"], Float[np.ndarray, " m"]]
    weights: tuple[Float[np.ndarray, "m 3"], Float[np.ndarray, "m 3"]]

    @property
    def bend(self) -> Float[np.ndarray, " m"]:
        """By how much the slope before exceeds the one after."""
        return self.slopes[0] - self.slopes[1]

    @property
    def meeting(self) -> Float[np.ndarray, " m"]:
        """Where both sides meet, from 0 to 1 through the interval."""
        rise = (self.ends[1] - self.ends[0]) / self.step
        with np.errstate(divide="ignore", invalid="ignore"):
            return (rise - self.slopes[1]) / self.bend

    def continued(self, share: Float[np.ndarray, " m"]) -> Float[np.ndarray, " m"]:
        """The value at a share of the interval, of the two sides continued: their mean,
        which is either where they meet."""
        before = self.ends[0] + self.slopes[0] * share * self.step
        after = self.ends[1] - self.slopes[1] * (1 - share) * self.step
        return (before + after) / 2

    def gains(self, share: Float[np.ndarray, " m"]) -> list[Float[np.ndarray, " m"]]:
        """By how much each side, continued so far, multiplies noise."""
        away = (share * self.step, (share - 1) * self.step)
        own = np.array([1.0, 0.0, 0.0])
        return [
            np.linalg.norm(own + far[:, None] * each, axis=1)
            for far, each in zip(away, self.weights, strict=True)
        ]


def _sides(x: Float[np.ndarray, " n"], at, rows: Int[np.ndarray, " m"]) -> _Sides:
    """The sides of intervals from `rows` to the next ones."""
    slopes, weights = [], []
    for end, way in ((rows, -1), (rows + 1, 1)):
        near = end[:, None] + way * np.arange(3)
        weight = _through(at[near], at[end]).slope
        weights.append(weight)
        # Of an end's own value, far from zero, hardly a digit would be left.
        slopes.append(np.sum(weight * (x[near] - x[end][:, None]), axis=1))
    ends = x[rows], x[rows + 1]
    return _Sides(ends, at[rows + 1] - at[rows], tuple(slopes), tuple(weights))


class Column(NamedTuple):
    """A column without glitches; the times of its rows, in mean steps from the first
    one; the column averaged; the standard deviation of its noise; the half window of
    the cubics that noise asks for, 1 where there is hardly any; and whether its rows
    follow a clock."""

    x: Float[np.ndarray, " n"]
    at: Float[np.ndarray, " n"]
    smooth: Float[np.ndarray, " n"]
    noise: float
    half: int
    clocked: bool


class Local(NamedTuple):
    """What local cubics say at m places: `value`; `slope`, a mean step; and by how much
    each of them multiplies the standard deviation of white noise."""

    value: Float[np.ndarray, " m"]
    slope: Float[np.ndarray, " m"]
    gain: Float[np.ndarray, " m"]
    slope_gain: Float[np.ndarray, " m"]


def local(
    column: Column,
    places: Float[np.ndarray, " m"],
    half: int,
    first: Int[np.ndarray, " m"] | int,
    last: Int[np.ndarray, " m"] | int,
    order: int = 3,
) -> Local:
    """Cubics by least squares over `half` samples before and after each place, but
    within the rows `first` to `last`: at the end of a branch all lie on its side. With
    `half` 1 they pass through four samples. NaN where a place is; `order` 2 is for
    parabolas.

    **Source:** Savitzky and Golay (1964), doi 10.1021/ac60214a047; at ends Gorry
    (1990), doi 10.1021/ac00205a007.
    """
    x, at, n = column.x, column.at, len(column.x)
    count = min(2 * half + 2, n)
    known = np.isfinite(places)
    places = np.where(known, places, 0.0)
    start = np.searchsorted(at, places, side="right") - 1 - half
    start = np.clip(start, first, np.maximum(first, np.asarray(last) - count + 1))
    start = np.clip(start, 0, n - count)
    rows = start[:, None] + np.arange(count)
    # Around the middle of each window, and of size one, for the sake of powers.
    low, high = at[start], at[start + count - 1]
    middle, size = (low + high) / 2, (high - low) * count / (count - 1)
    exponents = np.arange(min(order + 1, count))
    inner = _alike((at[rows] - middle[:, None]) / size[:, None])
    inverse = np.linalg.pinv(inner[:, :, None] ** exponents)
    away = ((places - middle) / size)[:, None]
    value = away**exponents
    slope = exponents * away ** np.maximum(exponents - 1, 0) / size[:, None]
    weights = [np.einsum("...j,...jk->...k", each, inverse) for each in (value, slope)]
    found = [np.sum(each * x[rows], axis=1) for each in weights]
    gains = [np.linalg.norm(each, axis=1) for each in weights]
    return Local(*(np.where(known, each, np.nan) for each in (*found, *gains)))


_AGREE = 3.0  # standard errors, within which cubics over all windows are to agree
_NARROWER = 1.4  # times, is one window than the next


def closest(
    column: Column,
    places: Float[np.ndarray, " m"],
    first: Int[np.ndarray, " m"],
    last: Int[np.ndarray, " m"],
) -> Local:
    """Local cubics over as many samples as lie on one, up to the column's own window:
    the widest that is within noise of all narrower ones. Where most of a branch is
    flat, the column's own window reaches over its knees.

    **Source:** intersection of confidence intervals as in Katkovnik (1999), doi
    10.1109/78.782208.
    """
    halves = [column.half]
    while halves[-1] > 2:
        halves.append(max(2, int(halves[-1] / _NARROWER)))
    low, high = np.full((2, len(places)), -np.inf), np.full((2, len(places)), np.inf)
    agree = np.isfinite(places)
    found = np.full((4, len(places)), np.nan)
    for half in reversed(halves):
        there = local(column, places, half, first, last)
        middle = np.stack([there.value, there.slope])
        unsure = _AGREE * column.noise * np.stack([there.gain, there.slope_gain])
        low, high = np.maximum(low, middle - unsure), np.minimum(high, middle + unsure)
        agree &= np.all(low <= high, axis=0) | (half == halves[-1])
        found = np.where(agree, np.stack(there), found)
    return Local(*found)


def crossings(
    column: Column,
    levels: Float[np.ndarray, " m"],
    first: Int[np.ndarray, " m"],
    last: Int[np.ndarray, " m"],
) -> tuple[Float[np.ndarray, " m"], Local]:
    """Where a column passes levels, each between two rows, and the local cubics there;
    NaN where it does not. Of several passages, which noise makes, the middle one
    counts."""
    at, half = column.at, column.half
    places, reach = np.full((2, len(levels)), np.nan)
    for i, (level, a, b) in enumerate(zip(levels, first, last, strict=True)):
        if not np.isfinite(level):
            continue
        piece = column.smooth[a : b + 1] - level
        above = piece > 0
        passed = np.flatnonzero(above[1:] != above[:-1])
        if passed.size:
            row = passed[(len(passed) - 1) // 2]
            share = piece[row] / (piece[row] - piece[row + 1])
            step = at[a + row + 1] - at[a + row]
            places[i], reach[i] = at[a + row] + share * step, half * step
    begun = places
    for _ in range(4):  # Newton's steps, in the window of each place
        found = closest(column, places, first, last)
        with np.errstate(divide="ignore", invalid="ignore"):
            step = (levels - found.value) / found.slope
        # No farther than the window that the cubic was fitted over.
        places = places + np.where(np.isfinite(step), step, 0.0)
        places = np.clip(places, begun - reach, begun + reach)
        places = np.clip(places, at[first], at[last])
    return places, closest(column, places, first, last)


_MOVED = 10.0  # noise levels that a column moves by within the window of a cubic
_BRANCH = 8  # windows that a branch has at least
_CAME_BACK = 6.0  # noise levels beside a tip that tell it from its neighbours
_LEVEL = 4.0  # standard errors of an average, within which it is at a level
_INNER = 16.0  # standard errors, by which an inner loop is seen to leave it
_LEFT = 8.0  # times as far half a length on: 5 at smooth tips, 3 at corners
_LEFT_BY_MORE = 5.5  # likewise where most others are
_FLAT = 5.2  # times as far from a tip, three times as far on: 9 if flat, 3 at corners
_CORNER = 4.0  # standard errors that the slopes beside a corner differ from zero by
_STEEP = 0.5  # share that they are of the slope a window farther, at least
_APART = 3.0  # standard errors by which it lies beside a sample
_ROUNDED = 1e-6  # of the step, by which it does without noise
_LEAP = 10.0  # times as large as the steps beside it is one that a column leaps by
_STEPS = 5.0  # noise levels that the samples beside a corner differ by, at least


class Tips(NamedTuple):
    """Places of turning points, in mean steps from the first row, and the input and the
    output there, with standard errors."""

    places: Float[np.ndarray, "..."]
    place_error: Float[np.ndarray, "..."]
    u: Float[np.ndarray, "..."]
    w: Float[np.ndarray, "..."]
    u_error: Float[np.ndarray, "..."]
    w_error: Float[np.ndarray, "..."]


def column_of(
    x: Float[np.ndarray, " n"],
    t: Float[np.ndarray, " n"],
    rows: Int[np.ndarray, " m"],
    clocked: bool,
) -> Column:
    """A column as its numbers need it, between turning points at `rows`."""
    x = glitches(x)
    sigma = noise_beside_corners(x, t)
    shortest = int(np.min(np.diff(rows))) if len(rows) > 1 else 0
    half = int(np.clip(half_window(x, sigma, _MOVED), 1, max(1, shortest // _BRANCH)))
    smooth = averaged(x, half if half > 1 else 0)
    return Column(x, in_steps(t), smooth, sigma, half, clocked)


def tips_of(u: Column, w: Column, rows: Int[np.ndarray, " m"]) -> Tips:
    """Input and output at turning points.

    Both columns may have a corner there or be smooth, so the output is what the
    branches before and after say, on average. The input is its own extremum, between
    samples where these tell it.
    """
    edges = np.concatenate([[0], rows, [len(u.x) - 1]])
    before, after = edges[:-2], edges[2:]
    rests, held = _rests(u, rows, before, after)
    turns = np.isnan(rests[0])
    window = _tip_window(u, *(each[turns] for each in (rows, before, after)))
    u = u._replace(half=window)
    find = _peaks if u.half == 1 else _noisy_extremum
    *found, start, corner = find(u, rows, before, after)
    places, place_error, value, error = np.where(turns, found, rests)
    corner = corner & turns
    # The row of the extremum may be a few beside it.
    nearest = np.rint(np.interp(places, u.at, np.arange(len(u.at)))).astype(int)
    nearest = np.clip(nearest, before, after)
    last = np.where(corner, start, nearest)
    output, *parts = _both_sides(w, places, place_error, last, corner, before, after)
    output_error = np.linalg.norm(parts, axis=0)
    for i in np.flatnonzero(~turns):
        output[i], output_error[i] = _held(w, places[i], place_error[i], held[i])
    return Tips(places, place_error, value, output, error, output_error)


def _held(column: Column, place, place_error, held: slice) -> tuple[float, float]:
    """A column at a place where the input rests, and its standard error: by the samples
    of the rest alone, for it has corners where the input comes and goes."""
    half = max(1, min(column.half, (held.stop - held.start - 2) // 2))
    there = local(column, np.array([place]), half, held.start, held.stop - 1)
    moved = there.slope[0] * place_error
    return there.value[0], float(np.hypot(column.noise * there.gain[0], moved))


def _with_a_step_more(x: Float[np.ndarray, " n"]) -> Float[np.ndarray, " m"]:
    """Rising numbers, with what another step would lead to on both sides: a record of
    one period of samples ends one step before it comes round."""
    return np.concatenate([2 * x[:1] - x[1:2], x, 2 * x[-1:] - x[-2:-1]])


def zeros_of(u: Column, w: Column, rows, first, last) -> Tips:
    """The same where the input passes zero, beside `rows`: by cubics over samples of
    the branch from `first` to `last`."""
    there = local(u, u.at[rows], u.half, first, last)
    with np.errstate(divide="ignore", invalid="ignore"):
        away, error = there.value / there.slope, u.noise * there.gain / there.slope
    # Where it rests at zero the slope says nothing; the row is the next one to zero.
    edges = _with_a_step_more(u.at)
    places = np.clip(u.at[rows] - np.nan_to_num(away), edges[rows], edges[rows + 2])
    error = np.clip(np.abs(np.nan_to_num(error)), 0.0, edges[rows + 2] - edges[rows])
    output = closest(w, places, first, last)
    output_error = np.hypot(w.noise * output.gain, output.slope * error)
    zero = np.zeros(len(rows))
    return Tips(places, error, zero, output.value, zero, output_error)


def _rests(u: Column, rows, before, after):
    """Places of rests at turning points, where the input is held before it comes back,
    and its level there, with standard errors, shape (4, m), NaN where it does not rest;
    and the rows of each.

    A rest is a stretch at one level, for all that noise tells, that the input leaves
    faster than a smooth extremum. The largest of its samples is above its level.
    """
    found, left = np.full((4, len(rows)), np.nan), np.zeros(len(rows))
    held = [slice(row, row + 1) for row in rows.tolist()]
    sigma = u.noise / np.sqrt(2 * u.half + 1 if u.half > 1 else 1)
    upper = u.smooth[rows] > (u.smooth[before] + u.smooth[after]) / 2
    for i, (row, first, last) in enumerate(zip(rows, before, after, strict=True)):
        # Down from the turning point, on both sides.
        down = (u.smooth[row] - u.smooth[first : last + 1]) * (1 if upper[i] else -1)
        # Not beyond an inner loop that was left out of the turning points.
        inner = np.flatnonzero(down > max(_INNER * sigma, _ROUNDED * np.ptp(down)))
        edges = np.array([-1, *inner, len(down)])
        beyond = np.searchsorted(edges, row - first)
        low, high = edges[beyond - 1] + 1, edges[beyond]
        level, start, stop = 0.0, row - first, row - first
        for _ in range(3):
            near = np.flatnonzero(down[low:high] <= level + _LEVEL * sigma)
            start, stop = low + near[[0, -1]]
            level = np.median(down[start : stop + 1])
        length = stop + 1 - start
        # As much as half a length on, and on an end of the record nothing.
        steps = np.minimum([start, len(down) - 1 - stop], length // 2)
        beside = down[[start - steps[0], stop + steps[1]]] - level
        if length < 3 or not steps.any():
            continue
        leaving = np.min(beside[steps > 0])
        left[i] = leaving / (_LEVEL * sigma) if sigma else np.inf
        # Ends may be where a smooth input comes to rest, within what noise hides.
        ends = length // 6
        held[i] = slice(int(first + start + ends), int(first + stop + 1 - ends))
        levels = u.x[held[i]]
        near = np.minimum(steps, max(u.half // 4, 1))
        uncertain = _unsure_of_middle(down, np.array([start, stop]), near, sigma)
        error = u.noise / np.sqrt(len(levels))
        middle = (u.at[first + start] + u.at[first + stop]) / 2
        found[:, i] = middle, uncertain, np.mean(levels), error
    # Where most of a kind are rests, noise hides it at others.
    least = np.full(len(rows), _LEFT)
    for kind in (upper, ~upper):
        if kind.any() and np.median(left[kind]) >= _LEFT:
            least[kind] = _LEFT_BY_MORE
    found[:, left < least] = np.nan
    return found, held


def _unsure_of_middle(down, ends, near, sigma: float) -> float:
    """The standard error of the middle of a rest: each of its ends moves with noise,
    along the slope `near` samples beside it, which averaging has made less than that
    beyond, and by less than a sample."""
    away = np.array([-1, 1]) * near
    outer, inner = (ends + away).astype(int), (ends - away).astype(int)
    rise = np.maximum(down[outer] - down[inner], 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        moved = np.minimum(np.nan_to_num(2 * near * sigma / rise), len(down))
    return float(np.linalg.norm(np.hypot(moved, (near > 0) / np.sqrt(12))) / 2)


def _tip_window(u: Column, rows, before, after) -> int:
    """The half window of the cubics at turning points. Tips of a smooth input are flat,
    and it takes longer than on its branches to move by more than noise there."""
    if not len(rows):
        return u.half

    def fallen(by: int) -> float:
        beside = [np.maximum(rows - by, before), np.minimum(rows + by, after)]
        return float(np.median(np.abs(u.x[np.stack(beside)] - u.x[rows])))

    shortest = int(np.min(np.diff(rows))) if len(rows) > 1 else 0
    half, most = u.half, shortest // _BRANCH
    while half < most and fallen(half) < _CAME_BACK * u.noise:
        half = min(half + 1 + half // 8, most)
    return half if fallen(3 * half) > _FLAT * fallen(half) else u.half


def _both_sides(column: Column, places, place_error, last, corner, before, after):
    """A column at turning points: the mean of both branches, of which one is up to the
    rows `last`, at ends of the record one of them; and parts of its standard error, of
    noise, of the place, and of a leap, where it may be anywhere between both sides."""
    # Cubics through four samples share the one at the turning point, but for a corner
    # between samples; wider ones need not.
    shared = ~corner & (column.half == 1)
    leaps, *ends = _leap(column, place_error, last, before, after)
    shared &= ~leaps
    last, first = np.where(leaps, ends, (last, np.where(shared, last, last + 1)))
    sides = [
        closest(column, places, before, last),
        closest(column, places, first, after),
    ]
    leap = np.where(leaps, np.abs(sides[1].value - sides[0].value) / 2, 0.0)
    there = np.stack([last > before, after > last]).astype(float)
    share = there / np.maximum(there.sum(axis=0), 1.0)
    values, slopes = (
        share * np.stack([getattr(side, name) for side in sides])
        for name in ("value", "slope")
    )
    gains = share * np.stack([side.gain for side in sides])
    gain = np.where(shared, gains.sum(axis=0), np.hypot(*gains))
    # What is shared is on one side: the other one is off by how its slope differs.
    turn = np.where(shared & there.all(axis=0), slopes[1] - slopes[0], 0.0)
    moved = [slope * place_error for slope in (slopes.sum(axis=0), turn)]
    return values.sum(axis=0), column.noise * gain, *moved, leap


def _leap(column: Column, place_error, last, before, after):
    """Whether a column leaps at turning points near the rows `last`, as dry friction
    does, and the rows before and after that: a cubic over a leap follows neither
    side."""
    steps = np.abs(np.diff(column.x))
    found = np.zeros((3, len(last)), int)
    reach = 1 + np.ceil(_APART * place_error).astype(int)
    for i, (row, by) in enumerate(zip(last, reach, strict=True)):
        low, high = row - by, row + by
        # As many rows as a parabola needs are beside it.
        if low - 2 < before[i] or high + 2 > after[i]:
            continue
        beside = max(steps[low - 1], steps[high])
        least = max(_LEAP * beside, _CLEAR * column.noise)
        large = low + np.flatnonzero(steps[low:high] > least)
        if large.size:
            found[:, i] = True, large[0], large[-1] + 1
    return found[0].astype(bool), found[1], found[2]


def _noisy_extremum(u: Column, rows, before, after):
    """Place and value of the input's extremum, with standard errors: at a corner where
    both branches meet, else where a cubic over both has no slope. None is between two
    samples for certain."""
    at, wide = u.at[rows], 2 * u.half  # slopes need wider windows
    # Noise may have moved the turning point: what is next to it may be beyond.
    gap = u.half // 2
    left = local(u, at, wide, before, np.maximum(rows - gap, before), order=2)
    right = local(u, at, wide, np.minimum(rows + gap, after), after, order=2)
    inner = (rows > before) & (after > rows)
    sharp = inner & (left.slope * right.slope < 0)
    for side, way, first, last in ((left, -1, before, rows), (right, 1, rows, after)):
        slope = np.abs(side.slope)
        far = local(u, at + way * wide, wide, first, last, order=2).slope
        sharp &= slope > _CORNER * u.noise * side.slope_gain
        sharp &= slope > _STEEP * np.abs(far)
    sharp &= _met(u, rows, left, right)
    middle = local(u, at, wide, before, after)
    beside = [local(u, at + s * u.half, wide, before, after).slope for s in (-1, 1)]
    bend = (beside[1] - beside[0]) / (2 * u.half)
    turn = left.slope - right.slope
    with np.errstate(divide="ignore", invalid="ignore"):
        meeting = (right.value - left.value) / turn
        meeting_error = np.hypot(left.gain, right.gain) / np.abs(turn)
        # The value there moves with the place, on either line.
        crossed = np.hypot(left.gain * right.slope, right.gain * left.slope)
        crossed /= np.abs(turn)
        vertex = -middle.slope / bend
        vertex_error = middle.slope_gain / np.abs(bend)
    offset = np.where(sharp, meeting, np.where(inner, vertex, 0.0))
    offset = np.clip(np.nan_to_num(offset), -u.half, u.half)
    # By fewer samples than the place: over as many a cubic cuts a smooth tip off.
    top = local(u, at + np.where(sharp, 0.0, offset), u.half, before, after)
    value = np.where(sharp, left.value + left.slope * offset, top.value)
    gain = np.where(sharp, crossed, top.gain)
    place_error = np.where(sharp, meeting_error, np.where(inner, vertex_error, 0.0))
    place_error = np.clip(np.nan_to_num(place_error * u.noise), 0, u.half)
    none = np.zeros(len(rows), bool)
    return at + offset, place_error, value, u.noise * gain, rows, none


def _met(u: Column, rows, left: Local, right: Local):
    """Whether the samples at corners are where both branches lead them, and not cut off
    by a short rest."""
    near = rows[:, None] + np.arange(-u.half, u.half + 1)
    near = np.clip(near, 0, len(u.x) - 1)
    away = u.at[near] - u.at[rows][:, None]
    lines = [side.value[:, None] + side.slope[:, None] * away for side in (left, right)]
    upper = left.slope > right.slope
    corner = np.where(upper[:, None], np.minimum(*lines), np.maximum(*lines))
    missing = np.abs(np.mean(corner - u.x[near], axis=1))
    gain = np.sqrt(1 / near.shape[1] + (left.gain**2 + right.gain**2) / 4)
    return missing < _CORNER * u.noise * gain


def extremum(column: Column, rows: Int[np.ndarray, " m"]) -> Float[np.ndarray, " m"]:
    """The value of extrema near rows: between samples where there is no noise."""
    if column.half > 1:
        return column.smooth[rows]
    return _quartic(column, rows, _vertex(column, rows)[0])


def _peaks(column: Column, rows: Int[np.ndarray, " m"], before, after):
    """Places and values of extrema near samples, where there is hardly any noise, with
    standard errors: smooth, or where both sides of a corner meet; the sample before
    each corner, and which of these are between samples for certain."""
    x, at, noise, n = column.x, column.at, column.noise, len(column.x)
    offset, gain = _vertex(column, rows)
    smooth = at[rows] + offset, noise * gain, _quartic(column, rows, offset), noise
    # Without a clock rows are where someone has read the path, its corners too.
    if n < 8 or not column.clocked:
        return *np.broadcast_arrays(*smooth), rows, np.zeros(len(rows), bool)
    # It lies on that side of the sample on which the slope changes more.
    bends = np.abs(np.pad(np.diff(np.diff(x) / np.diff(at)), 2))
    start = np.clip(np.where(bends[rows] > bends[rows + 2], rows - 1, rows), 3, n - 5)
    corner = (before <= start - 2) & (start + 3 <= after)
    sides = _sides(x, at, start)
    corner &= sides.slopes[0] * sides.slopes[1] < 0
    # Nearly as steep as a little farther, and not by noise. The slope of a smooth
    # extremum grows as that of a sine with the way from there, the whole interval at
    # most: of many even samples it is half as large beside it as over the next two.
    branch = np.maximum(at[rows] - at[before], at[after] - at[rows])

    def growth(way):
        return np.sin(np.pi * way / branch)

    for end, way in ((start, -1), (start + 1, 1)):
        a, b, c = end, end + way, end + 3 * way
        near, far = (
            np.abs((x[p] - x[q]) / (at[p] - at[q])) for p, q in ((a, b), (b, c))
        )
        away = [np.abs((at[p] + at[q]) / 2 - at[a]) for p, q in ((a, b), (b, c))]
        near, far = (
            near * growth(sides.step + away[1]),
            far * growth(sides.step + away[0]),
        )
        corner &= near > far
        corner &= np.abs(x[a] - x[b]) > _STEPS * noise
    share = np.where(corner, sides.meeting, 0.5)
    # What each side, continued, multiplies noise by; as in `_noisy_extremum`.
    gains = sides.gains(share)
    bend = np.where(corner, np.abs(sides.bend), 1.0)
    error = noise * np.hypot(*gains) / bend
    slopes = sides.slopes
    crossed = noise * np.hypot(gains[0] * slopes[1], gains[1] * slopes[0]) / bend
    meeting = at[start] + share * sides.step, error, sides.continued(share), crossed
    pairs = zip(meeting, smooth, strict=True)
    # Of a corner at a sample, for all that noise tells, that is on both sides.
    sure = np.maximum(_APART * error / sides.step, _ROUNDED)
    beside = np.abs(share - 0.5) < 0.5 - sure
    return *(np.where(corner, *pair) for pair in pairs), start, corner & beside


def _vertex(column: Column, rows):
    """How far beside its sample a smooth extremum lies, and by how much that multiplies
    the standard deviation of noise; 0 at corners and ends."""
    x, at = column.x, column.at
    if len(x) < 5:
        return np.zeros(len(rows)), np.zeros(len(rows))
    inner = np.clip(rows, 2, len(x) - 3)
    near = inner[:, None] + np.arange(-1, 2)
    weight = _through(at[near], at[inner]).slope
    slope = np.sum(weight * (x[near] - x[inner][:, None]), axis=1)
    bends = np.pad(_bends(x, at), 1)
    bend = bends[inner]
    smooth = np.minimum(*np.abs([bends[inner + s] for s in (-1, 1)])) > 0.3 * np.abs(
        bend
    )
    with np.errstate(divide="ignore", invalid="ignore"):
        offset = -slope / bend
        # Of the slope between both neighbours; the bend hardly matters.
        gain = np.linalg.norm(weight, axis=1) / np.abs(bend)
    low, high = (at[inner + s] - at[inner] for s in (-1, 1))
    there = smooth & (inner == rows) & (low <= offset) & (offset <= high)
    return np.where(there, offset, 0.0), np.where(there, gain, 0.0)


def _quartic(column: Column, rows, offset) -> Float[np.ndarray, " m"]:
    """Values beside samples, by the quartic through five; of the samples themselves
    where the offset is 0."""
    x, at = column.x, column.at
    if len(x) < 5:
        return x[rows]
    inner = np.clip(rows, 2, len(x) - 3)
    near = inner[:, None] + np.arange(-2, 3)
    value = _through(at[near], at[inner] + offset).value
    return np.where(offset == 0, x[rows], np.sum(value * x[near], axis=1))


def timing(
    t: Float[np.ndarray, " n"],
    u: Column,
    w: Column,
    ends: Tips,
) -> tuple[Float[np.ndarray, " c"], Float[np.ndarray, " c"], Float[np.ndarray, " c"]]:
    """Period of each cycle, s; the angle by which the fundamental wave of the output is
    behind that of the input, rad, from -π to π; and its standard error.

    Waves are fitted by least squares over the samples of a cycle, with a constant.
    """
    wider = _with_a_step_more(u.at)
    edges = (wider[1:] + wider[:-1]) / 2

    def time_of(places):
        return np.interp(places, wider, _with_a_step_more(t))

    def behind(since, until):
        """What gives the fundamental waves of a cycle between two places, these waves,
        and the angle."""
        first = np.searchsorted(edges, since, "right") - 1
        part = slice(max(first, 0), np.searchsorted(edges, until))
        # A row counts as much as of its surroundings is inside, half where the cycle
        # begins at it: which rows are does not leap with noise in where that is.
        low, high = edges[:-1][part], edges[1:][part]
        inside = np.minimum(high, until) - np.maximum(low, since)
        share = inside / (high - low)
        inverse = _waves(t[part], share, *time_of([since, until]))
        # From the first sample, so that a constant column has no wave at all.
        waves = [
            complex(*(inverse @ (column.x[part] - column.x[part][0])))
            for column in (u, w)
        ]
        known = 1.0 if all(waves) else np.nan
        return inverse, waves, known * np.angle(waves[0] * np.conj(waves[1]))

    lags, errors = [], []
    cycles = zip(ends.places, ends.place_error, strict=True)
    for (since, until), (early, late) in cycles:
        inverse, waves, lag = behind(since, until)
        # A phase moves by what is across its wave.
        moved = [
            column.noise * np.linalg.norm([-wave.imag, wave.real] @ inverse)
            for column, wave in zip((u, w), waves, strict=True)
        ]
        with np.errstate(divide="ignore", invalid="ignore"):
            moved = [m / abs(wave) ** 2 for m, wave in zip(moved, waves, strict=True)]
        # And where noise hides when the cycle begins and ends, with its period.
        if early or late:
            moved += [
                behind(since + early, until)[2] - lag,
                behind(since, until + late)[2] - lag,
            ]
        lags.append(lag)
        errors.append(np.linalg.norm(moved))
    begun, ended = time_of(ends.places.T)
    return ended - begun, np.array(lags), np.array(errors)


def _waves(t: Float[np.ndarray, " k"], share, since: float, until: float):
    """What gives real and imaginary part of the fundamental wave of samples, of each of
    which a share counts."""
    phase = 2 * np.pi * (t - since) / (until - since)
    columns = [np.cos(phase), -np.sin(phase), np.ones_like(phase)]
    root = np.sqrt(share)
    return np.linalg.pinv(root[:, None] * np.stack(columns, axis=1))[:2] * root
