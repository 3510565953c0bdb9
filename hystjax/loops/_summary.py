"""The numbers of each cycle of a record, with their standard errors, as a dataset
and as a table."""

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from .._core.checks import InputError, described, not_constant
from .._core.compiling import changed
from .._core.show import with_unit
from ..recording import Recording
from ..simulation import Trajectory
from ._corrections import Units
from ._cycle import (
    Column,
    Tips,
    closest,
    column_of,
    crossings,
    extremum,
    timing,
    tips_of,
    work,
    zeros_of,
)
from ._reversals import Reversals, distinct, found_in

if TYPE_CHECKING:
    import xarray

LEVELS = (0.25, 0.5, 0.75)  # from the lower to the upper tip, where widths are taken
_HEIGHTS = np.linspace(0.125, 0.875, 7)  # of the input, where pinching looks
_UNLOADED = 0.1  # share of a branch over which the slope after a turn is taken
_CLEAR = 0.01  # share of a swing by which an axis is inside of the loop
_ALIKE = 0.05  # amplitudes that differ by less are one
_OVER_SATURATION = ("asymmetry", "damping", "squareness", "width")
_FAR = 1e4  # per cent, beyond which they say no more than the numbers
_HIDDEN = 4.0  # noise levels, within which outputs are one


class Number(NamedTuple):
    """A number of every cycle, shape (c,) or (c, levels); its standard error, `None`
    for those that have none; its unit, and what it is."""

    value: Float[np.ndarray, "..."]
    error: Any
    unit: str
    what: str

    def only(self, there: Bool[np.ndarray, " c"]) -> "Number":
        """The number of such cycles; NaN of others."""
        there = there.reshape(-1, *(1,) * (self.value.ndim - 1))
        value, error = (np.where(there, x, np.nan) for x in (self.value, self.error))
        return self._replace(value=value, error=error)


def numbers(recording: Recording, found: Reversals) -> dict[str, Number]:
    """All numbers of all cycles, by name; see `summary`."""
    kept = distinct(recording)
    t, *columns = (
        np.asarray(x, np.float64)[kept] for x in (recording.t, recording.u, recording.w)
    )
    t = t if recording.clocked else np.arange(float(len(kept)))
    turned, rows = (
        np.searchsorted(kept, each, side="right") - 1
        for each in (found.rows, found.cycles)
    )
    u, w = (column_of(x, t, turned, recording.clocked) for x in columns)
    tips = tips_of(u, w, turned)
    # Cycles share turning points: the first of each, and which tips are its own.
    first = np.searchsorted(turned, rows[:, int(found.from_zero)])
    own = first[:, None] + np.arange(2 if found.from_zero else 3)
    upper_first = found.upper[first] if len(first) else np.empty(0, bool)
    units = Units(*recording.units)
    areas = _energies(u, w, rows)
    at = Tips(*(each[own] for each in tips))
    # A cycle from zero has no more than half of its branch to the next tip.
    later = np.append(turned, len(kept) - 1)[first + 2]
    goes_on = np.zeros((len(rows), 2), int)
    if found.from_zero:
        ends = _at_zero(u, w, turned, rows[:, [0, 3]])
        closed = _closed(u, w, at, ends, rows) & (later == len(kept) - 1)
        goes_on = np.where(closed[:, None], rows[:, :2], 0)
    else:
        ends = Tips(*(each[:, [0, 2]] for each in at))
    tip, turn = turned[first], turned[first + 1]
    branches = _branches(tip, turn, later, goes_on, upper_first)
    span = _span(w, at, rows)
    out = {
        **_sizes(at, upper_first, units),
        **_energy_numbers(areas, at, units),
        **_axes(u, w, at, ends, span, branches, units),
        **_widths(u, w, at, branches, units),
        **_slopes(u, w, at, span, branches, units),
        **_drifts(ends, units),
    }
    out |= _squareness(out)
    out |= _of_tips_apart(out, span)
    out |= _degradation(at)
    if recording.clocked:
        period, lag, error = timing(t, u, w, ends)
        out["period"] = Number(period, None, "s", "time from beginning to end")
        out["lag"] = Number(lag, error, "rad", "of the output's fundamental wave")
    return out


