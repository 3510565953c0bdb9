"""First guesses of the numbers of classical models: read off the loop of a record; or,
of what no loop tells, those of many models whose free run is nearest to it."""

import itertools
from collections.abc import Callable, Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._core import checks
from .._core.checks import InputError
from .._core.compiling import jit
from ..recording import Recording, as_recording
from ..signals import Signals
from ._base import AbstractModel

_LEAST = 16  # samples
_TURN = 0.05  # of the input's range, by which it must go back for a turning point
_WIDE = 0.9  # of the widest stretch: those that are this wide are the loop
_POINTS = 41  # of the loop's branches
_REACH = 0.06  # of the input's range: half width of what a point is read off
_APART = 0.25  # of that: samples that are this near to each other count as one
_NEAR = 0.2  # of a stretch, from its start or before its end
_SHARED = 0.5  # of the widest stretch: less in common, and wide ones are no one loop
_FLAT = 0.01  # height of a loop over the output's range that is none
_MEET = 0.25  # of a loop's height, by which its ends may be apart and it closes
_OFF = 0.25  # of half a loop's width: its middle farther from 0 is none


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
    def off_centre(self) -> bool:
        """Whether it lies to one side of 0, so that it is no loop of a device that is
        symmetric about 0, only moved."""
        return abs(float(self.u[0] + self.u[-1])) > _OFF * float(np.ptp(self.u))

    @property
    def coercive(self) -> float:
        """Half the distance of the branches in input, half way up."""
        half = (self.falling[0] + self.rising[-1]) / 2
        crossings = [
            np.interp(half, np.maximum.accumulate(w), self.u)
            for w in (self.rising, self.falling)
        ]
        return abs(crossings[0] - crossings[1]) / 2


def wide_loop(recording: Recording, *, lags: bool) -> Loop:
    """The widest loop of a record, read off by local straight lines through all samples
    of its cycles, so that noise averages out. One period that begins between its tips
    is a whole loop too.

    **Arguments:** the record; and whether the output lags behind the input, as a flux
    density does, or runs ahead, as a force does over a position.

    **Raises:** `InputError` where there is no loop, or too few samples, or one that is
    run through the other way, or whose input leaps.
    """
    u, w = _from_a_tip(*arrays(recording))
    wide, rising, falling = widest(u, stretches(u))
    points = np.linspace(*_common(u, wide), _POINTS)
    up, down = (_branch(u, w, points, each) for each in (rising, falling))
    gap = np.mean(up[0] - down[0])
    if abs(gap) < _FLAT * np.ptp(w):
        raise InputError(
            "`recording` has no loop: rising and falling, the output is the same; what "
            "is left is a curve."
        )
    if lags != (gap < 0):
        way = "above" if lags else "below"
        raise InputError(
            f"`recording` has a loop whose rising branch lies {way} the falling one, "
            "the other way round than this model has it. Are input and output "
            "exchanged, or is one of them of the opposite sign?"
        )
    half = _POINTS // 2
    swing = float(up[0][-1] + down[0][-1] - up[0][0] - down[0][0]) / 2
    if lags and swing <= 0:
        raise InputError(
            "`recording` has a loop that does not rise from tip to tip, as those of "
            "this model do. Is one of its columns of the opposite sign?"
        )
    return Loop(
        points,
        up[0],
        down[0],
        _slope(u, w, wide, after=True),
        _slope(u, w, wide, after=False),
        float(up[1][half] + down[1][half]) / 2,
        swing,
    )


def arrays(
    recording: Recording, what: str = "guess", least: int = _LEAST
) -> tuple[np.ndarray, np.ndarray]:
    """Input and output of a record that may hold a loop, for `what` reads it off.

    **Raises:** `InputError` under tracing, for a constant column or too few samples.
    """
    as_recording(recording, f"{what}(recording)")
    checks.concrete(f"`{what}`", recording)
    checks.enough_samples(f"`{what}`", len(recording), least)
    for name, column in (("u", recording.u), ("w", recording.w)):
        checks.not_constant(name, column, "there is no loop to read off.")
    checks.warn_rounded_input(recording.u)
    return np.asarray(recording.u), np.asarray(recording.w)


