"""What is read off one cycle: the area under a sampled path, by cubics where it is
smooth and with its corners where it has any; and columns with their noise, what they
are where the input turns, and their lag."""

import functools
from fractions import Fraction
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from ..recording._as_measured import glitches, half_window, noise_beside_corners
from ._reversals import averaged

_EVEN = 0.6  # of a second difference, by which it may change from one to the next
_KINK = 4.0  # times as large as those beside it is a second difference at a corner
_CLEAR = 30.0  # noise levels that it must have
_NODES = (-1, 0, 1, 2)


def work(
    u: Float[np.ndarray, " n"],
    w: Float[np.ndarray, " n"],
    noise: tuple[float, float],
) -> Float[np.ndarray, " m"]:
    """The integral of w du from each sample to the next, shape (n - 1,).

    u and w are cubics of the row through four samples. Near corners, at samples or
    between them, they are straight: a cubic across one would leave the path; a corner
    between samples is where both sides, continued, meet.

    **Arguments:** the columns, and the standard deviation of the noise of each, by
    which corners are told from it.

    **Source:** corners inside of an interval as in Harten (1989), doi
    10.1016/0021-9991(89)90226-X.
    """
    straight = (w[1:] + w[:-1]) / 2 * np.diff(u)
    if len(u) < 6:
        return straight
    between = _corners(u, noise[0]) | _corners(w, noise[1])
    rule = _rule()
    # What a cubic adds to the straight line, from values near by: of products of
    # columns far from zero hardly a digit would be left.
    pieces = [np.lib.stride_tricks.sliding_window_view(x, 4) for x in (w, u)]
    dw, du = (each - each[:, 1:2] for each in pieces)
    bulge = np.einsum("ij,ij->i", dw @ rule, du) - dw[:, 2] * du[:, 2] / 2
    area = straight.copy()
    area[1:-1] += np.where(_smooth(u) & _smooth(w), bulge, 0.0)
    rows = np.flatnonzero(between)
    area[rows] = straight[rows] + _corner_area(u, w, rows)
    return area


def _rule() -> Float[np.ndarray, "4 4"]:
    """Weights of w_i u_j in the integral of one cubic over the other, in the middle of
    four samples; exact."""
    basis = []
    for node in _NODES:
        polynomial, scale = [Fraction(1)], Fraction(1)
        for other in _NODES:
            if other != node:
                polynomial = _times(polynomial, [Fraction(-other), Fraction(1)])
                scale *= node - other
        basis.append([each / scale for each in polynomial])
    slopes = [[k * c for k, c in enumerate(each)][1:] for each in basis]
    return np.array(
        [
            [
                float(sum(c / (k + 1) for k, c in enumerate(_times(value, slope))))
                for slope in slopes
            ]
            for value in basis
        ]
    )


def _times(a: list, b: list) -> list:
    out = [Fraction(0)] * (len(a) + len(b) - 1)
    for i, x in enumerate(a):
        for j, y in enumerate(b):
            out[i + j] += x * y
    return out


def _smooth(x: Float[np.ndarray, " n"]) -> Bool[np.ndarray, " m"]:
    """Whether four samples lie on a cubic that knows what is between them: its bend
    hardly changes over them. Near corners, uneven steps and under noise it does."""
    bend = np.abs(np.diff(x, 2))
    change = np.abs(np.diff(x, 3))
    least = np.finfo(float).eps * 16 * np.max(np.abs(x))
    return change <= np.maximum(_EVEN * np.maximum(bend[1:], bend[:-1]), least)


def _corners(x: Float[np.ndarray, " n"], noise: float) -> Bool[np.ndarray, " m"]:
    """Intervals that have a corner inside: there the second difference is large at
    both ends, and small beside them."""
    bend = np.abs(np.diff(x, 2))
    least = np.maximum(_CLEAR * noise, 1e-9 * np.ptp(x))
    inner, largest = (pick(bend[1:-2], bend[2:-1]) for pick in (np.minimum, np.maximum))
    outer = np.maximum(bend[:-3], bend[3:])
    between = np.zeros(len(x) - 1, bool)
    between[2:-2] = (largest > np.maximum(_KINK * outer, least)) & (inner > outer)
    return between


