"""Recordings: what their fields must be, and when their samples were taken."""

import operator
import os
import re
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from .._core import checks
from .._core.checks import InputError, is_concrete, nearest, warn
from .._core.compiling import changed
from .._core.show import Card, Shown, moment, samples_card
from ..signals import (
    AbstractInputPath,
    AbstractInterpolation,
    BandLimited,
    Exact,
    Linear,
    check_within,
)
from ..signals.excitation import AbstractExcitation
from ._formats import FrameTable, as_array, frame_table, read_mat, read_table
from ._notation import is_moment, is_unit, moments_of
from ._text import without_unit

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
        known = np.asarray(_along(interpolation.function, t))
    apart, size = float(np.max(np.abs(known - u))), float(np.max(np.abs(u)))
    if apart > 1e-3 * size:
        raise InputError(
            f"`u` and the function of `interpolation.Exact` differ by up to "
            f"{apart:.3g}; replace a measured input by `with_input(function)`."
        )


def _along(function: Callable, t: Array) -> Array:
    """A function of time at many times.

    **Raises:** `InputError` for one that is not written in JAX.
    """
    try:
        return jax.vmap(function)(t)
    except jax.errors.TracerArrayConversionError:
        raise InputError(
            "the function of time that is the input must be written in JAX, which "
            "takes its derivative, and it asks for a number as NumPy does: take "
            "`jax.numpy.sin` for `numpy.sin`, and so on."
        ) from None


def whether_clocked(t: Any, clocked: bool | None) -> bool:
    """Whether there is a clock, by default where there are times."""
    if t is None and clocked:
        raise InputError(
            "`clocked=True` needs times, but `t` is None; give `t`, or leave `clocked` "
            "out for a recording without a clock."
        )
    if clocked is None:
        return t is not None
    if not isinstance(clocked, bool | np.bool_):
        raise InputError(
            "`clocked` must be True or False, or None for whether `t` is given; got "
            f"{checks.described(clocked)}."
        )
    return bool(clocked)


def whole_row(number: int) -> int:
    """The number of a row."""
    try:
        return operator.index(number)
    except TypeError:
        raise InputError(
            f"`window` takes whole numbers of rows, got {number!r}; `between` takes "
            "times, and `split` a fraction."
        ) from None


def check_window(start: int, stop: int, n: int) -> None:
    """Rows must be some of the n that there are."""
    if not 0 <= start < stop <= n:
        raise InputError(
            f"`window({start}, {stop})` is not inside the recording: rows run from 0 "
            f"to {n}, and `start` must be less than `stop`."
        )


def pair_of(name: str, value: tuple[str, str]) -> tuple[str, str]:
    """Two texts, of the input and of the output."""
    given = isinstance(value, Iterable) and not isinstance(value, str)
    pair = tuple(value) if given else ()
    if len(pair) != 2 or any(each is None for each in pair):
        raise InputError(
            f"`{name}` must be a pair of texts, for the input and for the output, each "
            f"of which may be empty; got {value!r}."
        )
    return str(pair[0]), str(pair[1])


_UNITS = {
    **dict.fromkeys(("s", "sec", "secs", "second", "seconds"), 1.0),
    **dict.fromkeys(("ms", "msec", "msecs", "millisecond", "milliseconds"), 1e-3),
    **dict.fromkeys(("us", "µs", "μs", "usec", "usecs"), 1e-6),
    **dict.fromkeys(("microsecond", "microseconds"), 1e-6),
    **dict.fromkeys(("ns", "nsec", "nsecs", "nanosecond", "nanoseconds"), 1e-9),
    **dict.fromkeys(("min", "mins", "minute", "minutes"), 60.0),
    **dict.fromkeys(("h", "hr", "hrs", "hour", "hours"), 3600.0),
    **dict.fromkeys(("d", "day", "days"), 86400.0),
}
_SUFFIX = re.compile(r"[_\s](\w+)\s*$")
_WORD = re.compile(r"[^\W_]+")
_CLOCKS = {"t", "time", "times", "timestamp", "date", "datetime", "zeit"}
_CLOCKS |= {"x_value", "second", "seconds", "elapsed time", "time stamp"}


