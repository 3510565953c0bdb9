"""What can be read off a recorded loop: first guesses of classical models."""

import itertools
from typing import NamedTuple

import numpy as np

from .._core import checks
from .._core.checks import InputError
from ..recording import Recording

_LEAST = 16  # samples
_TURN = 0.05  # of the input's range, by which it must go back for a turning point
_WIDE = 0.9  # of the widest stretch: those that are this wide are the loop
_POINTS = 41  # of the loop's branches
_REACH = 0.06  # of the input's range: half width of what a point is read off
_NEAR = 0.2  # of a stretch, from its start or before its end
_FLAT = 0.01  # height of a loop over the output's range that is none


class Stretch(NamedTuple):
    """Rows of a record between two turning points of the input, the first row
    included; the input rises or falls by `width` all in all."""

    rows: slice
    width: float


class Loop(NamedTuple):
    """The widest loop of a record, means over all of its cycles.

    **Attributes:**

    - `u`: inputs, evenly spaced from end to end, shape (m,).
    - `rising`, `falling`: outputs there, shape (m,).
    - `start_slope`: of the output over the input after turning points.
    - `end_slope`: before them.
    - `middle_slope`: of the mean of both branches, half way between the ends.
    - `swing`: of the output, from end to end.
    """

    u: np.ndarray
    rising: np.ndarray
    falling: np.ndarray
    start_slope: float
    end_slope: float
    middle_slope: float
    swing: float

    @property
    def height(self) -> float:
        """Distance of the branches in output, where it is largest."""
        return float(np.max(np.abs(self.rising - self.falling)))

    @property
    def coercive(self) -> float:
        """Half the distance of the branches in input, half way up."""
        half = (self.falling[0] + self.rising[-1]) / 2
        crossings = [
            np.interp(half, np.maximum.accumulate(w), self.u)
            for w in (self.rising, self.falling)
        ]
        return abs(crossings[0] - crossings[1]) / 2


def wide_loop(rec: Recording, *, lags: bool) -> Loop:
    """The widest loop of a record, read off by local straight lines through all samples
    of its cycles, so that noise averages out.

    **Arguments:** the record; and whether the output lags behind the input, as a flux
    density does, or runs ahead, as a force does over a position.

    **Raises:** `InputError` where there is no loop, or too few samples, or one that is
    run through the other way.
    """
    u, w = arrays(rec)
    wide, rising, falling = widest(stretches(u))
    points = np.linspace(*_common(u, wide), _POINTS)
    up, down = (_branch(u, w, points, each) for each in (rising, falling))
    gap = np.mean(up[0] - down[0])
    if abs(gap) < _FLAT * np.ptp(w):
        raise InputError(
            "`rec` has no loop: rising and falling, the output is the same; what is "
            "left is a curve."
        )
    if lags != (gap < 0):
        way = "above" if lags else "below"
        raise InputError(
            f"`rec` has a loop whose rising branch lies {way} the falling one, the "
            "other way round than this model has it. Are input and output exchanged, "
            "or is one of them of the opposite sign?"
        )
    half = _POINTS // 2
    return Loop(
        points,
        up[0],
        down[0],
        _slope(u, w, wide, after=True),
        _slope(u, w, wide, after=False),
        float(up[1][half] + down[1][half]) / 2,
        float(up[0][-1] + down[0][-1] - up[0][0] - down[0][0]) / 2,
    )


def arrays(rec: Recording) -> tuple[np.ndarray, np.ndarray]:
    """Input and output of a record that may hold a loop.

    **Raises:** `InputError` under tracing, for a constant column or too few samples.
    """
    checks.concrete("`guess`", rec)
    checks.enough_samples("`guess`", len(rec), _LEAST)
    for name, column in (("u", rec.u), ("w", rec.w)):
        checks.not_constant(name, column, "there is no loop to read off.")
    return np.asarray(rec.u), np.asarray(rec.w)


def stretches(u: np.ndarray) -> list[Stretch]:
    """The record cut at the turning points of its input, but for those of noise."""
    least, turns, way, last = _TURN * np.ptp(u), [0], 0.0, 0
    for row, value in enumerate(u):
        if (value - u[last]) * way >= 0 and value != u[last]:
            way, last = np.sign(value - u[last]) if way == 0 else way, row
        elif abs(value - u[last]) > least:
            turns.append(last)
            way, last = -way, row
    turns.append(len(u) - 1)
    return [
        Stretch(slice(a, b + 1), float(u[b] - u[a]))
        for a, b in itertools.pairwise(turns)
        if b > a
    ]


def widest(every: list[Stretch]) -> tuple[list[Stretch], list[Stretch], list[Stretch]]:
    """The widest stretches, all, those that rise and those that fall.

    **Raises:** `InputError` unless there are both.
    """
    largest = max(abs(each.width) for each in every)
    wide = [each for each in every if abs(each.width) >= _WIDE * largest]
    if len({np.sign(each.width) for each in wide}) < 2:
        # A virgin curve and the way back are a loop, the widest that there is.
        wide = [f(every, key=lambda each: each.width) for f in (max, min)]
    rising = [each for each in wide if each.width > 0]
    falling = [each for each in wide if each.width < 0]
    if not rising or not falling:
        raise InputError(
            "`rec` has no loop: its input runs in one direction only. Use a record "
            "with a cycle in it."
        )
    return wide, rising, falling


def _common(u: np.ndarray, wide: list[Stretch]) -> tuple[float, float]:
    """The inputs that all of these stretches go through."""
    lows = [u[each.rows].min() for each in wide]
    highs = [u[each.rows].max() for each in wide]
    return max(lows), min(highs)


def _branch(u, w, points, stretches):
    """Outputs and slopes at several inputs, by straight lines through the samples
    around each, near ones first."""
    u = np.concatenate([u[each.rows] for each in stretches])
    w = np.concatenate([w[each.rows] for each in stretches])
    distance = (u - points[:, None]) / (_REACH * np.ptp(points))
    # At least three samples take part, however sparse they are.
    third = np.sort(np.abs(distance), axis=1)[:, 2:3]
    distance = distance / np.maximum(1.0, 1.5 * third)
    weight = np.maximum(0.0, 1 - distance**2)
    away = u - points[:, None]
    total, first, second = (np.sum(weight * away**k, axis=1) for k in range(3))
    level, moment = weight @ w, (weight * away) @ w
    determinant = total * second - first**2
    slope = (total * moment - first * level) / determinant
    return (second * level - first * moment) / determinant, slope


def _slope(u, w, wide: list[Stretch], after: bool) -> float:
    """The slope of the output over the input just after, or before, the turning points
    of some stretches, which share it and its change with the distance from there."""
    rows, levels, w_all = [], [], []
    for i, each in enumerate(wide):
        turn = u[each.rows][0 if after else -1]
        distance = (u[each.rows] - turn) / np.abs(each.width)
        near = np.abs(distance) <= _NEAR
        rows.append(np.stack([distance, distance * np.abs(distance)])[:, near])
        levels.append(np.full(near.sum(), i))
        w_all.append(w[each.rows][near] / np.abs(each.width))
    group = np.concatenate(levels)[:, None] == np.arange(len(wide))
    columns = np.column_stack([*np.concatenate(rows, axis=1), group])
    found, *_ = np.linalg.lstsq(columns, np.concatenate(w_all))
    return float(found[0])


def non_negative(columns: np.ndarray, w: np.ndarray) -> tuple[np.ndarray, float]:
    """Least squares without negative coefficients, and the root of what they leave."""
    from scipy.optimize import nnls  # slow to import, and rarely needed

    return nnls(columns, w)
