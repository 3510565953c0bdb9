"""First-order reversal curves: what they are, files of them, and drift."""

import os
import re
from collections.abc import Sequence
from pathlib import Path

import equinox as eqx
import numpy as np
from jaxtyping import Float, Int

from .._core import checks
from .._core.checks import InputError
from .._core.units import to_si
from ..recording import Recording, forc_table
from ..recording._recording import Column

_MU0 = 4e-7 * np.pi
_BACK = 0.5  # typical steps by which the field falls back at least between curves
_GAP = 3.0  # by which it rises to a point that is measured before the next curve
_LEAST = 3  # curves, for a parabola over reversal fields


class Curves(eqx.Module):
    """First-order reversal curves, as points: each curve was measured with rising
    field, after the field had come down from saturation to the curve's reversal field.

    **Attributes:** curves are in order of their reversal fields, each by rising field.

    - `reversal`: of each point, the reversal field of its curve, shape (n,).
    - `field`: shape (n,), in `units[0]`.
    - `moment`: shape (n,), in `units[1]`.
    - `starts`: the first point of each curve, and n, shape (c + 1,).
    - `units`: of fields and moments; files give T, for µ0 H, and A m².

    **Raises:** `InputError` for fewer than three curves, or a curve whose field falls.
    """

    reversal: Float[np.ndarray, " n"]
    field: Float[np.ndarray, " n"]
    moment: Float[np.ndarray, " n"]
    starts: Int[np.ndarray, " c"]
    units: tuple[str, str] = eqx.field(static=True)

    def __init__(
        self,
        parts: Sequence[tuple[Column, Column]],
        units: tuple[str, str] = ("T", "A m²"),
    ):
        """**Arguments:** field and moment of each curve, in any order; their units."""
        try:
            columns = [
                (np.asarray(field, np.float64), np.asarray(moment, np.float64))
                for field, moment in parts
            ]
        except (TypeError, ValueError):
            raise InputError(
                "`parts` must be pairs of columns, the field and the moment of each "
                f"curve, got {checks.described(parts)}; `read_forc` reads a file."
            ) from None
        if len(columns) < _LEAST:
            raise InputError(
                f"a diagram needs {_LEAST} reversal curves or more, got "
                f"{len(columns)}. Curves are told apart by blank lines, or by where "
                "the field falls."
            )
        for number, (field, moment) in enumerate(columns, 1):
            if field.shape != moment.shape or field.ndim != 1 or not len(field):
                raise InputError(
                    f"curve {number} must have as many moments as fields, one or more; "
                    f"got shapes {field.shape} and {moment.shape}."
                )
            if not (np.all(np.isfinite(field)) and np.all(np.isfinite(moment))):
                raise InputError(f"curve {number} holds NaN or inf; remove such rows.")
            if field[-1] < field[0]:
                raise InputError(
                    f"the field falls along curve {number}, from {field[0]:g} to "
                    f"{field[-1]:g}. Reversal curves are measured with rising field; "
                    "turn falling ones round by the signs of field and moment."
                )
        # Stable, so that noise in the field does not mix equal ones.
        sorted_parts = [
            (field[order], moment[order])
            for field, moment in columns
            for order in [np.argsort(field, kind="stable")]
        ]
        sorted_parts.sort(key=lambda part: part[0][0])
        lengths = [len(field) for field, _ in sorted_parts]
        self.starts = np.concatenate([[0], np.cumsum(lengths)]).astype(int)
        self.reversal = np.repeat([field[0] for field, _ in sorted_parts], lengths)
        self.field = np.concatenate([field for field, _ in sorted_parts])
        self.moment = np.concatenate([moment for _, moment in sorted_parts])
        self.units = units

    def __len__(self) -> int:
        return len(self.starts) - 1

    def pick(self, numbers: Sequence[int] | np.ndarray) -> "Curves":
        """Some of the curves, by their numbers in the order of reversal fields."""
        slices = [slice(self.starts[i], self.starts[i + 1]) for i in numbers]
        return Curves([(self.field[s], self.moment[s]) for s in slices], self.units)


