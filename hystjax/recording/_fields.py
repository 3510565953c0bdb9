"""What the fields of a recording must be, and when its samples were taken."""

import datetime
import operator
import re
import warnings
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from .._core import checks
from .._core.checks import InputError, nearest
from ..signals import Exact

_GAPS = (
    " Dropouts of an output can stay: `hystjax.bridged` makes a recording across them, "
    "and the weights by which fits leave them out."
)


def check_columns(t: Array, u: Array, w: Array) -> None:
    """Times, inputs and outputs are of one length, finite, and in order."""
    checks.same_length(t=t, u=u, w=w)
    checks.enough_samples("a recording", len(t), 3)
    checks.finite("t", t)
    checks.finite("u", u)
    checks.finite("w", w, _GAPS)
    checks.increasing("t", t)


def check_exact(interpolation: Exact, t: Array, u: Array) -> None:
    """Regression sees the samples and simulation the function: they must agree."""
    if not checks.is_concrete(t, u, *jax.tree.leaves(interpolation)):
        return
    with jax.ensure_compile_time_eval():
        known = np.asarray(jax.vmap(interpolation.function)(t))
    apart, size = float(np.max(np.abs(known - u))), float(np.max(np.abs(u)))
    if apart > 1e-3 * size:
        raise InputError(
            f"`u` and the function of `interpolation.Exact` differ by up to "
            f"{apart:.3g}; replace a measured input by `with_input(function)`."
        )


def check_reach(times: Array, known: Array, clocked: bool) -> None:
    """Times to resample at must lie within those of the recording."""
    reach = jnp.stack([times[0] - known[0], known[-1] - times[-1]])
    if checks.is_concrete(reach) and jnp.any(reach < 0):
        unit = " s" if clocked else ""
        asked, held = (
            f"{float(x[0]):g}{unit} to {float(x[-1]):g}{unit}" for x in (times, known)
        )
        raise InputError(
            f"`t` runs from {asked}, beyond the recording's {held}; hystjax does not "
            "extrapolate measurements."
        )


def whether_clocked(t: Any, clocked: bool | None) -> bool:
    """Whether there is a clock, by default where there are times."""
    if t is None and clocked:
        raise InputError(
            "`clocked=True` needs times, but `t` is None; give `t`, or leave `clocked` "
            "out for a recording without a clock."
        )
    return t is not None if clocked is None else bool(clocked)


def whole_row(number: int) -> int:
    """The number of a row."""
    try:
        return operator.index(number)
    except TypeError:
        raise InputError(
            f"`window` takes whole numbers of rows, got {number!r}; `between` takes "
            "times, and `split` a fraction."
        ) from None


def pair_of(name: str, value: tuple[str, str]) -> tuple[str, str]:
    """Two texts, of the input and of the output."""
    if isinstance(value, str) or len(value) != 2:
        raise InputError(
            f"`{name}` must be a pair, for the input and for the output; got {value!r}."
        )
    return str(value[0]), str(value[1])


_UNITS = {
    **dict.fromkeys(("s", "sec", "second", "seconds"), 1.0),
    **dict.fromkeys(("ms", "msec", "millisecond", "milliseconds"), 1e-3),
    **dict.fromkeys(("us", "µs", "μs", "usec", "microsecond", "microseconds"), 1e-6),
    **dict.fromkeys(("ns", "nanosecond", "nanoseconds"), 1e-9),
    **dict.fromkeys(("min", "minute", "minutes"), 60.0),
    **dict.fromkeys(("h", "hour", "hours"), 3600.0),
}
_SUFFIX = re.compile(r"[_\s](\w+)\s*$")
_CLOCKS = {"t", "time", "times", "timestamp", "date", "datetime", "zeit"}
_MOMENTS = (datetime.datetime, datetime.timedelta, np.datetime64, np.timedelta64)


def seconds(t: Any) -> Any:
    """Dates and durations as seconds since the first; anything else as it is."""
    first = t[0] if isinstance(t, list | tuple) and t else None
    if isinstance(first, _MOMENTS):
        t = np.asarray(t)
        length = isinstance(first, datetime.timedelta | np.timedelta64)
        t = t.astype("timedelta64[ns]" if length else "datetime64[ns]")
    if getattr(getattr(t, "dtype", None), "kind", "") not in ("m", "M"):
        return t
    # To the nanosecond, which floats of seconds since 1970 do not hold.
    since = np.asarray(t - np.asarray(t)[0], "timedelta64[ns]")
    return np.where(np.isnat(since), np.nan, since.astype(np.int64) * 1e-9)


def times(
    table: Any, time: Any, period: Any, time_unit: str | None, n: int
) -> np.ndarray | None:
    """The times of n rows, s: a column of a table, or from the sampling period, which
    is a number or, in a MATLAB file, the name of a variable; `None` for neither.

    What a header says of the unit of its column, in brackets or in a row of units, is
    believed; a name such as `time_ms` is warned of.

    **Raises:** `InputError` where both are given, for a unit that is not known, and for
    a period that is not one positive number.
    """
    if time is not None and period is not None:
        raise InputError(
            "give either `time`, a column, or `period`, the sampling period; got "
            f"time={time!r} and period={period!r}."
        )
    scale = None if time_unit is None else _scale(time_unit)
    if time is not None:
        column = table.moments("time", time)
        if column.dtype.kind in "mM":
            return seconds(column)
        return (_stated(table, time) if scale is None else scale) * column
    if period is None:
        _warn_of_clock(table)
        return None
    if isinstance(period, str):
        period = _single(table.column("period", period), period)
    if not 0 < period < np.inf:
        raise InputError(f"`period` must be positive and finite; got {period}.")
    return (scale or 1.0) * period * np.arange(n)


def _scale(unit: str) -> float:
    known = _UNITS.get(unit.strip().lower()) if isinstance(unit, str) else None
    if known is None:
        raise InputError(
            f"`time_unit`={unit!r} is not known. {nearest(unit, _UNITS)}"
            "Known are s, ms, us, ns, min and h."
        )
    return known


def _stated(table: Any, time: Any) -> float:
    """Seconds in the unit that the table states for its times, 1 where it states none
    that is known."""
    stated = table.unit_of(time).strip().lower()
    if stated in _UNITS:
        return _UNITS[stated]
    name = table.title(time, "")
    found = _SUFFIX.search(name)
    guessed = found[1].lower() if found else ""
    if _UNITS.get(guessed, 1.0) != 1:
        warnings.warn(
            f"the times in the column {name!r} were read as seconds, and by its name "
            f"they are not: pass `time_unit={guessed!r}`, or `time_unit='s'` where "
            "seconds are right.",
            stacklevel=4,
        )
    return 1.0


def _warn_of_clock(table: Any) -> None:
    """That a column which is likely the time was not named as such."""
    names = getattr(table, "names", ())
    likely = [name for name in names if _plain(name) in _CLOCKS]
    if likely:
        warnings.warn(
            "neither `time` nor `period` is given, so this recording has no clock, and "
            f"only rate-independent terms are tried on it; `time={likely[0]!r}` would "
            "be its time.",
            stacklevel=4,
        )


def _plain(name: str) -> str:
    """A name without its unit."""
    bare = re.sub(r"\s*[\[(].*$", "", name).strip().lower()
    found = _SUFFIX.search(bare)
    return bare[: found.start()] if found and found[1] in _UNITS else bare


def _single(values: np.ndarray, name: str) -> float:
    if len(values) != 1:
        raise InputError(
            f"`period`={name!r} holds {len(values)} values; a sampling period is one "
            "number. For a column of times use `time`."
        )
    return float(values[0])
