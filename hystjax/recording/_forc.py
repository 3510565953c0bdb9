"""Segments of field and moment in files of magnetometers, with their units."""

import re
from pathlib import Path
from typing import NamedTuple

import numpy as np

from .._core.checks import InputError
from . import _text
from ._formats import micromag_segments


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
_UNIT = re.compile(r"[\[(]([^\])]*)[\])]")
_DATA = "##DATA TABLE"


def forc_table(path: Path) -> ForcTable:
    """Read a MicroMag file, a Lake Shore table, or columns of text.

    **Raises:** `InputError` when it is none of these, is cut short, or its units
    contradict each other.
    """
    text = _text.text(path)
    if text.startswith("MicroMag"):
        return _micromag(path, text)
    if _DATA in text:
        return _columns(path, text[text.index(_DATA) + len(_DATA) :])
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
    """Runs of rows between blank lines, below a header if there is one."""
    lines = [(n, line.strip()) for n, line in enumerate(text.split("\n"), 1)]
    lines = [(n, line) for n, line in lines if not line.startswith(("#", "%"))]
    rows = [line for _, line in lines if line]
    if len(rows) < 2:
        raise InputError(f"{path} has no table of fields and moments.")
    separator = _text.separator_of(rows)
    head = _text.header(path, [(1, rows[0]), (2, rows[1])], separator)
    columns = _wanted(path, head)
    units = ("", "")
    if head:
        found = [_UNIT.search(head[column]) for column in columns]
        units = tuple(each[1].strip() if each else "" for each in found)
    segments, run, seen = [], [], not head
    for number, line in [*lines, (0, "")]:
        if not line:
            segments, run = ([*segments, np.array(run)] if run else segments), []
        elif not seen:
            seen = True
        else:
            run.append(_pair(path, number, line.split(separator), columns))
    return ForcTable(segments, (units[0], units[1]), None)


def _wanted(path: Path, head: list[str]) -> tuple[int, int]:
    """The columns of field and moment: by name, or the first two."""
    if not head:
        return 0, 1
    found = []
    for word in ("field", "moment"):
        alike = [i for i, name in enumerate(head) if name.lower().startswith(word)]
        if not alike:
            raise InputError(
                f"{path} has no column whose name begins with {word!r}; it has "
                f"{', '.join(head)}."
            )
        found.append(alike[0])
    return found[0], found[1]


def _pair(path: Path, number: int, cells: list[str], columns: tuple[int, int]):
    try:
        return [float(cells[column]) for column in columns]
    except (ValueError, IndexError):
        raise InputError(
            f"line {number} of {path} does not hold a field and a moment: "
            f"{' '.join(cells)[:60]!r}. Correct or remove it."
        ) from None
