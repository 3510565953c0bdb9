"""Columns of JSON, MATLAB, MicroMag and Parquet files, of data frames and of arrays;
and reversal curves in files of magnetometers, with their units."""

import contextlib
import datetime
import io
import json
import operator
import os
import re
import zipfile
import zlib
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from .._core.checks import InputError, nearest, unmasked, warn
from .._core.files import each_key_once, path_of
from . import _text
from ._notation import is_moment, moments_in, moments_of, tells_time
from ._text import (
    TextTable,
    chosen_rows,
    place,
    read_text,
    text_table,
    without_unit,
)


def json_matrix(path: Path, name: str) -> np.ndarray:
    """The list of rows under `name` in a JSON file, as float64, shape (n, m).

    **Raises:** `InputError` when there is no such file or name, the file is not JSON,
    or the rows differ in length or hold something else than numbers.
    """
    read = _parsed(path)
    if not isinstance(read, dict) or name not in read:
        names = ", ".join(read) if isinstance(read, dict) and read else "(none)"
        raise InputError(f"{name!r} is not in {path}; its names: {names}.")
    try:
        matrix = np.array(read[name], np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(
            f"{name!r} of {path} is not a matrix of numbers ({error}). Its rows may "
            "differ in length, or hold text; correct or remove them."
        ) from None
    if matrix.ndim != 2:
        raise InputError(
            f"{name!r} of {path} must be a list of rows of numbers, got shape "
            f"{matrix.shape}."
        )
    return matrix


def _parsed(path: Path) -> Any:
    try:
        return json.loads(_text.content(path), object_pairs_hook=each_key_once)
    except (ValueError, RecursionError) as error:  # of the syntax, or of the encoding
        raise InputError(
            f"{path} cannot be read as JSON ({error}). It may be cut short or of "
            "another format."
        ) from None


@dataclass(frozen=True)
class MatTable:
    """The variables of a MATLAB file.

    **Attributes:**

    - `path`: the file.
    - `variables`: values by name.
    """

    path: Path
    variables: Mapping[str, Any]

    @property
    def names(self) -> tuple[str, ...]:
        """Those of the variables."""
        return tuple(self.variables)

    def column(self, argument: str, key: str | tuple[str, int]) -> np.ndarray:
        """The vector `key`, or a column of a matrix, as float64, shape (n,).

        **Arguments:**

        - `argument`: the caller's name for the column, for messages.
        - `key`: a variable that is a vector, or a pair of a matrix and the number of
            its column from 0.

        **Raises:** `InputError` when there is no such variable or column, or it holds
        something else than real numbers.
        """
        name, number = _variable_and_column(argument, key)
        said = f"`{argument}`={key!r}"
        matrix = self._matrix(said, name)
        if number is None and min(matrix.shape) > 1:
            raise InputError(
                f"{said} is a matrix of shape {matrix.shape}; give its column too, "
                f"such as {argument}=({name!r}, 0)."
            )
        if number is None:
            return matrix.ravel()
        if not 0 <= number < matrix.shape[1]:
            raise InputError(
                f"{said} is not in {self.path}: {name!r} has shape {matrix.shape}, so "
                f"its columns are numbered from 0 to {matrix.shape[1] - 1}."
            )
        return matrix[:, number]

    def moments(self, argument: str, key: str | tuple[str, int]) -> np.ndarray:
        """Times: a column of numbers."""
        return self.column(argument, key)

    def title(self, key: str | tuple[str, int], default: str) -> str:
        """The name of a vector; that of a matrix, which says nothing of its columns,
        where there is no `default`."""
        return key if isinstance(key, str) else default or key[0]

    def unit_of(self, key: str | tuple[str, int]) -> str:
        """None: variables have no units."""
        return ""

    def row_unit(self, key: str | tuple[str, int]) -> str:
        """None, likewise."""
        return ""

    def _matrix(self, said: str, name: str) -> np.ndarray:
        if name not in self.variables:
            listed = ", ".join(self.variables) or "(none)"
            near = nearest(name, self.variables)
            raise InputError(
                f"{said} is not in {self.path}. {near}Its variables: {listed}."
            )
        value = self.variables[name]
        is_array = isinstance(value, np.ndarray)
        if not is_array or value.dtype.kind not in "fiub" or value.ndim != 2:
            kind = value.dtype if is_array else type(value).__name__
            raise InputError(
                f"{said} of {self.path} is not a vector or matrix of real numbers: it "
                f"is of type {kind} and shape {np.shape(value)}. Save it as one."
            )
        return value.astype(np.float64)


def _variable_and_column(argument: str, key: Any) -> tuple[str, int | None]:
    if isinstance(key, str):
        return key, None
    if isinstance(key, tuple | list) and len(key) == 2 and isinstance(key[0], str):
        with contextlib.suppress(TypeError):
            return key[0], operator.index(key[1])
    raise InputError(
        f"`{argument}` must be the name of a vector, or a pair of that of a matrix and "
        f"a number of its columns, such as ('M', 0); got {key!r}."
    )


def read_mat(path: str | os.PathLike) -> MatTable:
    """Read the variables of a MATLAB file, version 7.2 or older; those in a structure
    by the names that they have in MATLAB, `structure.field`.

    **Raises:** `InputError` when there is no such file, or it is empty, broken, or of
    version 7.3.
    """
    import scipy.io  # slow to import, and rarely needed

    path = path_of(path)
    content = _text.content(path)
    if content.startswith((b"MATLAB 7.3", b"\x89HDF")):
        raise InputError(
            f"{path} is a MATLAB 7.3 (HDF5) file, which hystjax does not read. In "
            "MATLAB, save it again with `save(file, '-v7')`."
        )
    try:
        loaded = scipy.io.loadmat(io.BytesIO(content))
    except Exception as error:  # SciPy raises almost anything on a broken file
        raise InputError(
            f"{path} cannot be read as a MATLAB file ({error}). It may be cut short or "
            "of another format; for text use `Recording.from_csv`."
        ) from None
    own = {k: v for k, v in loaded.items() if not k.startswith("__")}
    return MatTable(path, dict(_out_of_structures(own)))


def _out_of_structures(variables: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    for name, value in variables.items():
        fields = getattr(value, "dtype", np.dtype(float)).names
        if fields is None or value.size != 1:
            yield name, value
            continue
        inside = {
            f"{name}.{field}": np.asarray(value[field].item()) for field in fields
        }
        yield from _out_of_structures(inside)


_ROW = re.compile(r"[-+][\d.]+(?:E[-+]\d+)?(?:,[-+][\d.]+(?:E[-+]\d+)?)+")
_COUNT = re.compile(r"^Number of data +(\d+) *$", re.MULTILINE)


def micromag_segments(path: Path) -> list[np.ndarray]:
    """Field and moment of each segment, float64, shape (k, 2), in the file's order and
    units. Segments are runs of rows between blank lines, below the file's header.

    **Raises:** `InputError` when there is no such file, no row in it, or not as many as
    its header says.
    """
    text = _text.text(path)
    segments, open_segment = [], False
    for line in text.split("\n"):
        is_row = _ROW.fullmatch(line.strip()) is not None
        if is_row and not open_segment:
            segments.append([])
        if is_row:
            segments[-1].append([float(cell) for cell in line.split(",")[:2]])
        open_segment = is_row
    found, said = sum(map(len, segments)), _COUNT.search(text)
    if found == 0 or said is None or found != int(said[1]):
        promised = "none promised" if said is None else f"{said[1]} promised"
        raise InputError(
            f"{path} holds {found} rows of field and moment, with {promised} by its "
            "header (`Number of data`). It may be cut short or of another format."
        )
    return [np.array(segment) for segment in segments]


def parquet_table(path: Path) -> "FrameTable":
    """The names of a Parquet file's columns, which are each read by slices.

    **Raises:** `InputError` without pyarrow, and for a file that is missing or not
    Parquet.
    """
    pyarrow = _pyarrow()
    try:
        file = pyarrow.parquet.ParquetFile(path)
    except (OSError, pyarrow.ArrowInvalid) as error:
        raise InputError(_unread(path, error)) from None
    fields = list(file.schema_arrow)
    columns = [ParquetColumn(file, place) for place in range(len(fields))]
    return FrameTable(str(path), tuple(field.name for field in fields), columns)


class ParquetColumn:
    """A column, of which rows are read by slices; of numbers, and these times a
    `scale`."""

    def __init__(self, file: Any, place: int, scale: float = 1.0):
        metadata, names = file.metadata, file.schema_arrow.names
        groups = [metadata.row_group(i).num_rows for i in range(file.num_row_groups)]
        self._file, self._place, self._scale = file, place, scale
        self._field = file.schema_arrow.field(place)
        # Of the columns of its name, which are read together.
        self._among = names[:place].count(names[place])
        self._ends = np.cumsum(groups)  # of the row groups
        self.shape = (metadata.num_rows,)

    def numbers(self, argument: str, scale: float = 1.0) -> "ParquetColumn":
        """The column times a scale; raises `InputError` for one of something else."""
        types, field = _pyarrow().types, self._field
        if not (types.is_integer(field.type) or types.is_floating(field.type)):
            raise InputError(
                f"`{argument}`: column `{field.name}` holds {field.type}, not numbers."
            )
        return ParquetColumn(self._file, self._place, scale)

    def __getitem__(self, rows: slice) -> np.ndarray:
        start, stop, step = rows.indices(self.shape[0])
        first, last = np.searchsorted(self._ends, [start, stop - 1], side="right")
        read = self._file.read_row_groups(
            range(first, last + 1), columns=[self._field.name], use_threads=False
        )
        skipped = int(self._ends[first - 1]) if first else 0
        column = read.column(self._among).to_numpy()
        column = column[start - skipped : stop - skipped : step]
        return column if self._scale == 1 else self._scale * column


def _pyarrow() -> Any:
    try:
        import pyarrow
        import pyarrow.parquet
    except ImportError:
        raise InputError(
            "Parquet files are read by pyarrow, which is not installed; get it with "
            "`pip install hystjax[parquet]`."
        ) from None
    return pyarrow


Rows = tuple[int | None, int | None]


def _unread(path: Path, error: Exception) -> str:
    return f"{path} cannot be read: {str(error).rstrip('.')}."


_EXCEL = (".xlsx", ".xlsm", ".xls", ".ods")


@dataclass(frozen=True)
class FrameTable:
    """Columns of numbers or dates in memory.

    **Attributes:** `source`, what messages call it; the `names` of its columns, if they
    have some; the `columns`, of which those that are asked for must be 1-D arrays; the
    `rows` that are wanted of these, as of `read_text`; and the `index` of a data frame.
    """

    source: str
    names: tuple[str, ...]
    columns: Sequence[Any]
    rows: Rows = (None, None)
    index: Any = ()

    def column(self, argument: str, key: str | int) -> np.ndarray:
        """The column `key`, as float64; as that of a `TextTable`."""
        values = self._values(argument, key)
        if values.dtype.kind in "cmM":
            raise InputError(
                f"`{argument}`={key!r} of {self.source} is no column of real numbers: "
                f"it is of type {values.dtype}."
            )
        try:
            if any(isinstance(x, str) and "_" in x for x in values.tolist()):
                raise ValueError("digits with _ between them")
            return values.astype(np.float64)
        except (TypeError, ValueError, OverflowError) as error:
            raise InputError(
                f"`{argument}`={key!r} of {self.source} is no column of numbers "
                f"({error})."
            ) from None

    def moments(self, argument: str, key: str | int) -> np.ndarray:
        """The column `key` as numbers, or as dates or durations of NumPy."""
        values = self._values(argument, key)
        if values.dtype.kind in "mM":
            return values
        if values.dtype.kind in "biuf":
            return self.column(argument, key)
        # Cells of a spreadsheet that show a time of day hold one.
        cells = [str(x) if isinstance(x, datetime.time) else x for x in values]
        first = cells[0] if cells else None
        if not tells_time(first) and not is_moment(first):
            return self.column(argument, key)
        try:
            if is_moment(first):
                return moments_of(cells)
            # Something else among them is missing, as NaN of pandas is.
            return moments_in([x if isinstance(x, str) else "" for x in cells])
        except ValueError as error:
            raise InputError(
                f"`{argument}`={key!r} of {self.source} holds dates or times that "
                f"cannot be read: {error}."
            ) from None

    def title(self, key: str | int, default: str) -> str:
        """The name of the column `key`, or else `default`."""
        return (self.names[self._place("key", key)] if self.names else "") or default

    def unit_of(self, key: str | int) -> str:
        """The unit in brackets behind the name of a column, or nothing."""
        return without_unit(self.title(key, ""))[1]

    def row_unit(self, key: str | int) -> str:
        """None: there is no row of units."""
        return ""

    def entry(self, argument: str, key: str | int) -> Any:
        """The column `key` as it is."""
        return self.columns[self._place(argument, key)]

    def timed(self, time: Any) -> tuple["FrameTable", Any]:
        """The table and its column of times; which the index is by its name, as others
        are by theirs, or where it holds dates or durations and no column is asked for.
        """
        name = getattr(self.index, "name", None)
        if time is None and is_moment(next(iter(self.index), None)):
            return self._with_index(""), len(self.columns)
        if isinstance(time, str) and isinstance(name, str) and name not in self.names:
            return self._with_index(name), time
        return self, time

    def _with_index(self, name: str) -> "FrameTable":
        """The table with the index as a last column, of that name."""
        names, columns = (*self.names, name), [*self.columns, as_array(self.index)]
        return FrameTable(self.source, names, columns, self.rows)

    def _values(self, argument: str, key: str | int) -> np.ndarray:
        values = np.asarray(self.entry(argument, key))
        if values.ndim != 1:
            raise InputError(
                f"`{argument}`={key!r} of {self.source} is an array of shape "
                f"{values.shape}; a column has one dimension, and a value a sample."
            )
        return values[slice(*chosen_rows(self.source, len(values), self.rows))]

    def _place(self, argument: str, key: str | int) -> int:
        found = place(self.source, self.names, len(self.columns), argument, key)
        # To pandas a number is a name.
        if str(key) in self.names and self.names[found] != str(key):
            raise InputError(
                f"`{argument}`={key!r} is the number of column {self.names[found]!r} "
                f"of {self.source}, and the name of another one. Give a name, as text: "
                f"{self.names[found]!r} or {str(key)!r}."
            )
        return found


def frame_table(frame: Any, rows: Rows, source: str = "the frame") -> FrameTable:
    """The columns of a data frame of pandas or polars, of a table of pyarrow, or of
    anything else whose names of columns are its `columns`, and its entries by these.

    **Raises:** `InputError` for something else.
    """
    if not hasattr(frame, "columns") or not hasattr(frame, "__getitem__"):
        raise InputError(
            "`frame` must be a data frame of pandas or polars, or a table of pyarrow, "
            f"got {type(frame).__name__}; `Recording.from_csv` reads files."
        )
    pairs = [(str(name), as_array(column)) for name, column in _by_name(frame)]
    names, columns = tuple(name for name, _ in pairs), [column for _, column in pairs]
    return FrameTable(source, names, columns, rows, getattr(frame, "index", ()))


def _by_name(frame: Any) -> Iterable[tuple[Any, Any]]:
    """Names and columns; in pandas and pyarrow a name may come twice."""
    if hasattr(frame, "column_names"):  # pyarrow
        return zip(frame.column_names, frame.columns, strict=True)
    if hasattr(frame, "items"):  # pandas
        return frame.items()
    return ((name, frame[name]) for name in frame.columns)


def as_array(column: Any) -> np.ndarray:
    """A column of a frame, in UTC where it has a time zone."""
    dtype: Any = getattr(column, "dtype", None)
    zoned = getattr(dtype, "tz", None) is not None
    return np.asarray(unmasked(column), f"M8[{dtype.unit}]" if zoned else None)


def read_table(path: str | os.PathLike, rows: Rows) -> TextTable | FrameTable:
    """A file of columns by what its name ends in: `.npy`, `.npz`, `.parquet`, `.json`
    and spreadsheets, or else text.

    **Raises:** `InputError` for a file that cannot be read so.
    """
    path = path_of(path)
    packed = path.suffix.lower() in _text.PACKERS
    ending = (path.with_suffix("") if packed else path).suffix.lower()
    if ending in (".npy", ".npz"):
        return _arrays(path, rows)
    if ending in (".parquet", ".pq"):
        return frame_table(_by_pandas(path, "read_parquet"), rows, str(path))
    if ending in _EXCEL:
        return _sheet(path, rows)
    if ending == ".json":
        return _json_table(path, rows)
    return read_text(path, rows=rows)


def _json_table(path: Path, rows: Rows) -> FrameTable:
    """Lists of numbers by name, or rows: lists or objects, alone or, beside whatever
    else is told, as the only ones under a name, with names of columns as pandas splits
    a frame."""
    read, names = _parsed(path), ()
    under = _rows_under_a_name(read) if isinstance(read, dict) else None
    if under is not None:
        read, names = under, read.get("columns") or ()
    if isinstance(read, dict):
        names = [name for name, x in read.items() if isinstance(x, list)]
        columns = [read[name] for name in names]
    elif not (isinstance(read, list) and _are_rows(read)):
        columns = []
    elif isinstance(read[0], dict):
        names = list(dict.fromkeys(name for row in read for name in row))
        columns = [[row.get(name) for row in read] for name in names]
    else:
        columns = list(zip(*read, strict=True))
    if not columns:
        raise InputError(
            f"{path} holds no table: neither rows, as lists of as many numbers each or "
            "objects, nor lists by name."
        )
    names = tuple(map(str, names)) if len(names) == len(columns) else ()
    return FrameTable(str(path), names, columns, rows)


def _rows_under_a_name(read: dict) -> list | None:
    """The only rows; but where at least as many numbers stand in each of two lists,
    these are the samples, and the rows such as of a calibration."""
    lists = [x for x in read.values() if isinstance(x, list)]
    under = [x for x in lists if _are_rows(x)]
    lengths = Counter(len(x) for x in lists if _are_numbers(x))
    samples = max((n for n, columns in lengths.items() if columns > 1), default=0)
    return under[0] if len(under) == 1 and len(under[0]) > samples else None


def _are_numbers(read: list) -> bool:
    """Whether all are, or missing."""
    return all(x is None or isinstance(x, int | float) for x in read)


def _are_rows(read: list) -> bool:
    """Whether all are objects, or lists of one length."""
    kinds = {type(x) for x in read}
    return kinds == {dict} or (kinds == {list} and len(set(map(len, read))) == 1)


@contextlib.contextmanager
def _reading(path: Path):
    """`InputError` for what NumPy raises on a broken file."""
    try:
        yield
    except (OSError, ValueError, EOFError, zipfile.BadZipFile, zlib.error) as error:
        raise InputError(
            f"{_unread(path, error)} It may be cut short or of another format."
        ) from None


def _arrays(path: Path, rows: Rows) -> FrameTable:
    content = io.BytesIO(_text.content(path))
    with _reading(path):
        held = np.load(content, allow_pickle=False)
    if isinstance(held, Mapping):
        names, columns = tuple(held), _Members(path, held)
    elif held.dtype.names:
        names = held.dtype.names
        columns = [held[name] for name in names]
    else:
        names, columns = (), list(np.atleast_2d(held.T))
        if held.ndim == 2 and len(held) < len(columns):
            warn(
                f"{path} holds an array of shape {held.shape}, which was read as "
                f"{len(columns)} columns of {len(held)} samples; if its rows are the "
                "columns, save its transpose.",
            )
    if not len(columns):
        raise InputError(f"{path} holds no arrays.")
    return FrameTable(str(path), names, columns, rows)


class _Members(Sequence[Any]):
    """The arrays of a `.npz` file, each read when it is asked for: others may be of any
    kind."""

    def __init__(self, path: Path, held: Mapping[str, np.ndarray]):
        self._path, self._held, self._names = path, held, tuple(held)

    def __len__(self) -> int:
        return len(self._names)

    def __getitem__(self, number):
        with _reading(self._path):
            return self._held[self._names[number]]


def _sheet(path: Path, rows: Rows) -> TextTable:
    """The first sheet of a spreadsheet, read as text is: people write titles above a
    table, units below its names, or neither. Warns of others that hold something."""
    how = {"sheet_name": None, "header": None, "dtype": object, "na_filter": False}
    (first, cells), *others = _by_pandas(path, "read_excel", **how).items()
    filled = [str(name) for name, sheet in others if sheet.size]
    if filled:
        warn(
            f"of the sheets in {path} the first, {str(first)!r}, was read; "
            f"{', '.join(map(repr, filled))} was not. Save it as a file of its own.",
        )
    lines = ["\t".join(map(_in_text, row)) for row in cells.to_numpy()]
    return text_table(path, "\n".join(lines), rows, "\t")


def _in_text(cell: Any) -> str:
    """A cell as text of one line without tabs; a duration as hours that have passed."""
    if isinstance(cell, datetime.timedelta):
        whole, part = divmod(cell, datetime.timedelta(seconds=1))
        minutes, seconds = divmod(whole, 60)
        return f"{minutes // 60}:{minutes % 60:02}:{seconds:02}.{part.microseconds:06}"
    return " ".join(str(cell).split())


def _by_pandas(path: Path, reader: str, **how: Any) -> Any:
    """A file as a data frame."""
    import pandas  # comes with xarray, and takes its time to import

    try:
        return getattr(pandas, reader)(path, **how)
    except FileNotFoundError:
        raise InputError(
            f"there is no file {path} (looked from {Path.cwd()}); check the path."
        ) from None
    except ImportError as error:
        raise InputError(
            f"{path} is read by pandas, which lacks something for it: {error}"
        ) from None
    except Exception as error:  # engines raise almost anything on a broken file
        raise InputError(_unread(path, error)) from None


class ForcTable(NamedTuple):
    """What a file of reversal curves holds: its `segments` of field and moment, shape
    (k, 2) each, in order; their `units`, empty where it tells none; and how many curves
    it says there are, if it does."""

    segments: list[np.ndarray]
    units: tuple[str, str]
    promised: int | None


_UNITS_ROW = re.compile(r"^\s*\(([^)]*)\)\s+\(([^)]*)\)", re.MULTILINE)
_SYSTEM = re.compile(r"^Units of measure\s*:?\s+(.+?)\s*$", re.MULTILINE)
_CURVES = re.compile(r"^NForc\s*=?\s+\+?(\d+)\s*$", re.MULTILINE)
_FIELDS = {"hybrid si": "T", "si": "A/m", "cgs": "Oe"}
_FORC = ("field", "moment")
_DATA = "##DATA TABLE"


def forc_table(path: Path) -> ForcTable:
    """Read a MicroMag file, a Lake Shore table, or columns of text.

    **Raises:** `InputError` when it is none of these, is cut short, or its units
    contradict each other.
    """
    text = _text.text(path)
    if text.startswith("MicroMag"):
        return _micromag(path, text)
    above, found, table = text.partition(_DATA)
    if found:  # blank lines in place of what is above, so that others keep their number
        text = "\n" * above.count("\n") + table
    return _columns(path, text)


def _micromag(path: Path, text: str) -> ForcTable:
    if "data file ends" not in text[-200:].lower():
        raise InputError(
            f"{path} does not end with `MicroMag ... Data File ends`: it is cut short, "
            "or its last lines were edited. Export it again."
        )
    row, system = _UNITS_ROW.search(text), _SYSTEM.search(text)
    units = (row[1].strip(), row[2].strip()) if row else ("", "")
    named = system[1] if system else ""
    expected = _FIELDS.get(named.lower())
    if expected and units[0] and units[0] != expected:
        raise InputError(
            f"{path} is in {named} by its header, whose fields are in {expected}, "
            f"and has ({units[0]}) above its columns. Correct the one that is wrong."
        )
    curves = _CURVES.search(text)
    return ForcTable(micromag_segments(path), units, int(curves[1]) if curves else None)


def _columns(path: Path, text: str) -> ForcTable:
    """Runs of rows between blank lines, of any table of text."""
    table = _text.text_table(path, text, (None, None))
    chosen = _wanted(path, table.names)
    rows = zip(*(map(table.column, _FORC, chosen)), strict=True)
    segments, lines, above = [], text.split("\n"), 0
    for number, row in zip(table.line_numbers, rows, strict=True):
        if not segments or not all(map(str.strip, lines[above : number - 1])):
            segments.append([])
        segments[-1].append(row)
        above = number
    field, moment = map(table.unit_of, chosen)
    return ForcTable(list(map(np.array, segments)), (field, moment), None)


def _wanted(path: Path, head: Sequence[str]) -> tuple[int, int]:
    """The columns of field and moment: by name, or the first two."""
    if not head:
        return 0, 1
    bare = [without_unit(name)[0].lower().replace(" ", "") for name in head]

    def wanted(word: str, *other: str) -> int:
        for alike in (
            [i for i, name in enumerate(bare) if name.startswith(word)],
            [i for i, name in enumerate(bare) if word in name or name in other],
        ):
            if alike:
                return alike[0]
        raise InputError(
            f"{path} has no column with {word!r} in its name, nor one that is called "
            f"{' or '.join(other)}; it has {', '.join(head)}. Rename one."
        )

    field = wanted(
        "field", "h", "b", "mu0h", "\N{MICRO SIGN}0h", "\N{GREEK SMALL LETTER MU}0h"
    )
    return field, wanted("moment", "m", "magnetization", "magnetisation")