def as_curves(curves: Curves | Sequence[Recording]) -> Curves:
    """Curves, or recordings of one curve each.

    **Raises:** `InputError` for anything else, or recordings of different units.
    """
    if isinstance(curves, Curves):
        return curves
    recordings = list(curves) if isinstance(curves, Sequence) else []
    if not recordings or not all(isinstance(each, Recording) for each in recordings):
        raise InputError(
            "`curves` must be what `hystjax.loops.read_forc` returns, or a list of "
            f"recordings, one a curve; got {type(curves).__name__}."
        )
    checks.concrete("`hystjax.loops.forc`", recordings)
    units = {each.units for each in recordings}
    if len(units) > 1:
        raise InputError(
            f"the curves have different units: {sorted(units)}. Convert them first."
        )
    return Curves([(each.u, each.w) for each in recordings], units.pop())


def read_forc(path: str | os.PathLike, *, drift: bool = True) -> Curves:
    """Read a file of first-order reversal curves.

    What is read: MicroMag 2900/3900 (Princeton Measurements, Lake Shore), in hybrid SI,
    SI or cgs; tables of Lake Shore's 8600 series, below `##DATA TABLE`; and columns of
    text, the first two field and moment unless a header names them, as with these
    words, H or B, and M, curves apart by blank lines or by where the field falls back.

    Where a single point was measured before each curve, drift is corrected by it: the
    moments are divided by what these points, joined by straight lines in the order of
    measurement, are of their mean.

    **Arguments:** the file; `drift`, whether to correct for it.

    **Returns:** `Curves`, fields in T (µ0 H) and moments in A m² where the file tells
    its units.

    **Raises:** `InputError`, with what is wrong: no such file, a table cut short or
    without its footer, units that contradict each other, curves that are missing or too
    few, or run downwards.
    """
    table = forc_table(Path(path))
    parts, points = _with_calibration(table.segments)
    if table.promised is not None and len(parts) != table.promised:
        raise InputError(
            f"{path} holds {len(parts)} reversal curves where its header promises "
            f"{table.promised} (`NForc`). Some are missing, or other segments are "
            "among them; measure or cut it again."
        )
    if drift and points is not None:
        parts = _without_drift(parts, points)
    field_unit, moment_unit = table.units
    to_tesla, field_unit = _tesla(field_unit)
    moment_unit, to_moment = to_si(_spelt(moment_unit))
    scaled = [(to_tesla * part[:, 0], to_moment * part[:, 1]) for part in parts]
    return Curves(scaled, (field_unit, moment_unit))


def _with_calibration(segments):
    """The curves, and the points measured before each if there are any."""
    if len(segments) == 1:
        segments = _cut(segments[0])
    before = segments[0::2]
    if len(segments) % 2 == 0 and all(len(each) == 1 for each in before):
        return segments[1::2], np.array([each[0, 1] for each in before])
    return segments, None


def _cut(points):
    """Runs of rising field of one long table."""
    steps = np.diff(points[:, 0])
    if not np.any(steps > 0):
        return [points]
    step = np.median(steps[steps > 0])
    ends = np.flatnonzero(steps < -_BACK * step) + 1
    # A point far above each curve, where there is one above the first curve too,
    # belongs to the next curve.
    last = ends[1:] - 2
    if last.size and ends[0] == 1:
        others = np.delete(steps, last)
        if np.min(steps[last]) > max(_GAP * step, np.max(others)):
            ends = np.union1d(ends, last + 1)
    return np.split(points, ends)


def _without_drift(parts, points):
    mean = np.mean(points)
    later = np.append(points[1:], points[-1])
    out = []
    for part, now, then in zip(parts, points, later, strict=True):
        share = np.arange(1, len(part) + 1) / (len(part) + 1)
        level = now + share * (then - now)
        out.append(np.stack([part[:, 0], part[:, 1] * mean / level], axis=1))
    return out


def _tesla(unit: str) -> tuple[float, str]:
    """What fields in a unit are multiplied by to be µ0 H in T, and the unit then."""
    name, factor = to_si(_spelt(unit))
    if name == "A/m":
        return _MU0 * factor, "T"
    return factor, name


def _spelt(unit: str) -> str:
    """A unit as `to_si` knows it; square metres are written in many ways."""
    return re.sub(r"A[ ·*]?m(²|\^?2)", "A m²", re.sub(r"\s+", " ", unit))
