"""What is put right before a loop is read: units, offsets, drift, slopes, and the field
that a body makes against itself."""

from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int

from .._core import checks
from .._core.checks import InputError
from .._core.compiling import changed
from .._core.show import as_factor
from ..recording import Past, Recording, as_recording
from ..recording._notation import to_si
from ._reversals import Reversals, found_in

_PRODUCTS = {
    "T·A/m": "J/m³",
    "A/m·T": "J/m³",
    "N·m": "J",
    "m·N": "J",
    "MPa·1": "MJ/m³",
}


_BACK = 0.05  # of a swing, within which an input has come back


class Units(NamedTuple):
    """Of the input and of the output, and of what is made of both, which has none
    known where one of these is not."""

    u: str
    w: str

    @property
    def energy(self) -> str:
        if not all(self):
            return ""
        product = f"{self.w}·{self.u}"
        pure = "·".join(each for each in (self.w, self.u) if each != "1")
        return _PRODUCTS.get(product, pure or "1")

    @property
    def slope(self) -> str:
        if not all(self):
            return ""
        if self.u == "1":
            return self.w
        ratio = f"{self.w}/{as_factor(self.u)}"
        return {"T/(A/m)": "H/m"}.get(ratio, ratio)


_HIGH = 0.8  # of the largest input, beyond which a loop is taken to be saturated


def in_si(recording: Recording) -> Recording:
    """The record in SI units: cgs, technical and imperial ones are converted; units
    that are not known stay as they are."""
    as_recording(recording, "in_si(recording)")
    checks.concrete("`hystjax.loops`", recording)
    u_unit, u_factor = to_si(recording.units[0])
    w_unit, w_factor = to_si(recording.units[1])
    if (u_unit, w_unit) == recording.units:
        return recording
    return Recording(
        recording.t,
        u_factor * np.asarray(recording.u),
        w_factor * np.asarray(recording.w),
        names=recording.names,
        units=(u_unit, w_unit),
        interpolation=recording.interpolation.of_units(u_factor, 0.0),
        clocked=recording.clocked,
        past=_past(recording, u_factor, 0.0),
    )


def _past(recording: Recording, factor: float, offset: float) -> Past | None:
    """The input before a record, if it is known, times a factor and moved."""
    past = recording.past
    return None if past is None else Past(past.t, factor * past.u + offset)


def centred(recording: Recording, *, found: Reversals | None = None) -> Recording:
    """The record with its zero in the middle: half way between the mean upper and the
    mean lower tip, of the input and of the output."""
    found = _turning("centred", recording, found)
    u, w = _columns(recording)
    u_middle, w_middle = (
        float(x[found.rows[found.upper]].mean() + x[found.rows[~found.upper]].mean())
        / 2
        for x in (u, w)
    )
    between = recording.interpolation.of_units(1.0, -u_middle)
    before = _past(recording, 1.0, -u_middle)
    moved = changed(recording, interpolation=between, past=before)
    return _with(moved, u=u - u_middle, w=w - w_middle)


def without_drift(recording: Recording, *, found: Reversals | None = None) -> Recording:
    """The record without what its output drifts from a tip to the next of the same
    kind: a straight line in time, by the mean over all tips that the input comes back
    to, within 5 % of its swing, and not from farther than it ever was before, for where
    a material goes first it leaves some of the way behind; or over all where there is
    none such. Upper and
    lower ones count alike, for a change of its amplitude moves them against each other.
    A single loop closes. Tips are single samples: their noise, over the time of the
    record, is in the line, and not in standard errors of what is read afterwards.
    Strength that a device loses on one side more than on the other counts as drift.

    **Raises:** `InputError` where there is one pair of tips, of two amplitudes.
    """
    found = _turning("without_drift", recording, found)
    if len(found) < 3:
        raise InputError(f"drift shows over a cycle, and there is none: {found}.")
    t, (_, w) = np.asarray(recording.t, np.float64), _columns(recording)
    return _with(recording, w=w - drift_rate(recording, found) * (t - t[0]))


def drift_rate(recording: Recording, found: Reversals) -> float:
    """What the output of a record drifts by, in output units per second, or per sample
    where there is no clock."""
    u, w = _columns(recording)
    t = np.asarray(recording.t, np.float64)
    first, between, last = (found.rows[i : len(found) - 2 + i] for i in range(3))
    counted = tells_drift(u, first, between, last)
    if not counted.any():
        if len(first) < 2:
            raise InputError(
                "drift shows where the input comes back to a tip, and it never does: "
                "what the output moves by from one amplitude to the next is no drift."
            )
        counted = np.arange(len(first)) < len(first) // 2 * 2
    upper = found.upper[: len(first)]
    rates = []
    for kind in (upper & counted, ~upper & counted):
        moved, passed = ((x[last] - x[first])[kind].sum() for x in (w, t))
        if kind.any():
            rates.append(moved / passed)
    return float(np.mean(rates))


