"""The area under a sampled path, by cubics where it is smooth and with its corners
where it has any."""

from fractions import Fraction

import numpy as np
from jaxtyping import Bool, Float

_EVEN = 0.6  # of a second difference, by which it may change from one to the next
_KINK = 4.0  # times as large as those beside it is a second difference at a corner
_CLEAR = 30.0  # noise levels that it must have
_NODES = (-1, 0, 1, 2)


def work(
    u: Float[np.ndarray, " n"],
    w: Float[np.ndarray, " n"],
    noise: tuple[float, float] = (0.0, 0.0),
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
    pieces = [np.lib.stride_tricks.sliding_window_view(x, 4) for x in (w, u)]
    smooth = np.einsum("ij,ij->i", pieces[0] @ rule, pieces[1])
    area = straight.copy()
    area[1:-1] = np.where(_smooth(u) & _smooth(w), smooth, straight[1:-1])
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
