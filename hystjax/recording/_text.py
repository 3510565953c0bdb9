"""Columns of a text file: its lines, how they are laid out, and what they hold, which
may be dates."""

import codecs
import csv
import importlib
import itertools
import operator
import os
import re
import zlib
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from .._core.checks import InputError, described, nearest, warn, whole
from .._core.files import path_of
from ._notation import is_time_of_day, is_unit, moments_in, tells_time

_BRACKETS = r"(?:\[[^\]]*\]|\((?:[^()]|\([^()]*\))*\))"  # [W/(m·K)] is one pair
_UNIT = re.compile(rf"\s*({_BRACKETS})\s*$")


def chosen_rows(
    source: Any, held: int, rows: tuple[int | None, int | None]
) -> tuple[int, int]:
    """The first and last (not included) of some rows.

    **Raises:** `InputError` when they are not there, there are none at all, or they are
    no pair.
    """
    if not held:
        raise InputError(f"{source} has no rows.")
    try:
        given = tuple(rows)
    except TypeError:
        given = ()
    if isinstance(rows, str) or len(given) != 2:
        raise InputError(
            "`rows` must be a pair, the first row and the one behind the last, such as "
            f"(0, 500), or None for an end of the file; got {described(rows)}."
        )
    first = 0 if given[0] is None else whole("rows[0]", given[0])
    last = held if given[1] is None else whole("rows[1]", given[1])
    if not 0 <= first < last <= held:
        raise InputError(
            f"`rows`={rows} is not inside {source}: it has {held} rows, counted "
            "from 0 after the header, and the first must be less than the last."
        )
    return first, last


def place(
    source: str, names: Sequence[str], width: int, argument: str, key: str | int
) -> int:
    """The number of a column, by its name: exact, or without regard to case and without
    its unit in brackets; or by a number from 0, as int, or in digits that no column has
    for a name.

    **Raises:** `InputError` when there is no such column, or more than one.
    """
    word = key.strip() if isinstance(key, str) else None
    if word is not None and (word in names or not _DIGITS.fullmatch(word)):
        found = _matching(names, word) if word else []
    else:
        number = _number(argument, key)
        found = [number] if 0 <= number < width else []
    if len(found) == 1:
        return found[0]
    problem = f"fits {len(found)} columns" if found else "is not a column"
    near = "" if found else nearest(key, names)
    raise InputError(
        f"`{argument}`={key!r} {problem} of {source}. {near}{_listed(names, width)}"
    )


_DIGITS = re.compile(r"\d{1,9}")


def _number(argument: str, key: Any) -> int:
    try:
        return int(key) if isinstance(key, str) else operator.index(key)
    except TypeError:
        raise InputError(
            f"`{argument}` must be a column, by name or by number from 0; got "
            f"{described(key)}."
        ) from None


def _listed(names: Sequence[str], width: int) -> str:
    numbers = f"Columns are numbered from 0 to {width - 1}"
    if not names:
        return f"{numbers}; the file has no header line, so they have no names."
    listed = ", ".join(f"{i} {name!r}" for i, name in enumerate(names))
    return f"{numbers}: {listed}."


def without_unit(name: str) -> tuple[str, str]:
    """A name, and the unit in brackets behind it, such as `ms` in `Time (ms)`, or
    nothing."""
    found = _UNIT.search(name)
    if found is None:
        return name, ""
    return name[: found.start()].strip(), found[1][1:-1].strip()


def _matching(names: Sequence[str], key: str) -> list[int]:
    """The columns of that very name, or else those alike but for case and unit."""
    names = [name.strip() for name in names]  # of a frame, which keeps what it read
    exact = [i for i, name in enumerate(names) if name == key]
    wanted = key.casefold()
    alike = [
        i
        for i, name in enumerate(names)
        if wanted in (name.casefold(), without_unit(name)[0].casefold())
    ]
    return exact or alike


_COMMENTS = ("#", "%")
# Cells of a spreadsheet; of `####` it makes what is too wide for its column.
_FAILED = re.compile(
    r"#(N/A|NV|[A-Z/0]+[!?])\s*([;,\t]|$)|#(N/A|NV)\s+[-+.\d]|##+\s*[;,\t]"
)
_PER_CENT = re.compile(r"%\s*([;,\t])")  # a unit in a row of units
_COMMENT = "Comment"  # the last column of LabVIEW, which most rows do not have
PACKERS = {
    ".gz": (re.compile(rb"\x1f\x8b"), "gzip"),
    # Three letters, a level, and a block or the end of all: BZh alone may be a name.
    ".bz2": (re.compile(rb"BZh[1-9](1AY&SY|\x17rE8P\x90)"), "bz2"),
    ".xz": (re.compile(rb"\xfd7zXZ\x00"), "lzma"),
}
"""By the ending of a file: how one begins that is compressed, and by which module."""


