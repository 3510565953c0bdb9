"""Columns of a text file."""

import os
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from .._errors import InputError
from . import _file, _layout

_DECIMAL_COMMA = re.compile(r"[-+]?\d*,\d+([eE][-+]?\d+)?")
_UNIT = re.compile(r"\s*[\[(][^\])]*[\])]\s*$")


@dataclass(frozen=True)
class TextTable:
    """The cells of a text file, not yet turned into numbers.

    **Attributes:**

    - `path`: the file.
    - `names`: the header's cells; empty when there is no header line.
    - `line_numbers`: the line of the file each row is from, counted from 1.
    - `cells`: the cells of each row.
    """

    path: Path
    names: tuple[str, ...]
    line_numbers: Sequence[int]
    cells: Sequence[Sequence[str]]

    def column(self, argument: str, key: str | int) -> np.ndarray:
        """The column `key`, as float64, shape (rows,).

        **Arguments:**

        - `argument`: the caller's name for the column, for messages.
        - `key`: a number from 0, as int or in digits, or a header name: exact, or
            without regard to case and without its unit in brackets.

        **Raises:** `InputError` when there is no such column, or more than one, or a
        cell is not a number.
        """
        number = self._number(argument, key)
        column = [row[number] for row in self.cells]
        try:
            return np.array([float(cell) for cell in column])
        except ValueError:
            raise self._not_a_number(argument, number, column) from None

    def title(self, key: str | int, default: str) -> str:
        """The header's name of the column `key`, unit and all, or else `default`."""
        return (self.names[self._number("key", key)] if self.names else "") or default

    def _number(self, argument: str, key: str | int) -> int:
        if isinstance(key, int) or key.strip().isdecimal():
            found = [int(key)] if 0 <= int(key) < len(self.cells[0]) else []
        else:
            found = _matching(self.names, key.strip())
        if len(found) == 1:
            return found[0]
        problem = f"fits {len(found)} columns" if found else "is not a column"
        raise InputError(
            f"`{argument}`={key!r} {problem} of {self.path}. {self._listed()}"
        )

    def _listed(self) -> str:
        numbers = f"Columns are numbered from 0 to {len(self.cells[0]) - 1}"
        if not self.names:
            return f"{numbers}; the file has no header line, so they have no names."
        names = ", ".join(f"{i} {name!r}" for i, name in enumerate(self.names))
        return f"{numbers}: {names}."

    def _not_a_number(self, argument: str, number: int, column) -> InputError:
        row = next(i for i, cell in enumerate(column) if not _layout.is_number(cell))
        cell = column[row].strip()
        what = f"{cell!r}, which is not a number" if cell else "an empty cell"
        hint = "Correct or remove that line, or leave it out with `rows`."
        if _DECIMAL_COMMA.fullmatch(cell):
            hint = "Write decimal points, not decimal commas."
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

    Cells are separated by semicolons, tabs, commas or blanks. A first line with names
    above numbers is a header. Blank lines and lines that begin with # or % do not
    count.

    **Arguments:**

    - `path`: the file, in UTF-8 or Latin-1.
    - `rows`: first and last (not included) data row to keep, counted from 0 after the
        header; `None` for an end of the file.

    **Raises:** `InputError` when there is no such file, it is empty or binary, `rows`
    is not inside it, or its lines have different numbers of cells.
    """
    path = Path(path)
    lines = _file.numbered_lines(path)
    separator = _layout.separator(lines[len(lines) // 2][1])
    names = _layout.header(path, lines, separator)
    chosen = _chosen(path, lines[1:] if names else lines, rows)
    line_numbers = [number for number, _ in chosen]
    cells = [line.split(separator) for _, line in chosen]
    width = _layout.width(path, zip(line_numbers, cells, strict=True))
    return TextTable(path, _layout.fitted(path, names, width), line_numbers, cells)


def _chosen(path: Path, lines: list, rows: tuple[int | None, int | None]) -> list:
    if not lines:
        raise InputError(f"{path} has no rows below its header line.")
    first = 0 if rows[0] is None else rows[0]
    last = len(lines) if rows[1] is None else rows[1]
    if not 0 <= first < last <= len(lines):
        raise InputError(
            f"`rows`={rows} is not inside {path}: it has {len(lines)} rows, counted "
            "from 0 after the header, and the first must be less than the last."
        )
    return lines[first:last]


def _matching(names: Sequence[str], key: str) -> list[int]:
    """The columns of that very name, or else those alike but for case and unit."""
    exact = [i for i, name in enumerate(names) if name == key]
    wanted = key.casefold()
    alike = [
        i
        for i, name in enumerate(names)
        if wanted in (name.casefold(), _UNIT.sub("", name).casefold())
    ]
    return exact or alike