def _closed(u: Column, w: Column, at: Tips, ends: Tips, rows) -> Bool[np.ndarray, " c"]:
    """Whether loops from zero close, so that the rows up to their first tip are what
    would come after their end. A first one, which begins in the middle of what it opens
    at zero, does not, however little that is."""
    there = np.stack([rows[:, 1:3], np.zeros_like(rows[:, 1:3])], axis=1)
    level = _zero_within(at.u, np.ptp(at.u, axis=1))
    back, _ = _across(u, w, level, there)
    begun, ended = ends.w.T
    opening = np.abs(back - ended)
    apart = np.abs(ended - begun)
    closed = apart <= _ALIKE * np.abs(np.diff(at.w)[:, 0])
    return closed & (apart <= np.maximum(opening / 4, _HIDDEN * w.noise))


def _at_zero(u: Column, w: Column, turned, ends) -> Tips:
    """Where cycles begin and end at zero, shapes (c, 2), by the rows next to it."""
    rows = ends.ravel()
    edges = np.concatenate([[0], turned, [len(u.x) - 1]])
    # At the first row there is none before.
    before = np.maximum(np.searchsorted(edges, rows) - 1, 0)
    after = np.searchsorted(edges, rows, side="right").clip(max=len(edges) - 1)
    found = zeros_of(u, w, rows, edges[before], edges[after])
    return Tips(*(each.reshape(-1, 2) for each in found))


def _energies(u: Column, w: Column, rows):
    """The signed area of each cycle closed by a straight line, its standard error, and
    the work done up to its end."""
    parts = work(u.x, w.x, u.at, (u.noise, w.noise))
    total = np.concatenate([[0.0], np.cumsum(parts)])
    start, stop = rows[:, 0], rows[:, -1]
    close = (w.x[stop] + w.x[start]) / 2 * (u.x[start] - u.x[stop])
    area = total[stop] - total[start] + close
    # A sample's part in the area is half of what its neighbours lie apart.
    apart = [
        np.concatenate([[0.0], np.cumsum(np.gradient(column.x) ** 2)])
        for column in (u, w)
    ]
    variances = np.stack(
        [
            sigma**2 * (squares[stop + 1] - squares[start])
            for squares, sigma in zip(apart, (w.noise, u.noise), strict=True)
        ]
    )
    # What noise in both makes is in either sum, and counts once; of a few samples a
    # cycle it may be taken for more than is in one of them.
    both = (u.noise * w.noise) ** 2 * (stop - start) / 2
    variance = np.sum(variances, axis=0) - np.minimum(both, np.min(variances, axis=0))
    return area, np.sqrt(variance), total[stop]


def _branches(first, second, later, goes_on, upper_first):
    """First and last row of the falling and of the rising branch of each cycle, and of
    what goes on with it elsewhere, which is of one row where there is none, shapes (c,
    2, 2): by the rows of its first two tips and of the tip after them."""
    there, back = (
        np.stack([np.stack(pair, axis=1), more], axis=1)
        for pair, more in (
            ((first, second), np.zeros_like(goes_on)),
            ((second, later), goes_on),
        )
    )
    upper_first = upper_first[:, None, None]
    return np.where(upper_first, there, back), np.where(upper_first, back, there)


def _upper_lower(at: Tips, upper_first):
    """Values at the upper and at the lower tips; where two tips of a cycle are of one
    kind, their mean."""
    out = []
    for value, error in ((at.u, at.u_error), (at.w, at.w_error)):
        outer, outer_error = _outer(value), _outer_error(error)
        inner, inner_error = value[:, 1], error[:, 1]
        out.append(
            (
                np.where(upper_first, outer, inner),
                np.where(upper_first, inner, outer),
                np.where(upper_first, outer_error, inner_error),
                np.where(upper_first, inner_error, outer_error),
            )
        )
    return out