def content(path: Path) -> bytes:
    """The bytes of a file; raises `InputError` when there are none to be had."""
    try:
        read = path.read_bytes()
    except FileNotFoundError:
        raise InputError(
            f"there is no file {path} (looked from {Path.cwd()}); check the path."
        ) from None
    except IsADirectoryError:
        raise InputError(f"{path} is a folder; give a file in it.") from None
    except (OSError, ValueError) as error:  # the latter for a path that cannot be
        why = getattr(error, "strerror", None) or error
        raise InputError(f"{str(path)!r} cannot be read: {why}.") from None
    if not read:
        raise InputError(f"{path} is empty (0 bytes).")
    for start, by in PACKERS.values():
        if start.match(read):
            return _unpacked(path, read, by)
    return read


def _unpacked(path: Path, read: bytes, by: str) -> bytes:
    try:
        module = importlib.import_module(by)
    except ImportError:
        raise InputError(
            f"{path} is compressed, and this Python was built without its `{by}`: "
            "unpack it first."
        ) from None
    damage = getattr(module, "LZMAError", zlib.error)
    try:
        return module.decompress(read)
    except (OSError, EOFError, ValueError, zlib.error, damage) as error:
        raise InputError(
            f"{path} is compressed by {by}, and damaged: {error}."
        ) from None


def numbered_lines(path: Path, text: str) -> tuple[list[tuple[int, str]], list[str]]:
    """The lines of a file's text that are neither blank nor comments, each with its
    number from 1; and the two comments right above the first, or as many as there are.
    Raises `InputError` when there are no lines.
    """
    every = text.split("\n")
    lines = [
        (number, line)
        for number, (above, line) in enumerate(itertools.pairwise(["", *every]), 1)
        if line.strip() and not _is_comment(line, above)
    ]
    if not lines:
        raise InputError(f"{path} has no rows: all its lines are blank or comments.")
    above = every[: lines[0][0] - 1][-2:]
    return lines, [line.lstrip(" " + "".join(_COMMENTS)) for line in above]


def _is_comment(line: str, above: str) -> bool:
    """Whether a line begins as comments do, and neither with a cell that a spreadsheet
    could not calculate nor with a unit below as many names."""
    line = line.lstrip()
    if not line.startswith(_COMMENTS) or _FAILED.match(line):
        return False
    unit = _PER_CENT.match(line)
    named = above.strip() and not above.lstrip().startswith(_COMMENTS)
    return not (unit and named and line.count(unit[1]) == above.count(unit[1]))


def text(path: Path) -> str:
    """The text of a file, a line feed after each line; raises `InputError` when there
    is none to be had, or it is binary.
    """
    read = content(path)
    wide = read.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
    if not wide and b"\0" in read:
        raise InputError(
            f"{path} is binary, not text. Read a MATLAB file with "
            "`Recording.from_mat`; unpack an archive; export a spreadsheet as CSV."
        )
    try:
        decoded = read.decode("utf-16" if wide else "utf-8-sig")
    except UnicodeDecodeError:
        if wide:
            raise InputError(
                f"{path} begins as UTF-16 does, and cannot be read as that: it may be "
                "cut short. Save it as UTF-8."
            ) from None
        decoded = read.decode("latin-1")
    return decoded.replace("\r\n", "\n").replace("\r", "\n")


_SEPARATORS = (";", "\t", ",", None)  # None: any run of blanks
_DECIMAL_COMMA = re.compile(r"[-+]?\d*,\d+([eE][-+]?\d+)?")
# 1.006,5 or 1,006.5
_WITH_THOUSANDS = re.compile(r"\s*[-+]?\d{1,3}(?:(\.\d{3})+,\d*|(,\d{3})+\.\d*)\s*")
_NO_TWO = re.compile(r"\s*(-0,|[-+]?\d*,0\d)")  # whole numbers are not written -0 or 05
_NAME_WITH_UNIT = re.compile(rf"[^\s\[(].*\s{_BRACKETS}$")
_CELL_BETWEEN_BLANKS = re.compile(r'"([^"]*)"(?=\s|$)|(\S+)')
# `Force [N]` is one, and so is `[N]`, of a row of units.
_NAME_BETWEEN_BLANKS = re.compile(
    rf'"([^"]*)"(\s*{_BRACKETS})?(?=\s|$)'
    rf"|({_BRACKETS}(?=\s|$)|\S+(?:\s*{_BRACKETS})?)"
)