def seconds(t: Any) -> Any:
    """Dates and durations as seconds since the first; anything else as it is.

    **Raises:** `InputError` for dates with something else among them, and for durations
    without a unit.
    """
    t = checks.unmasked(t)
    if getattr(getattr(t, "dtype", None), "kind", "") == "O" and np.ndim(t):
        t = list(t)
    if isinstance(t, list | tuple) and t and is_moment(t[0]):
        try:
            t = moments_of(t)
        except ValueError as error:
            raise InputError(
                f"`t` holds dates or durations, and {error}. Give all of one kind."
            ) from None
    if getattr(getattr(t, "dtype", None), "kind", "") not in ("m", "M"):
        return t
    t = as_array(t)
    if t.dtype == np.dtype("m8"):
        raise InputError(
            "`t` holds durations without a unit; name it, as `t.astype('m8[ms]')` does."
        )
    if np.datetime_data(t.dtype)[0] in ("Y", "M"):  # not all of which are as long
        t = t.astype(f"{t.dtype.kind}8[s]")
    known = t[~np.isnat(t)]  # the first may be missing
    if not len(known):
        return np.full(t.shape, np.nan)
    # As whole numbers: floats of seconds since 1970 do not hold nanoseconds.
    return (t - known[0]) / np.timedelta64(1, "s")


def times(
    table: Any, time: Any, period: Any, time_unit: str | None, n: int
) -> np.ndarray | None:
    """The times of n rows, s: a column of a table, or from the sampling period, which
    is a number or, in a MATLAB file, the name of a variable; `None` for neither.

    What a header says of the unit of its column, in brackets, behind a slash or in a
    row of units, is believed; one that is not known, and a name such as `time_ms`, is
    warned of.

    **Raises:** `InputError` where both are given, for a unit that is not known, and for
    a period that is not one positive number.
    """
    if time is not None and period is not None:
        raise InputError(
            "give either `time`, a column, or `period`, the sampling period; got "
            f"time={time!r} and period={period!r}."
        )
    scale = None if time_unit is None else scale_of(time_unit)
    if scale is not None and time is None and period is None:
        raise InputError(
            f"`time_unit={time_unit!r}` is the unit of times, and neither `time` nor "
            "`period` is given: name the column of times, or leave it out."
        )
    if time is not None:
        column = table.moments("time", time)
        if column.dtype.kind in "mM":
            return seconds(column)
        return (stated(table, time) if scale is None else scale) * column
    if period is None:
        _warn_of_clock(table)
        return None
    if isinstance(period, str):
        period = _single(table.column("period", period), period)
    return (scale or 1.0) * _checked(period) * np.arange(n)


def _checked(period: Any) -> float:
    try:
        number = float(period)
    except (TypeError, ValueError):
        number = np.nan
    if not 0 < number < np.inf:
        raise InputError(
            f"`period` must be one number, positive and finite; got {period!r}."
        )
    return number


def scale_of(unit: str) -> float:
    known = _known(unit) if isinstance(unit, str) else None
    if known is None:
        raise InputError(
            f"`time_unit={unit!r}` is not known. {nearest(unit, _UNITS)}"
            "Known are s, ms, us, ns, min, h and d."
        )
    return known


def _known(unit: str) -> float | None:
    return _UNITS.get(unit.strip().rstrip(".").lower())


def stated(table: Any, time: Any) -> float:
    """Seconds in the unit that the table states for its times, 1 where it states none
    that is known, which is warned of."""
    name, stated = table.title(time, ""), table.unit_of(time)
    symbol, _, slashed = name.rpartition("/")  # t/ms, as DIN 1313 has it
    is_time = symbol.strip().lower() in _CLOCKS
    known = _known(stated) or (_known(slashed) if is_time else None)
    if known is not None:
        return known
    if stated:
        warn(
            f"the times in the column {name!r} were read as seconds: their unit "
            f"{stated!r} is not known. {nearest(stated, _UNITS)}Pass `time_unit`, "
            "which is `time_unit='s'` where seconds are right.",
        )
        return 1.0
    if isinstance(time, tuple):  # a column of a matrix, whose name says nothing of it
        return 1.0
    # Wherever in the name: `t_ms`, `Time (ms) raw`, `/'Group'/'Time (ms)'`.
    units = [word for word in _WORD.findall(name.lower()) if word in _UNITS]
    guessed = units[-1] if units and all(_UNITS[unit] != 1 for unit in units) else ""
    if guessed:
        warn(
            f"the times in the column {name!r} were read as seconds, and by its name "
            f"they are not: pass `time_unit={guessed!r}`, or `time_unit='s'` where "
            "seconds are right.",
        )
    return 1.0