def _outer(values: Float[np.ndarray, "c k"]) -> Float[np.ndarray, " c"]:
    """At the first tip, or the mean of the first and the third."""
    return np.mean(values[:, ::2], axis=1)


def _outer_error(errors: Float[np.ndarray, "c k"]) -> Float[np.ndarray, " c"]:
    outer = errors[:, ::2]
    return np.linalg.norm(outer, axis=1) / outer.shape[1]


def _sizes(at: Tips, upper_first, units: Units) -> dict[str, Number]:
    (u_up, u_low, eu_up, eu_low), (w_up, w_low, ew_up, ew_low) = _upper_lower(
        at, upper_first
    )
    eu, ew = np.hypot(eu_up, eu_low) / 2, np.hypot(ew_up, ew_low) / 2
    du, dw = (u_up - u_low) / 2, (w_up - w_low) / 2
    with np.errstate(divide="ignore", invalid="ignore"):
        secant = dw / du
        secant_error = np.hypot(ew, secant * eu) / np.abs(du)
        skew = (w_up + w_low) / (w_up - w_low)
        skew_error = np.hypot(w_low * ew_up, w_up * ew_low) / (2 * dw**2)
    return {
        "u_max": Number(u_up, eu_up, units.u, "input at the upper tip"),
        "u_min": Number(u_low, eu_low, units.u, "input at the lower tip"),
        "w_max": Number(w_up, ew_up, units.w, "output at the upper tip of the input"),
        "w_min": Number(w_low, ew_low, units.w, "output at the lower tip of the input"),
        "amplitude": Number(du, eu, units.u, "half the input from tip to tip"),
        "saturation": Number(dw, ew, units.w, "half the output from tip to tip"),
        "secant_stiffness": Number(
            secant, secant_error, units.slope, "slope from tip to tip"
        ),
        "asymmetry": Number(
            skew, skew_error, "1", "mean of the outputs at both tips over saturation"
        ),
    }


def _energy_numbers(areas, at: Tips, units: Units) -> dict[str, Number]:
    area, error, total = areas
    du, dw = (np.abs(_outer(each) - each[:, 1]) / 2 for each in (at.u, at.w))
    eu, ew = (
        np.hypot(_outer_error(each), each[:, 1]) / 2
        for each in (at.u_error, at.w_error)
    )
    with np.errstate(divide="ignore", invalid="ignore"):
        damping = np.abs(area) / (2 * np.pi * du * dw)
        shares = np.stack([error / area, ew / dw, eu / du])
        damping_error = damping * np.sqrt(np.sum(shares**2, axis=0))
    return {
        "energy": Number(
            area, error, units.energy, "signed area of the closed loop, ∮ w du"
        ),
        "cumulative_energy": Number(
            total, None, units.energy, "∫ w du from the first row on"
        ),
        "damping": Number(
            damping, damping_error, "1", "equivalent viscous damping ratio"
        ),
    }


def _span(w: Column, at: Tips, rows) -> Float[np.ndarray, " c"]:
    """By how much the output differs in each cycle."""
    whole = rows[:, [0, -1]].tolist()
    low, high = (
        extremum(w, np.array([a + pick(w.smooth[a : b + 1]) for a, b in whole], int))
        for pick in (np.argmin, np.argmax)
    )
    # A corner of the output at a tip is farther than any sample, or their average.
    return np.maximum(high, at.w.max(axis=1)) - np.minimum(low, at.w.min(axis=1))