def is_number(cell: str) -> bool:
    """Whether a cell can be read as a number; 1_2, which Python reads, is a name."""
    try:
        float(cell)
    except ValueError:
        return False
    return "_" not in cell


def cells_of(line: str, separator: str | None) -> list[str]:
    """The cells of a line of data, without quotes around them."""
    if '"' not in line:
        return line.split(separator)
    if separator is None:
        return _between_blanks(_CELL_BETWEEN_BLANKS, line)
    try:
        return next(csv.reader([line], delimiter=separator, skipinitialspace=True))
    except csv.Error as error:
        raise InputError(
            f"a line that begins with {line[:20]!r} cannot be cut into cells: {error}. "
            "A file of text has a line for each sample."
        ) from None


def _between_blanks(form: re.Pattern, line: str) -> list[str]:
    """What stands between blanks, of that form, or between quotes."""
    return ["".join(found) for found in form.findall(line)]


def separator_of(lines: Sequence[str]) -> str | None:
    """The separator that cuts a line in the middle of a file into the most numbers.

    Decimal commas do not cut numbers in two, but for a file of one column in which all
    could as well be two whole numbers.
    """
    line = _typical(lines)
    cut = _cut_most(line)
    if cut == "," and _DECIMAL_COMMA.fullmatch(line.strip()):
        rest = lines[1:]  # the first may be a header
        fits = all(_DECIMAL_COMMA.fullmatch(each.strip()) for each in rest)
        if fits and any(map(_NO_TWO.match, rest)):
            return ";"
    return cut


