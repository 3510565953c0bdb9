"""What looks wrong with a record before anything is made of it: samples that are
missing, times that were rounded or only count, values that stand for none, and sensors
at their ends."""

import math
from collections.abc import Iterator

import numpy as np
from jaxtyping import Float

from .._core import checks
from .._core.show import quantity
from ._as_measured import as_recording
from ._recording import Recording

_GAP = 10.0  # usual steps, that a step without samples is at least
_COARSE = 20  # roundings a step, up to which one more or less shows
_FEWEST = 50  # samples, of fewer nothing is said
_BEYOND = 10.0  # ranges of nearly all values, that no measured one lies beyond them
_USUAL = 0.02, 0.98  # between these quantiles nearly all values lie
_HELD = 5  # samples in a row, that a sensor at its end repeats at least
_MOVED = 0.02  # of its range, by which an input goes on beyond the end of a sensor
_LISTED = 5  # rows that are named
_EPOCH = 1e11  # s, above which times since 1970 are of smaller units


def doubts(recording: Recording) -> tuple[str, ...]:
    """Sentences on what looks wrong with a record, each with the rows that it is about
    and what to do; none of most records.

    - Samples are missing: a step ten times as long as the others.
    - Times were rounded, so that steps which were equal are not: what is differentiated
        by them is wrong by as much.
    - Times go up by exactly one: perhaps they count samples, and are no seconds; or
        count milliseconds since 1970.
    - Values that stand for none, such as -9999: ten ranges of nearly all others away.
    - The output does not change at all at its largest or least value, though the input
        goes on there: a sensor was at its end.

    **Arguments:** `recording`, a measured one, of n samples. Those of fewer than 50 are
    not looked at.

    **Returns:** the sentences. Their bounds are set so that a clean record seldom has
    any; `outliers` finds gross errors that are not as gross.

    **Raises:** `InputError` for what is no recording, and under tracing.
    """
    as_recording(recording, "doubts(recording)")
    checks.concrete("`doubts`", recording)
    if len(recording) < _FEWEST:
        return ()
    t, u, w = (np.asarray(x, float) for x in (recording.t, recording.u, recording.w))
    every: list[str] = []
    if recording.clocked:
        every += [*_of_times(t)]
    for x, name, unit in zip((u, w), recording.names, recording.units, strict=True):
        every += [*_of_values(x, name, unit, known=x is u)]
    return (*every, *_at_its_end(u, w, recording.names[1], recording.units[1]))


def _of_times(t: Float[np.ndarray, " n"]) -> Iterator[str]:
    steps = np.diff(t)
    usual = float(np.median(steps))
    gaps = np.flatnonzero(steps > _GAP * max(usual, float(np.quantile(steps, 0.95))))
    if gaps.size:
        yield (
            f"samples are missing: there are none for {steps[gaps[0]]:.4g} s after "
            f"{_rows(gaps)}, where the others are {usual:.3g} s apart. Straight lines "
            "stand in their place; take windows without them."
        )
    rest = np.delete(steps, gaps)
    rounding = _rounding(t)
    counts = np.round(rest / rounding) if rounding else np.ones(1)
    if np.ptp(counts) == 1 and counts.max() <= _COARSE:
        yield (
            f"times are rounded to {rounding:.3g} s, which is no small part of a step "
            f"of {usual:.3g} s. If sampling was even, give its period, about "
            f"{np.mean(rest):.5g} s ({1 / np.mean(rest):.4g} Hz), for the times."
        )
    if t[0] > _EPOCH:
        yield (
            f"times begin at {t[0]:.4g} s, thousands of years after 1970: do they "
            "count milliseconds? Read them with `time_unit='ms'`."
        )
    if np.all(steps == 1.0):
        yield (
            "times go up by exactly 1 s: if they number the samples, give the period "
            "of these in their place, or no time at all."
        )


def _rounding(t: Float[np.ndarray, " n"]) -> float:
    """The power of ten that all times are multiples of, of the two below the least
    step; 0 where there is none."""
    largest = math.floor(math.log10(1.001 * float(np.min(np.diff(t)))))
    for step in (10.0**largest, 10.0 ** (largest - 1)):
        away = np.abs(t / step - np.round(t / step))
        if np.all(away < 1e-6 + 4 * np.finfo(float).eps * np.abs(t / step)):
            return step
    return 0.0


def _of_values(
    x: Float[np.ndarray, " n"], name: str, unit: str, known: bool
) -> Iterator[str]:
    """Values that stand for none; of an input, which is to be `known`, and an output,
    which may have gaps."""
    low, high = np.quantile(x, _USUAL)
    reach = _BEYOND * (high - low)
    away = (x < low - reach) | (x > high + reach)
    # What a device does it does on the way there: an impulse is measured.
    leapt = np.abs(np.diff(x, prepend=x[:1])) > reach
    first = np.flatnonzero(np.diff(away, prepend=False) & away)
    far = np.flatnonzero(away)
    if reach and far.size and np.all(leapt[first[first > 0]]):
        value = quantity(float(x[far[0]]), unit, 4)
        mend = "Make them NaN, and bridge them (`hystjax.bridged`)."
        if known:
            mend = "What drives a device has no gaps: take windows without them."
        yield (
            f"{name} has {far.size} value(s) far from all others, such as {value} in "
            f"{_rows(far)}: do they stand for none? {mend}"
        )


def _at_its_end(u, w, name: str, unit: str) -> Iterator[str]:
    """Where the output stays at its largest or least value to the last digit, though
    the input goes on the way that it went. (An input that turns there, as before a play
    or a stop, is another matter; and so are the levels of a rounded output.)"""
    levels = np.unique(w)
    if len(levels) < 3:
        return
    for end, neighbour in (levels[[-1, -2]], levels[[0, 1]]):
        edges = np.flatnonzero(np.diff(w == end, prepend=False, append=False))
        rows = []
        for first, after in edges.reshape(-1, 2):
            before = max(0, first - 2)
            way = np.sign(u[first] - u[before])
            goes_on = np.max(way * (u[first:after] - u[first])) > _MOVED * np.ptp(u)
            leapt = abs(end - w[before]) > 1.5 * abs(end - neighbour)
            if after - first >= _HELD and goes_on and leapt:
                rows.append(first)
        if rows:
            yield (
                f"{name} stays at {quantity(float(end), unit, 4)} to the last digit "
                f"though the input goes on, first in {_rows(np.array(rows))}: was its "
                "sensor at its end? Give these samples no weight."
            )


def _rows(rows) -> str:
    """The first few, in words."""
    named = ", ".join(map(str, rows[:_LISTED].tolist()))
    more = f" and {len(rows) - _LISTED} more" if len(rows) > _LISTED else ""
    return f"row{'s' if len(rows) > 1 else ''} {named}{more}"
