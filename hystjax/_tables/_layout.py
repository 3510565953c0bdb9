"""How a text file is laid out: its separator, its header, the width of its rows."""

import csv
import re
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path

from .._errors import InputError

_SEPARATORS = (";", "\t", ",", None)  # None: any run of blanks
_NAME_BETWEEN_BLANKS = re.compile(r"\S+(?:\s*[\[(][^\])]*[\])])?")  # `Force [N]` is one


def is_number(cell: str) -> bool:
    """Whether a cell can be read as a number."""
    try:
        float(cell)
    except ValueError:
        return False
    return True


def separator(line: str) -> str | None:
    """The separator that cuts a line of data into the most numbers.

    A line with decimal commas is cut rightly too: its cells are not numbers, and are
    refused as such, rather than cut in two at the comma.
    """
    for candidate in (line, line.replace(",", ".")):
        cuts = {s: candidate.split(s) for s in _SEPARATORS}
        right = [s for s, cells in cuts.items() if all(map(_may_be_data, cells))]
        if right:
            return max(right, key=lambda s: len(cuts[s]))
    return next((s for s in _SEPARATORS if s and s in line), None)


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
    below = lines[1][1].split(separator) if len(lines) > 1 else []
    names = _names(line, separator)
    numbers = [name for name in names if _meant_as_number(name)]
    if not numbers:
        return names
    for name, cell in zip(names, below, strict=False):
        if name and not _meant_as_number(name) and _meant_as_number(cell):
            raise InputError(
                f"line {number} of {path} is neither a header nor data: {name!r} is "
                f"not a number, {numbers[0]!r} is. Correct it, or put # before it."
            )
    return []


def fitted(path: Path, names: Sequence[str], width: int) -> tuple[str, ...]:
    """`names` without the empty ones that stand past the last column of data.

    **Raises:** `InputError` when other than `width` names are left.
    """
    kept, rest = tuple(names[:width]), names[width:]
    if names and (len(kept) < width or any(rest)):
        raise InputError(
            f"the header of {path} has {len(names)} names ({', '.join(names)}) for "
            f"{width} columns. Correct it, or put # before it and give columns by "
            "number."
        )
    return kept


def width(path: Path, rows: Iterable[tuple[int, Sequence[str]]]) -> int:
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
        names = _NAME_BETWEEN_BLANKS.findall(line)
    else:  # names, unlike numbers, may be quoted
        names = next(csv.reader([line], delimiter=separator, skipinitialspace=True))
    return [name.strip() for name in names]


def _meant_as_number(cell: str) -> bool:
    return is_number(cell.replace(",", "."))


def _may_be_data(cell: str) -> bool:
    return is_number(cell) or not cell.strip()