def _typical(lines: Sequence[str]) -> str:
    """The line in the middle, or where that begins with a word, as what stands above a
    short table does, the first below that is of numbers, two and more."""
    middle, *below = lines[len(lines) // 2 :]
    begins = re.split(r"[;,\s]", middle.lstrip(), maxsplit=1)[0]
    if not _is_word(begins):
        return middle
    several = (x for x in below if max(_right_cuts(x).values(), default=0) > 1)
    return next(several, middle)


def _cut_most(line: str) -> str | None:
    cuts = _right_cuts(line)
    if cuts:
        return max(cuts, key=cuts.__getitem__)
    return next((s for s in _SEPARATORS if s and s in line), None)


def _right_cuts(line: str) -> dict[str | None, int]:
    """The separators that cut a line into numbers alone, and into how many."""
    for candidate in (line, line.replace(",", ".")):
        cuts = {s: cells_of(candidate, s) for s in _SEPARATORS}
        right = {s: len(x) for s, x in cuts.items() if all(map(_may_be_data, x))}
        if right:
            return right
    return {}


def without_preamble(
    lines: Sequence[tuple[int, str]], separator: str | None
) -> Sequence[tuple[int, str]]:
    """The lines without what loggers write above the table: of a file whose first line
    has other cells than the table, or fewer that are not empty, or one below it a
    number that it says what it is of, those above the names that stand above numbers,
    or above the numbers, where there are no names."""
    usual = cells_of(_typical([line for _, line in lines]), separator)
    width, by_word = len(usual), _is_word(usual[0])

    def is_labelled(line: str) -> bool:
        # What stands above may have as many numbers, but behind a word that says of
        # what: `Samples` of LabVIEW, `Vertical Scale` of oscilloscopes.
        return _is_word(cells_of(line, separator)[0]) and not by_word

    first = 0
    while first < len(lines) and (
        is_labelled(lines[first][1]) or not _is_row(lines[first][1], separator, usual)
    ):
        first += 1
    names = _names(lines[0][1], separator)
    # The first may call columns by numbers, as oscilloscopes do.
    labelled = [cells_of(x, separator) for _, x in lines[1:first] if is_labelled(x)]
    told = any(_tells(cell) for row in labelled for cell in row)
    if len(names) == width and all(names) and not told:
        return lines

    # The rows may end with a separator, and names not.
    widths = {width, width - (not usual[-1].strip())}

    def are_names(place: int) -> bool:
        names = _names(lines[place][1], separator) if place >= 0 else []
        fit = any(_fits(names, each) for each in widths)
        return fit and not any(map(_meant_as_number, names))

    top = first - 1
    if first == len(lines):
        return lines
    if not are_names(top):
        apart = lines[first][0] - lines[top][0] > 1
        prose = top >= 0 and _is_prose(lines[top][1], separator, apart)
        return lines[first:] if prose else lines
    together = are_names(top - 1) and lines[top - 1][0] == lines[top][0] - 1
    with_units = together and _begin_with_units(lines[top - 1 :], separator)
    return lines[top - 1 :] if with_units else lines[top:]


def _begin_with_units(lines: Sequence[tuple[int, str]], separator: str | None) -> bool:
    """Whether names stand in the first of `lines`, and their units in the second."""
    names, units = _names(lines[0][1], separator), _units_row(lines[1:], separator)
    # Below a title, such as one of merged cells, stand names; but pandas writes none
    # above an index, the first column, and one heading may be of columns in two units.
    pairs = zip(names[1:], units[1:], strict=False)
    unnamed = [unit for name, unit in pairs if unit and not name]
    dated = any(map(tells_time, names))
    return bool(units) and not dated and all(map(is_unit, unnamed))


def _is_prose(line: str, separator: str | None, apart: bool) -> bool:
    """Whether a line above a table is none of it, neither a row cut short nor names
    that do not fit: it is a sentence, or stands `apart`, and holds no numbers."""
    cells = [cell.strip() for cell in cells_of(line, separator)]
    data = list(map(_tells, cells))
    if separator is None:  # in which a sentence has any number of cells
        return apart and not data[0]
    sentence = len(cells) == 1 and " " in cells[0]
    return (apart or sentence) and not any(data)


def _is_row(line: str, separator: str | None, usual: Sequence[str]) -> bool:
    """Whether there are as many cells as usual, or one more, a comment; and whether
    most of those that are usually filled hold numbers, times, or gaps between them."""
    cells, filled = cells_of(line, separator), sum(bool(x.strip()) for x in usual)
    commented = len(cells) == len(usual) + 1 and _is_word(cells[-1])
    like = commented or len(cells) == len(usual)
    return like and 2 * sum(map(_is_data, cells)) > filled


def _tells(cell: str) -> bool:
    return _meant_as_number(cell) or tells_time(cell)


def _is_data(cell: str) -> bool:
    return _tells(cell) or cell.strip() in _GAPS


def _is_word(cell: str) -> bool:
    return not _is_data(cell) and bool(cell.strip())


def header(
    path: Path, lines: Sequence[tuple[int, str]], separator: str | None
) -> list[str]:
    """The names in the first of `lines`, or none when it holds data.

    A cell that is not a number makes no header if the cell below is not one either:
    that is a column of text.

    **Raises:** `InputError` when the line holds numbers beside names: taking it for a
    header could drop a row of data with a slip in it.
    """
    number, line = lines[0]
    below = cells_of(lines[1][1], separator) if len(lines) > 1 else []
    names = _names(line, separator)
    # A first row of which only the time was recorded, or nothing at all.
    if any(map(tells_time, names)) or {*names} <= {*_GAPS, ""}:
        return []
    if _are_numbers_of_columns(path, names, lines[1:], separator):
        return names
    numbers = [name for name in names if _meant_as_number(name)]
    # Oscilloscopes by Keysight call channels 1 and 2, and write a unit below each.
    units = _units_row(lines[1:], separator) if len(numbers) < len(names) else ()
    if not numbers or (len(units) == len(names) and all(units)):
        return names
    for name, cell in zip(names, below, strict=False):
        if name and not _meant_as_number(name) and _meant_as_number(cell):
            raise InputError(
                f"line {number} of {path} is neither a header nor data: {name!r} is "
                f"not a number, {numbers[0]!r} is. Correct it, or put # before it."
            )
    return []


_KEPT_ZERO = re.compile(r"[-+]?\d*\.\d*0([eE][-+]?\d+)?")


def _are_numbers_of_columns(
    path: Path,
    names: Sequence[str],
    lines: Sequence[tuple[int, str]],
    separator: str | None,
) -> bool:
    """Whether cells such as 0, 1, 2 are what pandas writes above columns without names,
    and no data: after an empty cell, above an index; or where zeros are written as 0.0.
    """
    indexed = bool(names) and not names[0]
    numbers = list(map(str, range(len(names) - indexed)))
    if len(names) < 2 or names[indexed:] != numbers or not lines:
        return False
    cells = ([x.replace(",", ".") for x in cells_of(x, separator)] for _, x in lines)
    columns = list(zip(*cells, strict=False))
    if indexed:
        return all(cell.strip() for cell in columns[0])
    pointed = [all("." in x for x in column if x.strip()) for column in columns]
    for column, points in zip(columns, pointed, strict=True):
        if points and any(_KEPT_ZERO.fullmatch(cell.strip()) for cell in column):
            return True
    if all(pointed):
        warn(
            f"the first line of {path}, {','.join(names)}, was read as data. Where it "
            "numbers the columns, as pandas writes it, put # before it.",
        )
    return False


def fitted(path: Path, names: Sequence[str], width: int) -> tuple[str, ...]:
    """`names` without those that stand past the last column of data.

    **Raises:** `InputError` when other than `width` names are left.
    """
    if names and not _fits(names, width):
        raise InputError(
            f"the header of {path} has {len(names)} names ({', '.join(names)}) for "
            f"{width} columns. Correct it, or put # before it and give columns by "
            "number."
        )
    return tuple(names[:width])


def _fits(names: Sequence[str], width: int) -> bool:
    """Whether there is a name for each column, and none for others, but for comments,
    for which LabVIEW leaves a column that may be empty."""
    return len(names) >= width and not {*names[width:]} - {"", _COMMENT}


def width_of(path: Path, rows: Iterable[tuple[int, Sequence[str]]]) -> int:
    """The number of cells in each of `rows`, which come with their line numbers.

    **Raises:** `InputError` when it is not the same in all.
    """
    lengths = [(number, len(cells)) for number, cells in rows]
    usual = Counter(length for _, length in lengths).most_common(1)[0][0]
    for number, length in lengths:
        if length != usual:
            raise InputError(
                f"line {number} of {path} has {length} cells where most have {usual}. "
                "The file may be cut short or hold several tables; correct or remove "
                "that line, or leave it out with `rows`."
            )
    return usual


def _names(line: str, separator: str | None) -> list[str]:
    if separator is None:
        names = _between_blanks(_NAME_BETWEEN_BLANKS, line)
    else:
        names = cells_of(line, separator)
    return [name.strip() for name in names]


def _meant_as_number(cell: str) -> bool:
    return is_number(cell.replace(",", "."))


def _may_be_data(cell: str) -> bool:
    cell = cell.strip()
    return not cell or is_number(cell) or is_time_of_day(cell)


def _as_numbers(cells: Sequence[str]) -> np.ndarray:
    """Cells as numbers; raises `ValueError` for what is none, such as 1_2."""
    values = np.array([float(cell) for cell in cells])
    if any("_" in cell for cell in cells):
        raise ValueError
    return values


_LONGEST_UNIT = 12
_SAYS_UNIT = re.compile(r"[^\W_]|[%‰°'\"$€£]")
_GAPS = {
    form(word)
    for word in (
        *("n/a", "na", "nan", "#n/a", "null", "none", "missing"),
        *("over", "overload", "overflow", "overrange", "ovl", "ovld", "ol", "under"),
        *("error", "err", "fail", "invalid", "bad", "n.a.", "-", "--"),
    )
    for form in (str.lower, str.upper, str.title)  # but nA is a unit
}
_NO_UNIT = ("", "-", "1")


@dataclass(frozen=True)
class TextTable:
    """The cells of a text file, not yet turned into numbers.

    **Attributes:**

    - `path`: the file.
    - `names`: the header's cells; empty when there is no header line.
    - `line_numbers`: the line of the file each row is from, counted from 1.
    - `cells`: the cells of each row.
    - `units`: the cells of a row of units below the names; empty when there is none.
    """

    path: Path
    names: tuple[str, ...]
    line_numbers: Sequence[int]
    cells: Sequence[Sequence[str]]
    units: tuple[str, ...] = ()

    def column(self, argument: str, key: str | int) -> np.ndarray:
        """The column `key`, as float64, shape (rows,).

        **Arguments:**

        - `argument`: the caller's name for the column, for messages.
        - `key`: a header name, exact, or without regard to case and without its unit in
            brackets; or a number from 0, as int, or in digits that are no name.

        **Raises:** `InputError` when there is no such column, or more than one, or a
        cell is not a number.
        """
        number = self._place(argument, key)
        column, mark = [row[number] for row in self.cells], "."
        try:
            values = _as_numbers(column)
        except ValueError:
            if not _with_commas(column):
                raise self._not_a_number(argument, number, column) from None
            mark = ","
            values = _as_numbers([cell.replace(",", ".") for cell in column])
        if _THOUSANDS[mark].fullmatch(next((x for x in column if mark in x), "")):
            self._check_thousands(argument, number, column, mark)
        return values

    def _check_thousands(
        self, argument: str, number: int, column: Sequence[str], mark: str
    ) -> None:
        """Raise `InputError` where all marks stand as those of thousands do, and what
        is beside them tells that they may be; warn where nothing tells that."""
        marked = [row for row, cell in enumerate(column) if mark in cell]
        if not all(_THOUSANDS[mark].fullmatch(column[row]) for row in marked):
            return
        other, marks = {",": (".", "commas"), ".": (",", "points")}[mark]
        cells = [x for row in self.cells for i, x in enumerate(row) if i != number]
        # A whole number is one of thousands without them. Beside points 2 may be 2.0,
        # but who writes that short does not write 1.000.
        may_be = mark == "," or any(column[row].rstrip()[-1] == "0" for row in marked)
        among = filter(_WHOLE.fullmatch, column if may_be else ())
        beside = next(among, None) or next(filter(_DECIMAL[other].fullmatch, cells), "")
        first = marked[0]
        said = (
            f"`{argument}` (column {number}) has {column[first].strip()!r}, in line "
            f"{self.line_numbers[first]} of {self.path}"
        )
        if beside:
            raise InputError(
                f"{said}, beside {beside.strip()!r}: whether {marks} part thousands or "
                f"are decimal cannot be told. Write it without {marks}, or the other "
                "with as many decimals in all."
            )
        decimal = any(
            _DECIMAL[mark].fullmatch(x) and not _THOUSANDS[mark].fullmatch(x)
            for x in cells
        )
        if mark == "," and not decimal:
            warn(
                f"{said}, as are all numbers with commas there: they were read as "
                "decimal. Where commas part thousands, write the numbers without them.",
            )

    def moments(self, argument: str, key: str | int) -> np.ndarray:
        """The column `key` as numbers, or where it holds dates or times of day as dates
        or durations of NumPy."""
        number = self._place(argument, key)
        cells = [row[number] for row in self.cells]
        if not tells_time(cells[0]):
            return self.column(argument, key)
        try:
            return moments_in(cells)
        except ValueError as error:
            raise InputError(
                f"`{argument}` (column {number}) of {self.path} holds a date or time "
                f"that cannot be read: {error}. Write them as 2026-01-31T12:00:00.000, "
                "or as 12:00:00.000."
            ) from None

    def title(self, key: str | int, default: str) -> str:
        """The header's name of the column `key`, unit and all, or else `default`."""
        return (self.names[self._place("key", key)] if self.names else "") or default

    def row_unit(self, key: str | int) -> str:
        """What the row of units says of the column `key`, or nothing."""
        return self.units[self._place("key", key)] if self.units else ""

    def unit_of(self, key: str | int) -> str:
        """The unit of the column `key`, by that row or in brackets behind its name."""
        return self.row_unit(key) or without_unit(self.title(key, ""))[1]

    def _place(self, argument: str, key: str | int) -> int:
        width = len(self.cells[0])
        try:
            return place(str(self.path), self.names, width, argument, key)
        except InputError as error:
            name = str(key).strip()
            rows = zip(self.line_numbers, self.cells, strict=True)
            found = (n for n, row in rows if _matching(row, name))
            lower = None if not name or _tells(name) else next(found, None)
            if lower is None:  # nor is a number a name, which data hold
                raise
            raise InputError(
                f"{error} It stands in line {lower}: if that is the header, put # "
                "before each line above it."
            ) from None

    def _not_a_number(self, argument: str, number: int, column) -> InputError:
        bad = [i for i, cell in enumerate(column) if not is_number(cell)]
        # Numbers with decimal commas are wrong only beside points.
        worse = [i for i in bad if not _DECIMAL_COMMA.fullmatch(column[i].strip())]
        row = (worse or bad)[0]
        cell = column[row].strip()
        what = f"{cell!r}, which is not a number" if cell else "an empty cell"
        hint = "Correct or remove that line, or leave it out with `rows`."
        if _WITH_THOUSANDS.fullmatch(cell):
            hint = "It has marks between thousands: write numbers without them."
        elif _DECIMAL_COMMA.fullmatch(cell):
            hint = "The column has decimal points too; write one kind."
        elif argument == "output" and (not cell or cell in _GAPS):
            # Without its row a device would forget where the input was.
            hint = (
                "Read the columns as arrays, with NaN there, and bridge it: "
                "`hystjax.bridged`."
            )
        return InputError(
            f"`{argument}` (column {number}) has {what}, in line "
            f"{self.line_numbers[row]} of {self.path}. {hint}"
        )


def read_text(
    path: str | os.PathLike,
    *,
    rows: tuple[int | None, int | None] = (None, None),
) -> TextTable:
    """Cut a text file into cells.

    Cells are separated by semicolons, tabs, commas or blanks, and may be quoted. A
    first line with names above numbers is a header; lines of text above it do not
    count, where they are not cut as the table is. Nor do blank lines and lines that
    begin with # or %; but where there is no header, one right above the first row names
    the columns if the separator, other than blanks, cuts it into a name for each, as
    `numpy.savetxt` writes it. Where an oscilloscope numbers the samples, and says when
    they start and how far apart they are, their numbers become times.

    **Arguments:**

    - `path`: the file, in UTF-8, Latin-1 or, as Excel's Unicode text, UTF-16.
    - `rows`: first and last (not included) data row to keep, counted from 0 after the
        header; `None` for an end of the file.

    **Raises:** `InputError` when there is no such file, it is empty or binary, `rows`
    is not inside it, or its lines have different numbers of cells.
    """
    path = path_of(path)
    return text_table(path, text(path), rows)


def text_table(
    path: Path,
    text: str,
    rows: tuple[int | None, int | None],
    separator: str | None = None,
) -> TextTable:
    """As `read_text`, of the text of a file; and its separator, where that is known."""
    lines, comments = numbered_lines(path, text)
    separator = separator or separator_of([line for _, line in lines])
    sequence = _sequence(lines, separator)
    if sequence is not None:
        return sequence.table(path, lines[2:], separator, rows)
    lines = without_preamble(_without_processing(lines), separator)
    names = header(path, lines, separator)
    body = lines[1:] if names else lines
    if names and not body:
        raise InputError(f"{path} has no rows below its header line.")
    # Where files were joined, or a logger began anew, names stand there again.
    again = names == _names(body[0][1], separator)
    units = _units_row(body, separator) if names and not again else ()
    body = body[1:] if units else body
    first, last = chosen_rows(path, len(body), rows)
    line_numbers = [number for number, _ in body[first:last]]
    cells = [cells_of(line, separator) for _, line in body[first:last]]
    if names and all(
        len(row) == len(names) + 1 and not row[-1].strip() for row in cells
    ):
        cells = [row[:-1] for row in cells]  # the rows end with a separator, names not
    if names[-1:] == [_COMMENT] and any(len(row) < len(names) for row in cells):
        cells = [row[: len(names) - 1] for row in cells]
    width = width_of(path, zip(line_numbers, cells, strict=True))
    if not names:
        names, units = _names_in(comments, separator, width)
    names, units = (fitted(path, each, width) for each in (names, units))
    return TextTable(path, names, line_numbers, cells, units)


@dataclass(frozen=True)
class _Sequence:
    """What oscilloscopes by Rigol write above samples that they number.

        X,CH1,Start,Increment,
        Sequence,Volt,-6.0e-02,2.0e-05

    **Attributes:** names and units of the columns; and, in s, when the first sample is,
    and how far apart they are.
    """

    names: Sequence[str]
    units: Sequence[str]
    start: float
    increment: float

    def table(
        self,
        path: Path,
        lines: Sequence[tuple[int, str]],
        separator: str | None,
        rows: tuple[int | None, int | None],
    ) -> TextTable:
        """The samples below, with times for their numbers."""
        first, last = chosen_rows(path, len(lines), rows)
        line_numbers = [number for number, _ in lines[first:last]]
        cells = [self._row(cells_of(line, separator)) for _, line in lines[first:last]]
        width = width_of(path, zip(line_numbers, cells, strict=True))
        names, units = (fitted(path, x, width) for x in (self.names, self.units))
        return TextTable(path, names, line_numbers, cells, units)

    def _row(self, cells: list[str]) -> list[str]:
        width = len(self.names)
        if not any(cell.strip() for cell in cells[width:]):
            cells = cells[:width]
        if is_number(cells[0]):
            cells[0] = repr(self.start + self.increment * float(cells[0]))
        return cells


def _sequence(
    lines: Sequence[tuple[int, str]], separator: str | None
) -> _Sequence | None:
    """Such two lines, if they are the first."""
    above, below = (
        ([cell for cell in _names(line, separator) if cell] for _, line in lines[:2])
        if len(lines) > 2
        else ([], [])
    )
    numbers = below[-2:]
    named = above[:1] == ["X"] and above[-2:] == ["Start", "Increment"]
    if not named or below[:1] != ["Sequence"] or len(below) != len(above):
        return None
    if not all(map(is_number, numbers)):
        return None
    return _Sequence(above[:-2], ["s", *below[1:-2]], *map(float, numbers))


_CAMPBELL = re.compile(r'"?TOA5"?,')
_NO_QUANTITY = re.compile(r'"(TS|RN)"')  # "units" of moments and of row numbers


def _without_processing(lines: Sequence[tuple[int, str]]) -> Sequence[tuple[int, str]]:
    """The table of a logger by Campbell Scientific as names, units and rows: above
    these it tells of itself, and below what it did with the samples, such as `Avg`."""
    if len(lines) < 5 or not _CAMPBELL.match(lines[0][1]):
        return lines
    _, names, (number, units), _, *rows = lines
    return [names, (number, _NO_QUANTITY.sub('""', units)), *rows]


def _names_in(
    comments: Sequence[str], separator: str | None, width: int
) -> tuple[Sequence[str], Sequence[str]]:
    """Names and units of so many columns in the comments above them, or none. (Of one
    column, or between blanks, prose would do.) The mark of a comment may be a cell of
    its own, or the name of a column that numbers the rows."""
    if separator is None or width < 2:
        return [], []

    def cells(comment: str) -> list[str]:
        found = _names(comment, separator)
        if len(found) > width and not found[0]:
            found = found[1:]
        named = len(found) == width and all(found[1:])
        return found if named and not any(map(_meant_as_number, found)) else []

    *above, names = ([], *map(cells, comments))
    units = [_without_brackets(name) for name in names]
    if units and above[-1] and all(map(is_unit, units)):
        return above[-1], units
    return names, []


def _units_row(
    lines: Sequence[tuple[int, str]], separator: str | None
) -> Sequence[str]:
    """Units in the first line below the names: words above numbers, beside cells that
    are empty, - or 1 where there is none."""
    if len(lines) < 2:
        return ()
    above, below = (_names(line, separator) for _, line in lines[:2])
    bare = [_without_brackets(cell) for cell in above]
    units = ["" if cell in _NO_UNIT else cell for cell in bare]
    words = [unit for unit in units if unit]
    # `H (kA/m)` has one, and is a name: the line above is a title in two cells.
    if any(map(_NAME_WITH_UNIT.match, words)):
        return ()
    # A date is no unit, nor is a number, be it written with a comma.
    data = any(map(_tells, words))
    # Beside a 1, or with digits in them, words may be data too: 0x80, or Err:502.
    if "1" in bare or any(map(str.isdigit, "".join(words))):
        data = data or not all(map(is_unit, words))
    if data or not words or not any(map(_meant_as_number, below)):
        return ()
    # Text beside a gap or a 1 has the looks of units too, but is above text.
    pairs = zip(units, below, strict=False)
    if bare != units and not all(_meant_as_number(x) for unit, x in pairs if unit):
        return ()
    # A line of words such as n/a in the middle of data has the width of data too, but
    # units are short.
    short = all(len(unit) <= _LONGEST_UNIT and unit not in _GAPS for unit in words)
    short = short and all(map(_SAYS_UNIT.search, words))  # **** is none
    return units if short else ()


def _without_brackets(cell: str) -> str:
    found = _UNIT.fullmatch(cell)
    return found[1][1:-1].strip() if found else cell


# By the mark in them: numbers that may be of thousands, and those with decimals.
_THOUSANDS, _DECIMAL = (
    {mark: re.compile(form.format(mark=re.escape(mark))) for mark in ".,"}
    for form in (
        r"\s*[-+]?[1-9]\d{{0,2}}{mark}\d{{3}}\s*",
        r"\s*[-+]?\d*{mark}\d+(?:[eE][-+]?\d+)?\s*",
    )
)
_WHOLE = re.compile(r"\s*[-+]?\d+\s*")


def _with_commas(column: Sequence[str]) -> bool:
    """Whether numbers are written with decimal commas, all of them: beside points, a
    comma may part thousands."""
    return all(
        _DECIMAL_COMMA.fullmatch(cell.strip()) or ("." not in cell and is_number(cell))
        for cell in column
    )