def _from_a_tip(u: np.ndarray, w: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """One period that begins between its tips, from its first tip on: as recorded, one
    of its branches is in two parts. All else, such as a virgin curve and the way back
    and forth, which does not end where it began, is as it was."""
    parts = stretches(u)
    if len(parts) != 3:
        return u, w
    first, middle, last = parts
    if abs(first.width + last.width) < _WIDE * abs(middle.width):
        return u, w
    beyond = np.flatnonzero((u[last.rows] - u[0]) * last.width >= 0)
    stop = last.rows.start + beyond[0] if beyond.size else len(u)
    order = np.argsort(u[middle.rows])
    across = np.interp(u[0], u[middle.rows][order], w[middle.rows][order])
    ends = w[[0, stop - 1]]
    if abs(ends[1] - ends[0]) > _MEET * abs(across - ends.mean()):
        return u, w
    turn = middle.rows.start
    halves = slice(turn, stop), slice(0, turn + 1)
    u, w = (np.concatenate([x[half] for half in halves]) for x in (u, w))
    return u, w


def stretches(u: np.ndarray) -> list[Stretch]:
    """The record cut at the turning points of its input, but for those of noise."""
    least, turns, way, last = _TURN * np.ptp(u), [0], 0.0, 0
    for row, value in enumerate(u):
        if (value - u[last]) * way >= 0 and value != u[last]:
            way, last = np.sign(value - u[last]) if way == 0 else way, row
        elif abs(value - u[last]) > least:
            turns.append(last)
            way, last = -way, row
    if len(turns) > 1 and abs(u[turns[1]] - u[0]) <= least:
        del turns[1]  # the way that noise took first
    turns.append(len(u) - 1)
    return [
        Stretch(slice(a, b + 1), float(u[b] - u[a]))
        for a, b in itertools.pairwise(turns)
        if b > a
    ]


def widest(
    u: np.ndarray, every: list[Stretch]
) -> tuple[list[Stretch], list[Stretch], list[Stretch]]:
    """The widest stretches, all, those that rise and those that fall.

    **Raises:** `InputError` unless there are both.
    """
    largest = max(every, key=lambda each: abs(each.width))
    wide = [each for each in every if abs(each.width) >= _WIDE * abs(largest.width)]
    low, high = _common(u, wide)
    alike = high - low >= _SHARED * abs(largest.width)
    if len({np.sign(each.width) for each in wide}) < 2 or not alike:
        # A virgin curve and the way back are a loop, the widest that there is; and so
        # are, of loops about several inputs, two ways that share a turning point.
        place = next(i for i, each in enumerate(every) if each is largest)
        beside = [*every[max(place - 1, 0) : place], *every[place + 1 : place + 2]]
        wide = [largest, *sorted(beside, key=lambda each: -abs(each.width))[:1]]
    rising = [each for each in wide if each.width > 0]
    falling = [each for each in wide if each.width < 0]
    if not rising or not falling:
        raise InputError(
            "`recording` has no loop: its input runs in one direction only. Use a "
            "record with a cycle in it."
        )
    return wide, rising, falling


def _common(u: np.ndarray, wide: list[Stretch]) -> tuple[float, float]:
    """The inputs that all of these stretches go through, if there are any."""
    lows = [u[each.rows].min() for each in wide]
    highs = [u[each.rows].max() for each in wide]
    return max(lows), min(highs)


def _branch(u, w, points, stretches):
    """Outputs and slopes at several inputs, by straight lines through the samples
    around each, near ones first."""
    u = np.concatenate([u[each.rows] for each in stretches])
    w = np.concatenate([w[each.rows] for each in stretches])
    reach = _REACH * np.ptp(points)
    # At least three samples take part, however sparse they are, and not three that are
    # one: with a whole number of samples a cycle, all cycles have nearly the same.
    _, apart = np.unique(
        np.floor((u - points[0]) / (_APART * reach)), return_index=True
    )
    if len(apart) < 3:
        raise InputError(
            "`recording` has no loop that can be read off: rising or falling, its "
            "input leaps from end to end, with fewer than three different values on "
            "the way. Sample it while it moves, or use a record whose input moves "
            "more slowly."
        )
    third = np.sort(np.abs(u[apart] - points[:, None]), axis=1)[:, 2:3]
    distance = (u - points[:, None]) / np.maximum(reach, 1.5 * third)
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
    columns, w_all = [], []
    for each in wide:
        turn = u[each.rows][0 if after else -1]
        distance = (u[each.rows] - turn) / np.abs(each.width)
        near = np.abs(distance) <= _NEAR
        x = np.stack([distance, distance * np.abs(distance)])[:, near]
        y = w[each.rows][near] / np.abs(each.width)
        # Where each stretch begins is fitted too: what is left of its mean.
        columns.append(x - x.mean(axis=1, keepdims=True))
        w_all.append(y - y.mean())
    both = np.concatenate(columns, axis=1).T, np.concatenate(w_all)
    found, *_ = np.linalg.lstsq(*both)
    return float(found[0])


def non_negative(columns: np.ndarray, w: np.ndarray) -> tuple[np.ndarray, float]:
    """Least squares without negative coefficients, and the root of what they leave."""
    from scipy.optimize import nnls  # slow to import, and rarely needed

    try:
        return nnls(columns, w)
    except (ValueError, RuntimeError) as error:  # not finite, or no end of its steps
        raise InputError(
            f"`recording` tells no coefficients that are positive: {error}."
        ) from None


# ----------------------------------------------------- of many models the nearest one

_ROWS = 1001  # of a record that are followed: always as many, for one program
_STRETCHES = 9  # in which these are
_FAR = 100.0  # times the output, beyond which a run has run away
_FACTORS = (0.2, 5.0)  # by which outputs are made larger at once

Build = Callable[..., AbstractModel]
Columns = Float[np.ndarray, "k m"]


def course(recording: Recording) -> tuple[np.ndarray, np.ndarray]:
    """Some of a record of a device whose state is its output, which may begin anywhere:
    stretches from the one before the first wide one on."""
    u, w = arrays(recording)
    parts = stretches(u)
    wide, _, _ = widest(u, parts)
    begin = max(min(map(parts.index, wide)) - 1, 0)
    seen = parts[begin : begin + _STRETCHES]
    rows = slice(seen[0].rows.start, seen[-1].rows.stop)
    return thinned(u[rows], w[rows])


def thinned(u: np.ndarray, w: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Input and output at points that are evenly spaced along the way of the input."""
    way = np.append(0.0, np.cumsum(np.abs(np.diff(u))))
    way, moved = np.unique(way, return_index=True)
    points = np.linspace(0, way[-1], _ROWS)
    return np.interp(points, way, u[moved]), np.interp(points, way, w[moved])


def scaled(
    build: Build,
    columns: Columns,
    powers: Sequence[int],
    course: tuple[np.ndarray, np.ndarray],
) -> Columns:
    """Numbers of models, a column each, with outputs as large as the recorded ones by
    least squares: each number times that scale to its power."""
    _, w = course
    outputs = _outputs(build, columns, course)
    factor = np.clip(outputs @ w / np.sum(outputs**2, axis=1), *_FACTORS)
    return columns * factor ** np.array(powers)[:, None]


def nearest(
    build: Build, columns: Columns, course: tuple[np.ndarray, np.ndarray]
) -> Float[np.ndarray, " k"]:
    """The numbers, of several columns, of the model that is nearest."""
    missed = _outputs(build, columns, course) - course[1]
    return columns[:, int(np.argmin(np.sum(missed**2, axis=1)))]


def _outputs(build: Build, columns: Columns, course) -> Float[np.ndarray, "m n"]:
    """Their free runs; that of a model that runs away is far off."""
    models = jax.vmap(build)(*map(jnp.asarray, columns))
    outputs = np.asarray(_runs(models, *map(jnp.asarray, course)))
    far = _FAR * np.max(np.abs(course[1]))
    return np.clip(np.nan_to_num(outputs, nan=far), -far, far)


@jit
def _runs(
    models: AbstractModel, u: Float[Array, " n"], w: Float[Array, " n"]
) -> Float[Array, "m n"]:
    """Free runs of models that are rate independent and have no memory but their state,
    from the first output, by the rule of the midpoint: a step lasts as long as any."""

    def run(model):
        def step(x, ends):
            start, end = ends
            du = end - start

            def on(x, at, share):
                rate = model.rate(x, (), Signals(jnp.zeros_like(du), at, du))
                return jax.tree.map(lambda each, by: each + share * by, first, rate)

            first = x
            x = on(on(x, start, 0.5), start + du / 2, 1.0)
            return x, model.output(x, (), Signals(jnp.zeros_like(du), end, du))

        begun = Signals(jnp.zeros_like(u[0]), u[0], u[1] - u[0])
        x = model.start((), begun, w[0])
        _, outputs = jax.lax.scan(step, x, (u[:-1], u[1:]))
        return jnp.append(model.output(x, (), begun), outputs)

    return jax.vmap(run)(models)