def _corner_area(u, w, rows):
    """What the corner inside of each interval adds to the straight line: both columns
    are continued from both sides, and meet where the one with the sharper bend does."""
    places, sharpness = zip(*(_meeting(x, rows) for x in (u, w)), strict=True)
    place = np.where(sharpness[0] > sharpness[1], *places)
    inside = (place > 0) & (place < 1)
    at = np.where(inside, place, 0.0)
    corner = [_continued(x, rows, at) for x in (u, w)]
    du, dw = ([x[rows], c, x[rows + 1]] for x, c in zip((u, w), corner, strict=True))
    path = (dw[0] + dw[1]) / 2 * (du[1] - du[0]) + (dw[1] + dw[2]) / 2 * (du[2] - du[1])
    chord = (dw[0] + dw[2]) / 2 * (du[2] - du[0])
    return np.where(inside, path - chord, 0.0)


def _sides(x, rows):
    """Slopes, a sample, before and after an interval."""
    before = (3 * x[rows] - 4 * x[rows - 1] + x[rows - 2]) / 2
    after = -(3 * x[rows + 1] - 4 * x[rows + 2] + x[rows + 3]) / 2
    return before, after


def _meeting(x, rows):
    """Where the two sides meet, from 0 to 1 through the interval; and by how much
    their slopes differ, relative."""
    before, after = _sides(x, rows)
    bend = before - after
    with np.errstate(divide="ignore", invalid="ignore"):
        place = (x[rows + 1] - x[rows] - after) / bend
    return place, np.abs(bend) / (np.ptp(x) or 1.0)


def _continued(x, rows, at):
    """The value at a place inside the interval, of the two sides continued: their mean,
    which is either where they meet."""
    before, after = _sides(x, rows)
    return (x[rows] + before * at + x[rows + 1] - after * (1 - at)) / 2


class Local(NamedTuple):
    """What local cubics say at m places: `value`; `slope`, a sample; and by how much
    each of them multiplies the standard deviation of white noise."""

    value: Float[np.ndarray, " m"]
    slope: Float[np.ndarray, " m"]
    gain: Float[np.ndarray, " m"]
    slope_gain: Float[np.ndarray, " m"]


