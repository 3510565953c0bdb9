"""Tables that are not text: data frames, arrays, and files of either."""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from .._core.errors import InputError
from ._columns import chosen_rows, place, unit_in
from ._text import TextTable, read_text

Rows = tuple[int | None, int | None]

_EXCEL = (".xlsx", ".xlsm", ".xls", ".ods")


@dataclass(frozen=True)
class FrameTable:
    """Columns of numbers or dates in memory.

    **Attributes:** `source`, what messages call it; the `names` of its columns, if they
    have some; and the `columns`, arrays of one length.
    """

    source: str
    names: tuple[str, ...]
    columns: Sequence[np.ndarray]

    def column(self, argument: str, key: str | int) -> np.ndarray:
        """The column `key`, as float64; as that of a `TextTable`."""
        values = self._values(argument, key)
        try:
            return values.astype(np.float64)
        except (TypeError, ValueError) as error:
            raise InputError(
                f"`{argument}`={key!r} of {self.source} is no column of numbers "
                f"({error})."
            ) from None

    def moments(self, argument: str, key: str | int) -> np.ndarray:
        """The column `key` as numbers, or as dates or durations of NumPy."""
        values = self._values(argument, key)
        if values.dtype == object or values.dtype.kind == "U":
            try:
                return values.astype("datetime64[ns]")
            except (TypeError, ValueError):
                pass
        kept = values.dtype.kind in "mM"
        return values if kept else self.column(argument, key)

    def title(self, key: str | int, default: str) -> str:
        """The name of the column `key`, or else `default`."""
        return (self.names[self._place("key", key)] if self.names else "") or default

    def unit_of(self, key: str | int) -> str:
        """The unit in brackets behind the name of a column, or nothing."""
        return unit_in(self.title(key, ""))

    def row_unit(self, key: str | int) -> str:
        """None: there is no row of units."""
        return ""

    def with_column(self, name: str, column: np.ndarray) -> "FrameTable":
        """The table with one more column, in the place of one of that name."""
        kept = {n: x for n, x in zip(self.names, self.columns, strict=True)} | {
            name: column
        }
        return FrameTable(self.source, tuple(kept), list(kept.values()))

    def _values(self, argument: str, key: str | int) -> np.ndarray:
        return np.asarray(self.columns[self._place(argument, key)])

    def _place(self, argument: str, key: str | int) -> int:
        return place(self.source, self.names, len(self.columns), argument, key)


def frame_table(frame: Any, rows: Rows = (None, None), source: str = "") -> FrameTable:
    """The columns of a data frame of pandas or polars, or of anything with `columns`
    whose entries can be had by name.

    **Raises:** `InputError` for something else.
    """
    if not hasattr(frame, "columns") or not hasattr(frame, "__getitem__"):
        raise InputError(
            f"`frame` must be a data frame of pandas or polars, got "
            f"{type(frame).__name__}; `Recording.from_csv` reads files."
        )
    source = source or "the frame"
    first, last = chosen_rows(source, len(frame), rows)
    columns = [np.asarray(frame[name])[first:last] for name in frame.columns]
    return FrameTable(source, tuple(map(str, frame.columns)), columns)


def dates_of(frame: Any) -> np.ndarray | None:
    """The index of a data frame, where it holds dates or durations."""
    index = getattr(frame, "index", None)
    dated = getattr(getattr(index, "dtype", None), "kind", "") in ("m", "M")
    return np.asarray(index) if dated else None


def read_table(path: str | os.PathLike, rows: Rows) -> TextTable | FrameTable:
    """A file of columns by what its name ends in: `.npy`, `.npz`, `.parquet` and
    spreadsheets, or else text.

    **Raises:** `InputError` for a file that cannot be read so.
    """
    path = Path(path)
    ending = path.suffix.lower()
    if ending in (".npy", ".npz"):
        return _arrays(path, rows)
    if ending in (".parquet", ".pq", *_EXCEL):
        return _by_pandas(path, rows, "read_excel" if ending in _EXCEL else "")
    return read_text(path, rows=rows)


def _arrays(path: Path, rows: Rows) -> FrameTable:
    try:
        held = np.load(path, allow_pickle=False)
        if isinstance(held, Mapping):
            names, columns = tuple(held), [held[name] for name in held]
        elif held.dtype.names:
            names = held.dtype.names
            columns = [held[name] for name in names]
        else:
            names, columns = (), list(np.atleast_2d(held.T))
    except (OSError, ValueError, EOFError) as error:
        raise InputError(f"{path} cannot be read: {error}.") from None
    if any(
        np.ndim(column) != 1 or len(column) != len(columns[0]) for column in columns
    ):
        shapes = ", ".join(str(np.shape(column)) for column in columns)
        raise InputError(
            f"{path} must hold columns of one length, or one array of a row a sample; "
            f"its arrays have the shapes {sorted(shapes)}."
        )
    first, last = chosen_rows(path, len(columns[0]), rows)
    return FrameTable(str(path), names, [column[first:last] for column in columns])


def _by_pandas(path: Path, rows: Rows, reader: str) -> FrameTable:
    import pandas  # comes with xarray, and takes its time to import

    try:
        frame = getattr(pandas, reader or "read_parquet")(path)
    except FileNotFoundError:
        raise InputError(
            f"there is no file {path} (looked from {Path.cwd()}); check the path."
        ) from None
    except ImportError as error:
        raise InputError(
            f"{path} is read by pandas, which lacks something for it: {error}"
        ) from None
    except Exception as error:  # engines raise almost anything on a broken file
        raise InputError(f"{path} cannot be read: {error}.") from None
    return frame_table(frame, rows, str(path))