def _warn_of_clock(table: Any) -> None:
    """That a column which is likely the time, or the index, was not named as such."""
    index = getattr(getattr(table, "index", None), "name", None)
    names = [*table.names, index if isinstance(index, str) else ""]
    likely = [name for name in names if _plain(name) in _CLOCKS]
    if likely:
        warn(
            "neither `time` nor `period` is given, so this recording has no clock, and "
            f"nothing that depends on the rate is told of it; `time={likely[0]!r}` "
            "would be its time.",
        )


def _plain(name: str) -> str:
    """A name without its unit."""
    bare = re.sub(r"\s*[\[(/].*$", "", name).strip().lower()
    found = _SUFFIX.search(bare)
    return bare[: found.start()] if found and found[1] in _UNITS else bare


def _single(values: np.ndarray, name: str) -> float:
    if len(values) != 1:
        raise InputError(
            f"`period`={name!r} holds {len(values)} values; a sampling period is one "
            "number. For a column of times use `time`."
        )
    return float(values[0])


Column = ArrayLike | Sequence[float]


FIELDS = ("names", "units", "interpolation", "clocked", "past")
"""Arguments of a `Recording` beside its columns."""

_COLUMNS = ("input", "output", "time", "period", "time_unit")


class Past(eqx.Module):
    """What the input of a recording was before it.

    **Attributes:** `t`, times, s, and `u`, the input then; each of shape (p,).
    """

    t: Float[Array, " p"]
    u: Float[Array, " p"]


