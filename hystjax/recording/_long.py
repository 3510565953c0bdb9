"""Recordings that do not fit into memory."""

import os
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np

from .._core import checks
from .._core.checks import InputError, described
from .._core.files import path_of
from .._core.show import Card, with_unit
from ._formats import parquet_table
from ._recording import Recording, check_window, named, pair_of, scale_of, stated


@runtime_checkable
class Column(Protocol):
    """What a column must offer: a shape, and rows by slices. Arrays, memory maps, and
    those of Zarr and HDF5 do."""

    @property
    def shape(self) -> tuple[int, ...]:
        """One length."""
        ...

    def __getitem__(self, rows: slice, /) -> Any:
        """Some rows, as an array."""
        ...


_FIELDS = ("chunk", "names", "units")


@dataclass(frozen=True, repr=False)
class LongRecording:
    """A recording whose columns stay on disk, and are read `chunk` samples at a time.

    For `hystjax.identify`; `window` makes a `Recording` of some rows for the other
    verbs.

    **Attributes:**

    - `t`, `u`, `w`: as of a `Recording`, each a column of n samples that can be sliced.
    - `chunk`: samples in memory at a time.
    - `names`, `units`: of input and output.
    """

    t: Column
    u: Column
    w: Column
    chunk: int = 2**20
    names: tuple[str, str] = ("input", "output")
    units: tuple[str, str] = ("", "")

    def __post_init__(self):
        """**Raises:** `InputError` for what is no column, for columns that are not 1-D
        or differ in length, for a `chunk` that is no whole number of 3 or more, and for
        names or units that are no pair."""
        columns = {name: getattr(self, name) for name in ("t", "u", "w")}
        for name, column in columns.items():
            if not isinstance(column, Column):
                raise InputError(
                    f"`{name}` must be a column that has a shape and can be sliced, "
                    f"such as an array or a memory map, got {described(column)}."
                )
        shapes = {name: tuple(column.shape) for name, column in columns.items()}
        if len(set(shapes.values())) > 1 or len(shapes["t"]) != 1:
            raise InputError(
                f"`t`, `u` and `w` must be columns of the same length, got {shapes}."
            )
        checks.count("chunk", self.chunk, 3)
        for name in ("names", "units"):
            object.__setattr__(self, name, pair_of(name, getattr(self, name)))

    @classmethod
    def from_npy(
        cls,
        *,
        t: str | os.PathLike,
        u: str | os.PathLike,
        w: str | os.PathLike,
        **fields: Any,
    ) -> "LongRecording":
        """Columns in files of NumPy's own format, one each.

        **Arguments:** the files; and `chunk`, `names`, `units`.

        **Raises:** `InputError` for a file that is missing or no such array.
        """
        checks.keywords("LongRecording.from_npy", fields, ("t", "u", "w", *_FIELDS))
        return cls(_NpyColumn(t), _NpyColumn(u), _NpyColumn(w), **fields)

    @classmethod
    def from_parquet(
        cls,
        path: str | os.PathLike,
        *,
        t: str,
        u: str,
        w: str,
        time_unit: str | None = None,
        **fields: Any,
    ) -> "LongRecording":
        """Columns of a Parquet file, of which a row group at least is in memory at a
        time. Needs pyarrow (`pip install hystjax[parquet]`).

        **Arguments:** the file; its columns of time, input and output, and `time_unit`,
        as of `Recording.from_csv`; and `chunk`, `names` and `units`, by default those
        of the columns.

        **Raises:** `InputError` without pyarrow, for a file that is missing or not
        Parquet, or a column that is not there or not of numbers. Warns as `from_csv`
        does of times that are read as seconds.
        """
        known = ("t", "u", "w", "time_unit", *_FIELDS)
        checks.keywords("LongRecording.from_parquet", fields, known)
        table = parquet_table(path_of(path))
        keys = {"t": t, "u": u, "w": w}
        columns = {name: table.entry(name, key) for name, key in keys.items()}
        scale = stated(table, t) if time_unit is None else scale_of(time_unit)
        names, units = zip(named(table, u, "u"), named(table, w, "w"), strict=True)
        return cls(
            columns["t"].numbers("t", scale),
            columns["u"].numbers("u"),
            columns["w"].numbers("w"),
            **{"names": names, "units": units, **fields},
        )

    def __len__(self) -> int:
        return self.t.shape[0]

    def __repr__(self) -> str:
        # Without what is in the columns, which may be much to read.
        labels = [with_unit(*pair) for pair in zip(self.names, self.units, strict=True)]
        facts = ("u, w", ", ".join(labels)), ("chunk", f"{self.chunk} samples")
        return Card(f"LongRecording of {len(self)} samples", facts).text()

    def window(self, start: int, stop: int) -> Recording:
        """Rows `start` to `stop` (not included), read into memory; without what the
        input did before, which a window of a `Recording` keeps.

        **Raises:** `InputError` unless 0 <= start < stop <= n, or for rows that make no
        `Recording`.
        """
        start, stop = checks.whole("start", start), checks.whole("stop", stop)
        check_window(start, stop, len(self))
        columns = (column[start:stop] for column in (self.t, self.u, self.w))
        return Recording(*columns, names=self.names, units=self.units)

    def read(self, start: int, stop: int) -> Sequence[np.ndarray]:
        """t, u and w of some rows; what is masked is NaN.

        **Raises:** `InputError` for a column that is not of real numbers, such as one
        of dates.
        """
        return [_numbers(name, getattr(self, name)[start:stop]) for name in "tuw"]


def _numbers(name: str, rows: Any) -> np.ndarray:
    rows = np.asarray(checks.unmasked(rows))
    if rows.dtype.kind not in "biuf":
        raise InputError(
            f"`{name}` of a `LongRecording` must be a column of real numbers, got one "
            f"of {rows.dtype}: give times as seconds from the first, and of a complex "
            "signal its real part."
        )
    return rows


class _NpyColumn:
    """A file that is mapped only while rows are copied out of it: pages of a map that
    stays open count as memory of the process."""

    def __init__(self, path: str | os.PathLike):
        self._path = path_of(path)
        self.shape = self._mapped().shape

    def __getitem__(self, rows: slice) -> np.ndarray:
        return np.array(self._mapped()[rows])

    def _mapped(self) -> np.ndarray:
        try:
            return np.load(self._path, mmap_mode="r")
        except (OSError, ValueError) as error:
            raise InputError(f"{self._path} cannot be read: {error}.") from None