def _axes(
    u: Column, w: Column, at: Tips, ends: Tips, span, branches, units: Units
) -> dict[str, Number]:
    """Where the loop passes its axes, if these are well inside of it."""
    level = _zero_within(at.u, np.ptp(at.u, axis=1))
    (down, down_error), (up, up_error) = (
        _across(u, w, level, branch) for branch in branches
    )
    if at.u.shape[1] == 2:
        # A cycle from zero ends there, be it with the record.
        upper_first = at.u[:, 0] > at.u[:, 1]
        end, error = ends.w[:, 1], ends.w_error[:, 1]
        down, down_error = np.where(upper_first, (down, down_error), (end, error))
        up, up_error = np.where(upper_first, (end, error), (up, up_error))
    (left, left_error), (right, right_error) = (
        _across(w, u, _zero_within(at.w, span), branch) for branch in branches
    )
    remanent = np.hypot(down_error, up_error) / 2
    coercive = np.hypot(left_error, right_error) / 2
    return {
        "remanence": Number(
            (down - up) / 2,
            remanent,
            units.w,
            "half the output between branches at u = 0",
        ),
        "coercivity": Number(
            (right - left) / 2, coercive, units.u, "half the input between them, w = 0"
        ),
        "u_bias": Number(
            (right + left) / 2, coercive, units.u, "mean input of both branches, w = 0"
        ),
        "w_bias": Number(
            (down + up) / 2, remanent, units.w, "mean output of both branches, u = 0"
        ),
    }


def _zero_within(
    tips: Float[np.ndarray, "c k"], span: Float[np.ndarray, " c"]
) -> Float[np.ndarray, " c"]:
    """0 where it lies between the tips, clearly for what the column spans, NaN
    elsewhere: a branch that begins at an axis does not pass it."""
    low, high, margin = np.min(tips, axis=1), np.max(tips, axis=1), _CLEAR * span
    return np.where((low < -margin) & (high > margin), 0.0, np.nan)


def _across(of: Column, seen: Column, levels, branch):
    """The other column where one of them passes levels on a branch, and its standard
    error; where it does not, on what goes on with it."""

    def on(part, levels):
        places, passed = crossings(of, levels, *part.T)
        there = closest(seen, places, *part.T)
        with np.errstate(divide="ignore", invalid="ignore"):
            # Noise in what passes a level moves the place, along the other's slope.
            moved = of.noise * passed.gain * there.slope / passed.slope
        return there.value, np.hypot(seen.noise * there.gain, moved)

    value, error = on(branch[:, 0], levels)
    lost = np.isnan(value) & (branch[:, 1, 0] < branch[:, 1, 1])
    if lost.any():
        value[lost], error[lost] = on(
            branch[lost, 1], np.broadcast_to(levels, lost.shape)[lost]
        )
    return value, error