def tells_drift(
    u: Float[np.ndarray, " n"],
    first: Int[np.ndarray, " m"],
    between: Int[np.ndarray, " m"],
    last: Int[np.ndarray, " m"],
) -> Bool[np.ndarray, " m"]:
    """Whether a device without drift would be at the last rows where it was at the
    first ones: the input comes back, from no farther than it had been before where some
    of its ways are such."""
    back = comes_back(u, first, between, last)
    swing = np.abs(u[between] - u[first])
    highest, lowest = np.maximum.accumulate(u)[first], np.minimum.accumulate(u)[first]
    farther = np.maximum(u[between] - highest, lowest - u[between]) > _BACK * swing
    return back & ~farther if np.any(back & ~farther) else back


def comes_back(
    u: Float[np.ndarray, " n"],
    first: Int[np.ndarray, " m"],
    between: Int[np.ndarray, " m"],
    last: Int[np.ndarray, " m"],
) -> Bool[np.ndarray, " m"]:
    """Whether the input is as far as at the first rows again at the last ones, after it
    was at those between."""
    return np.abs(u[last] - u[first]) <= _BACK * np.abs(u[between] - u[first])


def without_slope(recording: Recording, slope: float | None = None) -> Recording:
    """The record without a part of the output that is proportional to the input: of
    para- or diamagnetic matter, or of a spring beside the device.

    **Arguments:** the record; the slope, output over input units. By default that of
    straight lines, one on each side, where the input is beyond 80 % of its largest.

    **Raises:** `InputError` where a side has fewer than three samples there, or all at
    one input, or for a slope that is no finite number.
    """
    as_recording(recording, "without_slope(recording, slope)")
    u, w = _columns(recording)
    if slope is not None:
        check_finite("slope", slope)
    part = _high_slope(u, w) if slope is None else slope
    return _with(recording, w=w - part * u)


def check_finite(name: str, value: Any) -> None:
    """Raise `InputError` for what is no finite number."""
    checks.concrete("`hystjax.loops`", value)
    if not np.isfinite(checks.number(name, value)):
        raise InputError(f"`{name}` must be finite, got {value!r}.")


def _high_slope(u, w) -> float:
    middle, reach = (u.max() + u.min()) / 2, np.ptp(u) / 2
    products = squares = 0.0
    for side in ((u - middle) > _HIGH * reach, (u - middle) < -_HIGH * reach):
        if side.sum() < 3 or not np.ptp(u[side]):
            raise InputError(
                "fewer than three samples lie beyond 80 % of the largest input on one "
                "side, or all at one input; give the `slope`."
            )
        away = u[side] - u[side].mean()
        products, squares = products + away @ w[side], squares + away @ away
    return products / squares


def without_demagnetisation(recording: Recording, factor: float) -> Recording:
    """The record over the field inside of a body, u - factor w, of a magnetisation w in
    the unit of the field strength u.

    **Raises:** `InputError` for a factor that is not from 0 to 1, or different units.
    """
    as_recording(recording, "without_demagnetisation(recording, factor)")
    checks.concrete("`hystjax.loops`", recording, factor)
    factor = checks.share("factor", factor)
    if recording.units[0] != recording.units[1]:
        raise InputError(
            "field strength and magnetisation must have one unit, such as A/m; got "
            f"{recording.units}."
        )
    u, w = _columns(recording)
    return recording.with_input(u - factor * w)


def _turning(call: str, recording: Recording, found: Reversals | None) -> Reversals:
    found = found_in(call, recording, None, found)
    if len(found) < 2:
        raise InputError(f"the input does not turn: {found}.")
    return found


def _columns(recording: Recording):
    checks.concrete("`hystjax.loops`", recording)
    return np.asarray(recording.u, np.float64), np.asarray(recording.w, np.float64)


def _with(recording: Recording, **columns: np.ndarray) -> Recording:
    """The record with other columns, of its own precision."""
    dtype = recording.u.dtype
    return changed(
        recording, **{name: jnp.asarray(x, dtype) for name, x in columns.items()}
    )