def local(
    x: Float[np.ndarray, " n"],
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
    count = min(2 * half + 2, len(x))
    known = np.isfinite(places)
    at = np.where(known, places, 0.0)
    start = np.floor(at).astype(int) - half
    start = np.clip(start, first, np.maximum(first, np.asarray(last) - count + 1))
    start = np.clip(start, 0, len(x) - count)
    # All windows are alike but for where in them the place lies, so that one inverse
    # serves all.
    exponents = np.arange(min(order + 1, count))
    inverse = _inverse(count, len(exponents))
    coefficients = x[start[:, None] + np.arange(count)] @ inverse.T
    away = ((at - start - (count - 1) / 2) / count)[:, None]
    value = away**exponents
    slope = exponents * away ** np.maximum(exponents - 1, 0) / count
    found = [np.sum(coefficients * each, axis=1) for each in (value, slope)]
    gains = [np.linalg.norm(each @ inverse, axis=1) for each in (value, slope)]
    return Local(*(np.where(known, each, np.nan) for each in (*found, *gains)))


@functools.cache
def _inverse(count: int, powers: int) -> Float[np.ndarray, "powers count"]:
    """Of powers along a window, around its middle and of size one, for their sake."""
    inner = (np.arange(count) - (count - 1) / 2) / count
    return np.linalg.pinv(inner[:, None] ** np.arange(powers))


def crossings(
    x: Float[np.ndarray, " n"],
    smooth: Float[np.ndarray, " n"],
    levels: Float[np.ndarray, " m"],
    first: Int[np.ndarray, " m"],
    last: Int[np.ndarray, " m"],
    half: int,
) -> tuple[Float[np.ndarray, " m"], Local]:
    """Where a column passes levels, each between two rows, and the local cubics there;
    NaN where it does not. Of several passages, which noise makes, the middle one
    counts."""
    places = np.full(len(levels), np.nan)
    for i, (level, a, b) in enumerate(zip(levels, first, last, strict=True)):
        if not np.isfinite(level):
            continue
        piece = smooth[a : b + 1] - level
        above = piece > 0
        passed = np.flatnonzero(above[1:] != above[:-1])
        if passed.size:
            row = passed[(len(passed) - 1) // 2]
            share = piece[row] / (piece[row] - piece[row + 1])
            places[i] = a + row + share
    begun = places
    for _ in range(4):  # Newton's steps, in the window of each place
        found = local(x, places, half, first, last)
        with np.errstate(divide="ignore", invalid="ignore"):
            step = (levels - found.value) / found.slope
        # No farther than the window that the cubic was fitted over.
        places = np.clip(
            places + np.where(np.isfinite(step), step, 0.0), begun - half, begun + half
        )
        places = np.clip(places, first, last)
    return places, local(x, places, half, first, last)


_MOVED = 10.0  # noise levels that a column moves by within the window of a cubic
_BRANCH = 8  # windows that a branch has at least
_CAME_BACK = 6.0  # noise levels beside a tip that tell it from its neighbours
_LEVEL = 4.0  # standard errors of an average, within which it is at a level
_LEFT = 8.0  # times as far half a length on: 5 at smooth tips, 3 at corners
_LEFT_BY_MORE = 5.5  # likewise where most others are
_FLAT = 5.2  # times as far from a tip, three times as far on: 9 if flat, 3 at corners
_CORNER = 4.0  # standard errors that the slopes beside a corner differ from zero by
_STEEP = 0.5  # share that they are of the slope a window farther, at least
_APART = 3.0  # standard errors by which it lies beside a sample
_ROUNDED = 1e-6  # of the step, by which it does without noise
_STEPS = 5.0  # noise levels that the samples beside a corner differ by, at least


class Column(NamedTuple):
    """A column without glitches; averaged; the standard deviation of its noise; the
    half window of the cubics that noise asks for, 1 where there is hardly any; and
    whether its rows follow a clock."""

    x: Float[np.ndarray, " n"]
    smooth: Float[np.ndarray, " n"]
    noise: float
    half: int
    clocked: bool


class Tips(NamedTuple):
    """Places of turning points, in rows, and the input and the output there, with
    standard errors."""

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
    return Column(x, averaged(x, half if half > 1 else 0), sigma, half, clocked)


def tips_of(u: Column, w: Column, rows: Int[np.ndarray, " m"]) -> Tips:
    """Input and output at turning points.

    Both columns may have a corner there or be smooth, so the output is what the
    branches before and after say, on average. The input is its own extremum, between
    samples where these tell it.
    """
    edges = np.concatenate([[0], rows, [len(u.x) - 1]])
    before, after = edges[:-2], edges[2:]
    rests = _rests(u, rows, before, after)
    turns = np.isnan(rests[0])
    window = _tip_window(u, *(each[turns] for each in (rows, before, after)))
    u = u._replace(half=window)
    find = _peaks if u.half == 1 else _noisy_extremum
    *found, start, corner = find(u, rows, before, after)
    places, place_error, value, error = np.where(turns, found, rests)
    corner = corner & turns
    # The row of the extremum may be a few beside it.
    nearest = np.clip(np.rint(places).astype(int), before, after)
    last = np.where(corner, start, nearest)
    output, *parts = _both_sides(w, places, place_error, last, corner, before, after)
    output_error = np.linalg.norm(parts, axis=0)
    return Tips(places, place_error, value, output, error, output_error)


def _rests(u: Column, rows, before, after):
    """Places of rests at turning points, where the input is held before it comes back,
    and its level there, with standard errors, shape (4, m); NaN where it does not rest.

    A rest is a stretch at one level, for all that noise tells, that the input leaves
    faster than a smooth extremum. The largest of its samples is above its level.
    """
    found, left = np.full((4, len(rows)), np.nan), np.zeros(len(rows))
    sigma = u.noise / np.sqrt(2 * u.half + 1 if u.half > 1 else 1)
    if sigma == 0:
        return found
    upper = u.smooth[rows] > (u.smooth[before] + u.smooth[after]) / 2
    for i, (row, first, last) in enumerate(zip(rows, before, after, strict=True)):
        # Down from the turning point, on both sides.
        down = (u.smooth[row] - u.smooth[first : last + 1]) * (1 if upper[i] else -1)
        level, start, stop = 0.0, row - first, row - first
        for _ in range(3):
            start, stop = np.flatnonzero(down <= level + _LEVEL * sigma)[[0, -1]]
            level = np.median(down[start : stop + 1])
        length = stop + 1 - start
        # As much as half a length on, and on an end of the record nothing.
        steps = np.minimum([start, len(down) - 1 - stop], length // 2)
        beside = down[[start - steps[0], stop + steps[1]]] - level
        if length < 3 or not steps.any():
            continue
        left[i] = np.min(beside[steps > 0]) / (_LEVEL * sigma)
        # Ends may be where a smooth input comes to rest, within what noise hides.
        ends = length // 6
        held = u.x[first + start + ends : first + stop + 1 - ends]
        with np.errstate(divide="ignore", invalid="ignore"):
            uncertain = np.linalg.norm(np.nan_to_num(sigma * steps / beside)) / 2
        error = u.noise / np.sqrt(len(held))
        found[:, i] = first + (start + stop) / 2, uncertain, np.mean(held), error
    # Where most of a kind are rests, noise hides it at others.
    least = np.full(len(rows), _LEFT)
    for kind in (upper, ~upper):
        if kind.any() and np.median(left[kind]) >= _LEFT:
            least[kind] = _LEFT_BY_MORE
    found[:, left < least] = np.nan
    return found


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
    noise and of the place."""
    # Cubics through four samples share the one at the turning point, but for a corner
    # between samples; wider ones need not.
    shared = ~corner & (column.half == 1)
    sides = [
        local(column.x, places, column.half, before, last),
        local(column.x, places, column.half, np.where(shared, last, last + 1), after),
    ]
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
    return values.sum(axis=0), column.noise * gain, *moved


def _noisy_extremum(u: Column, rows, before, after):
    """Place and value of the input's extremum, with standard errors: at a corner where
    both branches meet, else where a cubic over both has no slope. None is between two
    samples for certain."""
    at, wide = rows.astype(float), 2 * u.half  # slopes need wider windows
    # Noise may have moved the turning point: what is next to it may be beyond.
    gap = u.half // 2
    left = local(u.x, at, wide, before, np.maximum(rows - gap, before), order=2)
    right = local(u.x, at, wide, np.minimum(rows + gap, after), after, order=2)
    inner = (rows > before) & (after > rows)
    sharp = inner & (left.slope * right.slope < 0)
    for side, way, first, last in ((left, -1, before, rows), (right, 1, rows, after)):
        slope = np.abs(side.slope)
        far = local(u.x, at + way * wide, wide, first, last, order=2).slope
        sharp &= slope > _CORNER * u.noise * side.slope_gain
        sharp &= slope > _STEEP * np.abs(far)
    sharp &= _met(u, rows, left, right)
    middle = local(u.x, at, wide, before, after)
    beside = [local(u.x, at + s * u.half, wide, before, after).slope for s in (-1, 1)]
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
    value = np.where(
        sharp,
        left.value + left.slope * offset,
        middle.value + middle.slope * offset / 2,
    )
    gain = np.where(sharp, crossed, middle.gain)
    place_error = np.where(sharp, meeting_error, np.where(inner, vertex_error, 0.0))
    place_error = np.clip(np.nan_to_num(place_error * u.noise), 0, u.half)
    none = np.zeros(len(rows), bool)
    return rows + offset, place_error, value, u.noise * gain, rows, none


def _met(u: Column, rows, left: Local, right: Local):
    """Whether the samples at corners are where both branches lead them, and not cut off
    by a short rest."""
    away = np.arange(-u.half, u.half + 1)
    lines = [side.value[:, None] + side.slope[:, None] * away for side in (left, right)]
    upper = left.slope > right.slope
    corner = np.where(upper[:, None], np.minimum(*lines), np.maximum(*lines))
    there = u.x[np.clip(rows[:, None] + away, 0, len(u.x) - 1)]
    missing = np.abs(np.mean(corner - there, axis=1))
    gain = np.sqrt(1 / len(away) + (left.gain**2 + right.gain**2) / 4)
    return missing < _CORNER * u.noise * gain


def extremum(column: Column, rows: Int[np.ndarray, " m"]) -> Float[np.ndarray, " m"]:
    """The value of extrema near rows: between samples where there is no noise."""
    if column.half > 1:
        return column.smooth[rows]
    return _quartic(column.x, rows, _vertex(column.x, rows)[0])


def _peaks(column: Column, rows: Int[np.ndarray, " m"], before, after):
    """Places and values of extrema near samples, where there is hardly any noise, with
    standard errors: smooth, or where both sides of a corner meet; the sample before
    each corner, and which of these are between samples for certain."""
    x, noise, n = column.x, column.noise, len(column.x)
    offset, gain = _vertex(x, rows)
    smooth = rows + offset, noise * gain, _quartic(x, rows, offset), noise
    # Without a clock rows are where someone has read the path, its corners too.
    if n < 8 or not column.clocked:
        return *np.broadcast_arrays(*smooth), rows, np.zeros(len(rows), bool)
    # It lies on that side of the sample on which the slope changes more.
    bends = np.abs(np.pad(np.diff(x, 2), 2))
    start = np.clip(np.where(bends[rows] > bends[rows + 2], rows - 1, rows), 3, n - 5)
    corner = (before <= start - 2) & (start + 3 <= after)
    sides = _sides(x, start)
    corner &= sides[0] * sides[1] < 0
    # As steep as a little farther, which no smooth extremum is, and not by noise.
    for end, way in ((start, -1), (start + 1, 1)):
        near = np.abs(x[end] - x[end + way])
        far = np.abs(x[end + way] - x[end + 3 * way]) / 2
        corner &= (near > _STEEP * far) & (near > _STEPS * noise)
    at = np.where(corner, _meeting(x, start)[0], 0.5)
    # What each side, continued, multiplies noise by; as in `_noisy_extremum`.
    gains = [np.sqrt((1 + 1.5 * a) ** 2 + 4.25 * a**2) for a in (at, 1 - at)]
    bend = np.where(corner, np.abs(sides[0] - sides[1]), 1.0)
    error = noise * np.hypot(*gains) / bend
    crossed = noise * np.hypot(gains[0] * sides[1], gains[1] * sides[0]) / bend
    meeting = start + at, error, _continued(x, start, at), crossed
    pairs = zip(meeting, smooth, strict=True)
    # Of a corner at a sample, for all that noise tells, that is on both sides.
    beside = np.abs(at - 0.5) < 0.5 - np.maximum(_APART * error, _ROUNDED)
    return *(np.where(corner, *pair) for pair in pairs), start, corner & beside


def _vertex(x: Float[np.ndarray, " n"], rows):
    """How far beside its sample a smooth extremum lies, and by how much that multiplies
    the standard deviation of noise; 0 at corners and ends."""
    if len(x) < 5:
        return np.zeros(len(rows)), np.zeros(len(rows))
    inner = np.clip(rows, 2, len(x) - 3)
    left, right = x[inner] - x[inner - 1], x[inner + 1] - x[inner]
    bend = right - left
    beside = [x[inner + s] - 2 * x[inner + s // 2] + x[inner] for s in (-2, 2)]
    smooth = np.minimum(*np.abs(beside)) > 0.3 * np.abs(bend)
    with np.errstate(divide="ignore", invalid="ignore"):
        offset = -(left + right) / (2 * bend)
        # Of the slope between both neighbours; the bend hardly matters.
        gain = np.sqrt(0.5) / np.abs(bend)
    there = smooth & (inner == rows) & (np.abs(offset) <= 1)
    return np.where(there, offset, 0.0), np.where(there, gain, 0.0)


def _quartic(x: Float[np.ndarray, " n"], rows, offset) -> Float[np.ndarray, " m"]:
    """Values beside samples, by the quartic through five; of the samples themselves
    where the offset is 0."""
    if len(x) < 5:
        return x[rows]
    inner = np.clip(rows, 2, len(x) - 3)
    nodes = np.arange(-2, 3)
    others = [np.delete(nodes, i) for i in range(len(nodes))]
    weights = [
        np.prod((offset[:, None] - other) / (node - other), axis=1)
        for node, other in zip(nodes, others, strict=True)
    ]
    value = np.sum(np.stack(weights, axis=1) * x[inner[:, None] + nodes], axis=1)
    return np.where(offset == 0, x[rows], value)


def timing(
    t: Float[np.ndarray, " n"],
    u: Column,
    w: Column,
    rows: Int[np.ndarray, "c 3"],
    tips: Tips,
) -> tuple[Float[np.ndarray, " c"], Float[np.ndarray, " c"], Float[np.ndarray, " c"]]:
    """Period of each cycle, s; the angle by which the fundamental wave of the output is
    behind that of the input, rad, from -π to π; and its standard error.

    Waves are fitted by least squares over the samples of a cycle, with a constant.
    """
    index = np.arange(len(t))
    begun, ended = (np.interp(tips.places[:, i], index, t) for i in (0, 2))
    steps = np.gradient(t)[rows]
    lags, errors = [], []
    for i, (start, _, stop) in enumerate(rows):
        part = slice(start, stop)

        def behind(since, until, part=part, start=start):
            inverse = _waves(t[part], since, until)
            # From the first sample, so that a constant column has no wave at all.
            waves = [
                complex(*(inverse @ (column.x[part] - column.x[start])))
                for column in (u, w)
            ]
            known = 1.0 if all(waves) else np.nan
            return inverse, waves, known * np.angle(waves[0] * np.conj(waves[1]))

        inverse, waves, lag = behind(begun[i], ended[i])
        # A phase moves by what is across its wave.
        moved = [
            column.noise * np.linalg.norm([-wave.imag, wave.real] @ inverse)
            for column, wave in zip((u, w), waves, strict=True)
        ]
        with np.errstate(divide="ignore", invalid="ignore"):
            moved = [m / abs(wave) ** 2 for m, wave in zip(moved, waves, strict=True)]
        # And where noise hides when the cycle begins and ends, with its period.
        early, _, late = tips.place_error[i] * steps[i]
        if early or late:
            moved += [
                behind(begun[i] + early, ended[i])[2] - lag,
                behind(begun[i], ended[i] + late)[2] - lag,
            ]
        lags.append(lag)
        errors.append(np.linalg.norm(moved))
    return ended - begun, np.array(lags), np.array(errors)


def _waves(t: Float[np.ndarray, " k"], since: float, until: float):
    """What gives real and imaginary part of the fundamental wave of samples."""
    phase = 2 * np.pi * (t - since) / (until - since)
    columns = [np.cos(phase), -np.sin(phase), np.ones_like(phase)]
    return np.linalg.pinv(np.stack(columns, axis=1))[:2]