def _widths(u: Column, w: Column, at: Tips, branches, units) -> dict[str, Number]:
    """Openings of the loop along either axis, at levels between its tips."""
    width, error = _opening(w, u, at.w, LEVELS, branches)
    height, _ = _opening(u, w, at.u, _HEIGHTS, branches)
    with np.errstate(divide="ignore", invalid="ignore"):
        middle = np.abs(height[:, len(_HEIGHTS) // 2])
        pinched = 1 - middle / np.max(np.abs(height), axis=1)
    return {
        "width": Number(width, error, units.u, "input between branches at levels of w"),
        "pinching": Number(
            pinched, None, "1", "1 less the middle height over the largest one"
        ),
    }


def _opening(of: Column, seen: Column, tips, shares, branches):
    """Rising less falling branch of one column, at levels of the other."""
    outer = _outer(tips)
    low, high = np.minimum(outer, tips[:, 1]), np.maximum(outer, tips[:, 1])
    levels = low[:, None] + np.array(shares) * (high - low)[:, None]
    (falling, a), (rising, b) = (
        _across(of, seen, levels.ravel(), np.repeat(branch, len(shares), axis=0))
        for branch in branches
    )
    gaps, errors = rising - falling, np.hypot(a, b)
    return gaps.reshape(levels.shape), errors.reshape(levels.shape)


def _slopes(u: Column, w: Column, at: Tips, span, branches, units) -> dict[str, Number]:
    """Slopes just after the two turns, and from the least to the largest output."""
    sizes = np.abs(_outer(at.u) - at.u[:, 1])
    found = []
    for branch, sign in zip(branches, (-1, 1), strict=True):
        tip, tip_w, *tip_errors = _of_tips(at, sign)
        level = tip + sign * _UNLOADED * sizes
        there, error = _across(u, w, level, branch)
        with np.errstate(divide="ignore", invalid="ignore"):
            slope = (there - tip_w) / (level - tip)
            # The level moves with the tip, and along the slope what is read there.
            errors = np.stack([error, slope * tip_errors[0], tip_errors[1]])
            found.append((slope, np.linalg.norm(errors, axis=0) / _UNLOADED / sizes))
    (down, down_error), (up, up_error) = found
    with np.errstate(divide="ignore", invalid="ignore"):
        peak = span / sizes
    return {
        "tangent_stiffness": Number(
            (down + up) / 2,
            np.hypot(down_error, up_error) / 2,
            units.slope,
            "slope over a tenth of the branch after a turn, mean of both",
        ),
        "peak_stiffness": Number(
            peak, None, units.slope, "range of the output over that of the input"
        ),
    }


def _of_tips(at: Tips, sign: int):
    """Input, output and their standard errors at the tip that a branch leaves: the
    upper one where it falls."""
    upper_first = at.u[:, 0] > at.u[:, 1]
    outer = upper_first == (sign < 0)
    columns = (at.u, at.w, at.u_error, at.w_error)
    return tuple(np.where(outer, each[:, 0], each[:, 1]) for each in columns)


def _drifts(ends: Tips, units: Units) -> dict[str, Number]:
    error = np.hypot(*ends.w_error.T)
    what = "output at the end less that at the beginning"
    return {"drift": Number(np.diff(ends.w)[:, 0], error, units.w, what)}


def _squareness(known: dict[str, Number]) -> dict[str, Number]:
    remanence, saturation = known["remanence"], known["saturation"]
    with np.errstate(divide="ignore", invalid="ignore"):
        squareness = remanence.value / saturation.value
        error = np.hypot(remanence.error, squareness * saturation.error) / np.abs(
            saturation.value
        )
    return {"squareness": Number(squareness, error, "1", "remanence over saturation")}


def _of_tips_apart(known: dict[str, Number], span) -> dict[str, Number]:
    """What is over the saturation, of cycles that have one: of a force that is as large
    at both tips, as a damper's where it turns, it would be rounding."""
    apart = np.abs(known["saturation"].value) > _CLEAR * span / 2
    return {name: known[name].only(apart) for name in _OVER_SATURATION}


def _degradation(at: Tips) -> dict[str, Number]:
    """What became of strength and stiffness since the first cycle of an amplitude, in
    the first swing of each cycle: where a test goes on to the next amplitude, the other
    swing is of neither."""
    (amplitude, force), (eu, ew) = (
        [np.abs(np.diff(x[:, :2], axis=1)[:, 0]) for x in (at.u, at.w)],
        [np.hypot(x[:, 0], x[:, 1]) for x in (at.u_error, at.w_error)],
    )
    first = _first_alike(amplitude)
    own = first == np.arange(len(first))
    with np.errstate(divide="ignore", invalid="ignore"):
        parts = {
            "strength": (force, ew / force),
            "stiffness": (force / amplitude, np.hypot(ew / force, eu / amplitude)),
        }
    out = {}
    for name, (value, relative) in parts.items():
        with np.errstate(divide="ignore", invalid="ignore"):
            kept = value / value[first]
            error = np.where(own, 0.0, kept * np.hypot(relative, relative[first]))
        what = f"{name} lost since the first cycle of its amplitude"
        out[f"{name}_degradation"] = Number(1 - kept, error, "1", what)
    return out


def _first_alike(amplitude: Float[np.ndarray, " c"]) -> Int[np.ndarray, " c"]:
    """The first cycle of each cycle's amplitude."""
    firsts: list[int] = []
    out = np.zeros(len(amplitude), int)
    for i, size in enumerate(amplitude):
        alike = [j for j in firsts if abs(size - amplitude[j]) <= _ALIKE * amplitude[j]]
        if not alike:
            firsts.append(i)
        out[i] = alike[0] if alike else i
    return out


# What a table shows unless it is told otherwise: the shape, the loss, the axes.
_SHOWN = (
    "amplitude",
    "saturation",
    "energy",
    "damping",
    "secant_stiffness",
    "remanence",
    "coercivity",
    "lag",
)


def summary(
    recording: Recording,
    *,
    threshold: float | None = None,
    begin: str = "tip",
    found: Reversals | None = None,
) -> "xarray.Dataset":
    """The numbers of each cycle of a record, measured or simulated.

    A cycle goes from a tip of the input to the next one of its kind. Where a test steps
    from one amplitude to the next, so do its outer tips: amplitude, energy, stiffness
    and damping of such a cycle are of neither. With `begin="zero"` cycles are those of
    the protocols of cyclic tests, from zero to a tip, to the other one and back to
    zero: energy, range and lag are of that, sizes of its two tips, and what is read
    between branches is of that from tip to tip, and of the one back, which goes on to
    the tip of the next cycle, or to the end of the record. What is before the first tip
    or zero and after the last one, as where a test ends at a tip, is in no cycle.

    Values at tips, at axes and at levels come from local cubics, which pass through the
    samples where there is no noise and average it where there is; tips, and where
    there is a clock corners, may lie between samples; where the input rests at a tip,
    that is the level of the rest; where the output leaps there, as dry friction does,
    the mean of both sides, with half of the leap as an error. Areas are from cubics
    too, with corners kept. Standard errors are for white noise, of which third
    differences, less those at corners, tell how strong it is; `<name>_error` holds
    them.

    - `energy`, ∮ w du: positive where w is ahead of u, as the force of a device that
        dissipates; of B over H it is the loss with a minus sign. `cumulative_energy`.
    - `u_max`, `u_min`, `w_max`, `w_min`: at the tips of the input; `amplitude` and
        `saturation`, half of what they differ by; `asymmetry`; `drift`.
    - `secant_stiffness`, from tip to tip; `tangent_stiffness`, over the tenth of a
        branch after a turn; `peak_stiffness`, of the ranges.
    - `damping`: |energy| / (2 π amplitude saturation).
    - `remanence`, `coercivity`, `squareness`; `u_bias`, `w_bias`. They count from zero:
        remove an offset first (`hystjax.loops.centred`).
    - `width` at a quarter, half and three quarters of the way between tips of w.
    - `pinching`: 0 where a loop is as high in the middle as anywhere.
    - `strength_degradation`, `stiffness_degradation`: what the first swing of a cycle,
        from its first tip to its second, has lost since that of the first cycle that
        swung as far, within 5 %.
    - with a clock, `period` and `lag`, by which the fundamental wave of the output is
        behind that of the input.

    **Arguments:** the record; `threshold` and `begin` as for `reversals`; or what that
    `found`.

    **Returns:** an `xarray.Dataset` over `cycle`, with units, the rows of each cycle,
    and in its attributes the threshold and the noise. NaN where a loop has no such
    number: it does not reach an axis, or its output is the same at both tips.

    **Raises:** `InputError` where there is no cycle, for an output that never changes,
    and as `reversals` does.

    **Source:** damping by Jacobsen (1930), Trans. ASME 52, and Chopra, *Dynamics of
    Structures*, 3.9; squareness and coercivity as in IEC 60404.
    """
    found = _with_cycles("summary", recording, threshold, begin, found)
    return _dataset(recording, found, numbers(recording, found))


def _with_cycles(call: str, recording, threshold, begin, found) -> Reversals:
    """The turning points of a record whose input makes a cycle, and whose output
    changes."""
    found = found_in(call, recording, threshold, found, begin)
    if not len(found.cycles):
        period = ""
        # Of an input that goes one way the ends are its tips.
        inside = found.rows[(found.rows > 0) & (found.rows < len(recording) - 1)]
        if len(inside) == 2:
            period = (
                " One period that begins between its tips is a cycle from a tip on: "
                f"`numpy.roll(u, {-inside[0]})`, and w likewise."
            )
            if np.max(np.abs(recording.u[np.array([0, -1])])) <= found.threshold:
                period += ' `summary(..., begin="zero")` reads one from zero to zero.'
        raise InputError(
            f"the input makes no cycle: it has {found}. A smaller `threshold=` counts "
            f"smaller swings; `rainflow` counts half cycles too.{period}"
        )
    not_constant("w", recording.w, "there is no loop to read off.")
    return found


def side_by_side(
    recording: Recording,
    simulated: Mapping[str, Trajectory],
    *,
    threshold: float | None = None,
    begin: str = "tip",
    found: Reversals | None = None,
) -> "xarray.Dataset":
    """The numbers of a record and of what laws make of its input, cycle by cycle along
    `source`: `"recorded"`, and the labels of the laws.

    **Raises:** `InputError` for a trajectory of other rows or that is not finite, for
    one that is called `"recorded"`, and as `summary` does.
    """
    import xarray

    found = _with_cycles("side_by_side", recording, threshold, begin, found)
    sets = {
        label: _dataset(run, found, numbers(run, found))
        for label, run in _runs(recording, simulated).items()
    }
    labels = xarray.DataArray(list(sets), dims="source", name="source")
    return xarray.concat(
        list(sets.values()), labels, coords="minimal", combine_attrs="override"
    )


def _runs(recording, simulated: Mapping[str, Trajectory]) -> dict[str, Recording]:
    """A record, and what laws make of its input, by label."""
    if not isinstance(simulated, Mapping):
        raise InputError(
            "`simulated` must be a dictionary of trajectories by label, such as "
            f'`{{"law": trajectory}}`; got {described(simulated)}.'
        )
    runs = {"recorded": recording}
    if "recorded" in simulated:
        raise InputError(
            "the label 'recorded' is that of the record itself; give the trajectory "
            "another one."
        )
    for label, trajectory in simulated.items():
        if not isinstance(trajectory, Trajectory | Recording):
            raise InputError(
                "`simulated` must hold trajectories, as `simulate` returns them; got "
                f"{described(trajectory)} by the label {label!r}."
            )
        w = np.asarray(trajectory.w)
        if w.shape != (len(recording),) or not np.all(np.isfinite(w)):
            raise InputError(
                f"the trajectory {label!r} must be finite and have the "
                f"{len(recording)} rows of the record; got shape {w.shape}."
            )
        runs[label] = changed(recording, w=trajectory.w)
    return runs


def compared(
    recording: Recording, simulated: Mapping[str, Trajectory]
) -> list[list[str]]:
    """What `table` makes of `side_by_side`, without xarray, which takes a tenth of the
    time of a whole report to import."""
    found = _with_cycles("compared", recording, None, "tip", None)
    runs = _runs(recording, simulated)
    recorded, *others = (numbers(run, found) for run in runs.values())
    shown = [name for name in _SHOWN if name in recorded]
    head = [with_unit(name, recorded[name].unit) for name in shown]
    values = [np.stack([e[name].value for e in (recorded, *others)]) for name in shown]
    return _means(runs, head, values)


def table(dataset: "xarray.Dataset", names: Sequence[str] = _SHOWN) -> list[list[str]]:
    """Numbers as cells of text, headings first: of each cycle, with standard errors; or
    of what `side_by_side` returned, means over the cycles, and by how much those of
    each law are off.

    **Arguments:** what `summary` or `side_by_side` returned, and which numbers; those
    that it does not have are left out.

    **Raises:** `InputError` for a name that no summary has, for numbers at levels, and
    for what is none.
    """
    if not hasattr(dataset, "data_vars"):
        raise InputError(
            "`dataset` must be what `hystjax.loops.summary` or `side_by_side` "
            f"returned, got {described(dataset)}."
        )
    if "cycle" not in dataset.dims:
        raise InputError(
            "`dataset` must be over `cycle`, and has none, as where one was taken out "
            "of it by its number: `isel(cycle=[0])` keeps it."
        )
    known = {*map(str, dataset.data_vars), *_SHOWN, "period"}
    if unknown := [name for name in names if name not in known]:
        raise InputError(
            f"a summary has no number {unknown[0]!r}; it has "
            f"{', '.join(sorted(known))}."
        )
    there = [name for name in names if name in dataset]
    if at_levels := [name for name in there if "level" in dataset[name].dims]:
        raise InputError(
            f"`names` hold {at_levels[0]!r}, of which there is a number for each level "
            f"and cycle; read `dataset[{at_levels[0]!r}]`."
        )
    head = [with_unit(name, dataset[name].attrs["units"]) for name in there]
    if "source" in dataset.dims:
        values = [dataset[name].transpose("source", "cycle").values for name in there]
        return _means(dataset["source"].values, head, values)
    body = [
        [str(cycle), *(_cell(dataset, name, row) for name in there)]
        for row, cycle in enumerate(dataset["cycle"].values.tolist())
    ]
    return [["cycle", *head], *body]


def _means(
    labels: Iterable[Any],
    head: Sequence[str],
    values: Sequence[Float[np.ndarray, "s c"]],
) -> list[list[str]]:
    """Means over cycles of what was recorded and of laws, a row a number: over those
    that all of them have, but for such as have none."""
    body = []
    for name, each in zip(head, values, strict=True):
        known = ~np.isnan(each)
        some = known.any(axis=1)
        common = known[some].all(axis=0) & some.any()
        count, of = int(np.sum(common)), each.shape[1]
        sums = np.sum(each, axis=1, where=common)
        means = np.where(some & (count > 0), sums / max(count, 1), np.nan)
        shown = name if count in (0, of) else f"{name}, {count} of {of} cycles"
        body.append([shown, *_beside(means.tolist())])
    return [["mean over cycles", *map(str, labels)], *body]


def _beside(values: Sequence[float]) -> list[str]:
    """What was recorded, and the others with what they are off by."""
    truth, *others = values
    off = [100 * (x / truth - 1) if truth else np.nan for x in others]
    return [_told(truth)] + [
        f"{x:.5g} ({_per_cent(each)} %)" if abs(each) < _FAR else _told(x)
        for x, each in zip(others, off, strict=True)
    ]


def _told(value: float) -> str:
    return "–" if np.isnan(value) else f"{value:.5g}"


def _per_cent(value: float) -> str:
    """Two digits, but all of hundreds and thousands: 320, not 3.2e+02."""
    return f"{value:+.2g}" if abs(value) < 99.5 else f"{value:+.0f}"


def _cell(dataset: "xarray.Dataset", name: str, row: int) -> str:
    value = float(dataset[name].values[row])
    if np.isnan(value) or f"{name}_error" not in dataset:
        return _told(value)
    error = float(dataset[f"{name}_error"].values[row])
    if not (np.isfinite(error) and error > 0 and np.isfinite(value)):
        return f"{value:.5g}"
    # No digits beyond the first of the error, nor more than six.
    known = -int(np.floor(np.log10(error)))
    return f"{round(value, known):.6g} ± {float(f'{error:.1g}'):g}"


def _dataset(
    recording: Recording, found: Reversals, known: Mapping[str, Number]
) -> "xarray.Dataset":
    import xarray

    data = {}
    for name, number in known.items():
        dims = ("cycle", "level")[: number.value.ndim]
        about = {"units": number.unit, "long_name": number.what}
        data[name] = (dims, number.value, about)
        if number.error is not None:
            about = {"units": number.unit, "long_name": f"standard error of {name}"}
            data[f"{name}_error"] = (dims, number.error, about)
    rows = found.cycles
    back = ("back",) if found.from_zero else ()
    names = ("start", "turn", *back, "stop")
    coordinates = {
        "cycle": np.arange(1, len(rows) + 1),
        "level": np.array(LEVELS),
        **{name: ("cycle", own) for name, own in zip(names, rows.T, strict=True)},
    }
    attributes = {
        "input": recording.names[0],
        "output": recording.names[1],
        "threshold": found.threshold,
        "input_noise": found.noise,
        "reversals": len(found),
    }
    return xarray.Dataset(data, coordinates, attributes)