class Recording(Shown):
    """One recording of an input u(t) and an output w(t).

    A quasi-static recording, in which only the order of the rows is known, has no
    clock: `Recording(None, u, w)`. Its `t` is the number of the sample, a nominal time
    on which a rate-independent law gives what it gives on any other; so only
    rate-independent terms and models are tried on it.

    **Attributes:**

    - `t`: times, shape (n,), s, strictly increasing, evenly spaced or not; without a
        clock, numbers of samples: from 0, or of a window from its first row.
    - `u`: input, shape (n,), in `units[0]`.
    - `w`: output, shape (n,), in `units[1]`.
    - `names`: what the input and the output are.
    - `units`: their units.
    - `interpolation`: how the input runs between samples.
    - `past`: the input before the first sample, where it is known: windows keep what
        came before them, so that memory starts from what the device went through.
        `afresh` forgets it.
    - `clocked`: whether `t` was measured; `False` where it numbers the samples.
    """

    t: Float[Array, " n"]
    u: Float[Array, " n"]
    w: Float[Array, " n"]
    interpolation: AbstractInterpolation
    past: Past | None
    names: tuple[str, str] = eqx.field(static=True)
    units: tuple[str, str] = eqx.field(static=True)
    clocked: bool = eqx.field(static=True)

    def __init__(
        self,
        t: Column | Sequence[Any] | None,
        u: Column,
        w: Column,
        *,
        names: tuple[str, str] = ("input", "output"),
        units: tuple[str, str] = ("", ""),
        interpolation: AbstractInterpolation | None = None,
        clocked: bool | None = None,
        past: Past | None = None,
    ):
        """**Arguments:** as the attributes, but `t` may be `None`: there is no clock;
        or dates or durations (NumPy's, or Python's), which count from the first.
        `interpolation` defaults to `hystjax.interpolation.Linear()`, and `clocked` to
        whether `t` is given; `False` beside a `t` says that it numbers samples.

        **Raises:** `InputError` when the columns are not 1-D, differ in length, hold
        NaN or inf, have fewer than 3 rows, when `t` does not increase strictly, for
        `clocked=True` without `t`, and for a `clocked` or a `past` that is none.
        """
        self.u = checks.vector("u", u)
        self.w = checks.vector("w", w)
        self.clocked = whether_clocked(t, clocked)
        self.t = checks.vector("t", np.arange(len(self.u)) if t is None else seconds(t))
        if self.clocked:
            checks.warn_rounded_times(self.t)
        self.names = pair_of("names", names)
        self.units = pair_of("units", units)
        self.interpolation = Linear() if interpolation is None else interpolation
        self.past = past

    def __check_init__(self):
        check_columns(self.t, self.u, self.w)
        if not isinstance(self.interpolation, AbstractInterpolation):
            raise InputError(
                "`interpolation` must be one of `hystjax.interpolation`, such as "
                f"`interpolation.Cubic()`; got {self.interpolation!r}."
            )
        if not isinstance(self.past, Past | None):
            raise InputError(
                "`past` must be what a window keeps of the input before it, such as "
                f"`recording.window(100, 200).past`; got {checks.described(self.past)}."
            )
        if isinstance(self.interpolation, Exact):
            check_exact(self.interpolation, self.t, self.u)
        if isinstance(self.interpolation, BandLimited):
            between = "`interpolation.BandLimited`"
            otherwise = "or use `interpolation.Cubic()`"
            # Verbs make the path where they are compiled, and see no times there.
            checks.evenly_spaced(between, self.t, otherwise)
            checks.whole_periods(between, self.u, self.w, f", {otherwise}")

    def __len__(self) -> int:
        return self.t.shape[0]

    def _card(self) -> Card | None:
        title = f"Recording of {self.t.shape[-1]} samples"
        return samples_card(title, self, recorded=True)

    @property
    def path(self) -> AbstractInputPath:
        """The input between samples, and before them where it is known."""
        path = self.interpolation.path(self.t, self.u)
        if self.past is None:
            return path
        t, u = jnp.append(self.past.t, self.t[0]), jnp.append(self.past.u, self.u[0])
        between = self.interpolation if len(t) >= 4 else Linear()
        return changed(path, past=between.path(t, u))

    def afresh(self) -> "Recording":
        """The recording without what is known of the input before it: memory then
        starts from the first sample."""
        return self if self.past is None else changed(self, past=None)

    def window(self, start: int, stop: int) -> "Recording":
        """Rows `start` to `stop` (not included), counted from 0.

        **Raises:** `InputError` unless 0 <= start < stop <= n, both whole numbers.
        """
        start, stop = (whole_row(x) for x in (start, stop))
        check_window(start, stop, len(self))
        return self._rows(slice(start, stop))

    def between(self, start: float, stop: float) -> "Recording":
        """The samples with `start <= t < stop`, both in s.

        **Raises:** `InputError` when fewer than 3 samples lie there, without a clock,
        or for what is no number.
        """
        checks.concrete("`between`", self)
        if not self.clocked:
            raise InputError(
                f"`between({start}, {stop})` takes times, and this recording has no "
                "clock: its `t` only numbers the samples. Choose rows with `window`."
            )
        ends = jnp.array([checks.number("start", start), checks.number("stop", stop)])
        first, last = map(int, jnp.searchsorted(self.t, ends))
        held = last - first if start < stop else 0  # NaN too
        if held < 3:
            raise InputError(
                f"`between({start}, {stop})` holds {held} samples, and 3 are needed; "
                f"the recording runs from {moment(self.t[0])} s to "
                f"{moment(self.t[-1])} s."
            )
        return self._rows(slice(first, last))

    def split(self, fraction: float) -> tuple["Recording", "Recording"]:
        """The first `fraction` of the rows, and the rest.

        **Raises:** `InputError` unless both parts get at least 3 rows.
        """
        fraction = checks.share("fraction", fraction)
        row = round(fraction * len(self)) if 0 < fraction < 1 else 0
        if not 3 <= row <= len(self) - 3:
            raise InputError(
                f"`split({fraction})` of {len(self)} rows leaves a part with fewer "
                "than 3 rows."
            )
        return self._rows(slice(0, row)), self._rows(slice(row, len(self)))

    def resample(self, t: Column) -> "Recording":
        """The recording at other times, shape (m,), s; u by its path, w by straight
        lines. Without a clock, times are numbers of samples, whole or not.

        **Raises:** `InputError` when `t` reaches beyond the recording, and as
        `Recording` does.
        """
        times = checks.vector("t", t)
        checks.enough_samples("a recording", len(times), 3)
        unit = " s" if self.clocked else ""
        check_within("t", times, self.t, "the recording", unit)
        u, _ = self.path.at(times)
        w = jnp.interp(times, self.t, self.w)
        if is_concrete(times, self.t):
            past = self._before(int(jnp.searchsorted(self.t, times[0])))
        else:
            past = self._before_time(times[0])
        return self._with(times, u, w, self._elsewhere(), past)

    def averaged(self, count: int) -> "Recording":
        """Means of each `count` samples in turn, of times, input and output, for a
        record that has many more than its loops need: fits take `count` times less, and
        see through as much noise. Some 100 means from one turning point to the next are
        enough; fewer blunt the tips, and what is faster than `count` samples is lost.

        An input that is known between samples (`interpolation.Exact`, `BandLimited`) is
        taken where the means are. The input before the recording is averaged likewise.

        **Raises:** `InputError` for a count below 1, or fewer than 3 means. Warns of
        samples at the end that make no whole group, and are left out.
        """
        count = checks.count("count", count)
        if count == 1:
            return self
        groups, left_out = divmod(len(self), count)
        if groups < 3:
            raise InputError(
                f"`averaged({count})` of {len(self)} samples makes {groups} means, and "
                "3 are needed."
            )
        if left_out:
            warn(
                f"the last {left_out} of {len(self)} samples make no group of {count} "
                "and are left out."
            )
        t, u, w = (_means(x[: groups * count], count) for x in (self.t, self.u, self.w))
        between = self._elsewhere()
        if isinstance(between, Exact):
            u, _ = self.path.at(t)
        past = jax.tree.map(lambda x: _means(x, count), self.past)
        return self._with(t, u, w, between, past)

    def with_input(
        self, u: Column | AbstractExcitation | Callable[[Array], Array]
    ) -> "Recording":
        """The same recording with another input: an array, shape (n,), an excitation,
        or a smooth function of a scalar time, written in JAX, which then serves between
        samples too. What the old input was before the recording is left out."""
        if isinstance(u, AbstractExcitation):
            u.path(self.t)  # raises where samples miss a corner
            return self._with(self.t, jax.vmap(u)(self.t), self.w, u.interpolation)
        if callable(u):
            return self._with(self.t, _along(u, self.t), self.w, Exact(u))
        known = isinstance(self.interpolation, Exact)
        return self._with(self.t, u, self.w, Linear() if known else None)

    def _rows(self, rows: slice) -> "Recording":
        t, u, w = (checks.rows(x, rows) for x in (self.t, self.u, self.w))
        return self._with(t, u, w, self._elsewhere(), self._before(rows.start))

    def _before(self, row: int) -> Past | None:
        """The input before a row, its own past first."""
        if row == 0:
            return self.past
        rows = Past(*(checks.rows(x, slice(row)) for x in (self.t, self.u)))
        if self.past is None:
            return rows
        return jax.tree.map(lambda a, b: jnp.concatenate([a, b]), self.past, rows)

    def _before_time(self, time: Float[Array, ""]) -> Past:
        """The input before a time that is not known yet, as under `jit`: in as many
        rows as might be before it, of which those that are not are a rest where the
        input began, before all others."""
        every = self._before(len(self))
        assert every is not None  # of a recording that has rows
        count = len(every.t)
        late = count - jnp.searchsorted(every.t, time)
        row = jnp.arange(count)
        step = (every.t[-1] - every.t[0]) / (count - 1)
        resting = every.t[0] - (late - row) * step
        t, u = jnp.roll(every.t, late), jnp.roll(every.u, late)
        held = row < late
        return Past(jnp.where(held, resting, t), jnp.where(held, every.u[0], u))

    def _elsewhere(self) -> AbstractInterpolation:
        return self.interpolation.elsewhere(self.t, self.u)

    def _with(self, t, u, w, interpolation=None, past=None) -> "Recording":
        return Recording(
            t,
            u,
            w,
            names=self.names,
            units=self.units,
            interpolation=interpolation or self.interpolation,
            clocked=self.clocked,
            past=past,
        )

    @classmethod
    def from_csv(
        cls,
        path: str | os.PathLike,
        *,
        input: str | int,
        output: str | int,
        time: str | int | None = None,
        period: float | None = None,
        time_unit: str | None = None,
        rows: tuple[int | None, int | None] = (None, None),
        **fields: Any,
    ) -> "Recording":
        """Read columns of a file: text (comma, semicolon, tab or blank separated, with
        or without a header line and a row of units below it, with decimal points or
        commas), the first sheet of a spreadsheet, likewise, `.npy`, `.npz`, `.parquet`
        (with the index of a frame, as in `from_pandas`), or `.json`, of rows or of
        lists by name. All but spreadsheets and `.parquet` may be compressed by gzip,
        bzip2 or xz.

        **Arguments:**

        - `path`: the file.
        - `input`, `output`, `time`: columns, by header name or by number from 0. Times
            are numbers, dates such as `2026-01-31T12:00:00.020`, `31.1.2026 12:00:00`,
            `31.01.26` or `1/31/2026 12:00:00 PM`, or times of day such as
            `12:00:00.020`, which may pass midnight. Of an oscilloscope that numbers its
            samples, and gives their start and increment above, the numbers are times.
            Without `time` and `period` the recording has no clock.
        - `period`: sampling period, for files without a time column.
        - `time_unit`: of times and period: `s`, `ms`, `us`, `ns`, `min`, `h` or `d`.
            By default what the file states, in brackets, behind a slash or in a row of
            units, or else s.
        - `rows`: first and last (not included) data row, counted from 0 after the
            header; `None` for an end of the file.
        - `fields`: `names`, `units`, `interpolation` as for `Recording`; names default
            to the header's, units to those behind them in brackets or in a row below.

        **Raises:** `InputError` for a missing or unreadable file or column, a cell
        that is not a number (the message gives its line), and as `Recording` does.
        Warns of a column such as `time_ms`, or in a unit that is not known, that is
        read as seconds.
        """
        checks.keywords("Recording.from_csv", fields, (*_COLUMNS, "rows", *FIELDS))
        table = read_table(path, rows)
        return cls._of(table, input, output, time, period, time_unit, fields)

    @classmethod
    def from_pandas(
        cls,
        frame: Any,
        *,
        input: str | int,
        output: str | int,
        time: str | int | None = None,
        period: float | None = None,
        time_unit: str | None = None,
        rows: tuple[int | None, int | None] = (None, None),
        **fields: Any,
    ) -> "Recording":
        """Take columns of a data frame of pandas or polars, or of a table of pyarrow.

        **Arguments:** the frame; others as of `from_csv`. `time` may be the name of its
        index; without it and `period`, an index of dates or durations is the time.
        Periods of pandas are the dates on which they begin.

        **Raises:** as `from_csv`.
        """
        checks.keywords("Recording.from_pandas", fields, (*_COLUMNS, "rows", *FIELDS))
        table = frame_table(frame, rows)
        return cls._of(table, input, output, time, period, time_unit, fields)

    @classmethod
    def _of(cls, table, input, output, time, period, time_unit, fields) -> "Recording":
        u, w = table.column("input", input), table.column("output", output)
        if period is None and isinstance(table, FrameTable):
            table, time = table.timed(time)
        t = times(table, time, period, time_unit, len(u))
        pairs = named(table, input, "input"), named(table, output, "output")
        names, units = zip(*pairs, strict=True)
        return cls(t, u, w, **{"names": names, "units": units, **fields})

    @classmethod
    def from_mat(
        cls,
        path: str | os.PathLike,
        *,
        input: str | tuple[str, int],
        output: str | tuple[str, int],
        time: str | tuple[str, int] | None = None,
        period: float | str | None = None,
        time_unit: str | None = None,
        **fields: Any,
    ) -> "Recording":
        """Read variables of a MATLAB file (version 7.2 or older).

        **Arguments:**

        - `path`: the file.
        - `input`, `output`, `time`: a variable that is a vector, or a pair of a matrix
            and the number of its column from 0.
        - `period`: sampling period, or the name of the variable that holds it.
        - `time_unit`: of times and period, s by default; as in `from_csv`.
        - `fields`: `names`, `units`, `interpolation` as for `Recording`; names default
            to those of vectors.

        **Raises:** as `from_csv`.
        """
        checks.keywords("Recording.from_mat", fields, (*_COLUMNS, *FIELDS))
        table = read_mat(path)
        return cls._of(table, input, output, time, period, time_unit, fields)


def _means(x: Float[Array, " n"], count: int) -> Float[Array, " m"]:
    """Of so many in turn; of the first, where they make no whole group."""
    first = len(x) % count
    means = jnp.mean(x[first:].reshape(-1, count), axis=1)
    return jnp.concatenate([jnp.mean(x[:first])[None], means]) if first else means


def named(table: Any, key: Any, default: str) -> tuple[str, str]:
    """Name and unit of a column: where it is known for one, what is in brackets behind
    the name."""
    title, row_unit = table.title(key, default), table.row_unit(key)
    bare, unit = without_unit(title)
    if row_unit or not bare or not is_unit(unit):
        return title, row_unit
    return bare, unit
