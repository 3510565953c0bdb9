"""Tables that print, and become files."""

import json
import math
import re
import textwrap
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, is_dataclass
from typing import Any

import jax
import numpy as np
from matplotlib.figure import Figure

from ..models import AbstractModel
from ..report import markdown_table

_DIGITS = 6  # in files: what is left after these is rounding
_ROUNDING = 1e-9  # shares below are what is left of zero
_WIDTH = 88  # of notes
_WRAPPING: dict[str, Any] = {
    "subsequent_indent": "  ",
    "break_long_words": False,
    "break_on_hyphens": False,
}


@dataclass(frozen=True)
class AbstractDocument(ABC):
    """A table with a title.

    **Attributes:**

    - `title`: what it is about.
    - `rows`: dataclasses of figures and words.
    - `notes`: lines below the table.
    - `drawing`: makes the figure of what the table was computed from; `None` where
        there is none.
    """

    title: str
    rows: tuple[Any, ...]
    notes: tuple[str, ...] = ()
    drawing: Callable[[], Figure] | None = None

    @abstractmethod
    def cells(self) -> Sequence[Sequence[str]]:
        """Headings, and what is shown of each row."""

    def text(self) -> str:
        """The table for a terminal."""
        first, *others = zip(*self.cells(), strict=True)
        columns = [_aligned(first, right=False)]
        columns += [_aligned(column, right=_is_numeric(column)) for column in others]
        lines = ["  ".join(row).rstrip() for row in zip(*columns, strict=True)]
        notes = [textwrap.fill(note, _WIDTH, **_WRAPPING) for note in self.notes]
        return "\n".join([self.title, "", *lines, "", *notes])

    def entry(self, row: Any) -> Any:
        """What the file for programs says of a row: all of it by default."""
        return row

    def markdown(self) -> str:
        """The table as a page in Markdown."""
        lines = "\n".join(f"- {note}" for note in self.notes)
        return f"# {self.title}\n\n{markdown_table(self.cells())}\n\n{lines}\n"

    def json(self) -> str:
        """The table for programs, numbers to six digits, so that a difference between
        two of them is one of results."""
        rows = [self.entry(row) for row in self.rows]
        content = {"title": self.title, "rows": _plain(rows), "notes": self.notes}
        return json.dumps(content, indent=2, ensure_ascii=False) + "\n"


def shown(value: float | str | None, digits: int = 5) -> str:
    """A figure or word as it is printed; a dash for none."""
    if value is None:
        return "-"
    if isinstance(value, str):
        return value
    return f"{value:.{digits}g}" if math.isfinite(value) else "diverged"


def shown_share(ratio: float, digits: int = 3) -> str:
    """A ratio as it is printed in per cent; what is left of rounding is zero."""
    return "0" if abs(ratio) < _ROUNDING else shown(100 * float(ratio), digits)


def _aligned(column: Sequence[str], right: bool) -> list[str]:
    width = max(map(len, column))
    return [cell.rjust(width) if right else cell.ljust(width) for cell in column]


def _is_numeric(column: Sequence[str]) -> bool:
    """Whether any cell below the heading looks like a number."""
    return any(re.match(r"[-.\d]", cell) for cell in column[1:])


def _plain(value: Any) -> Any:
    """Numbers, words, lists and dictionaries, which JSON has."""
    if isinstance(value, AbstractModel):
        return str(value)
    if is_dataclass(value):
        return {x.name: _plain(getattr(value, x.name)) for x in fields(value)}
    if hasattr(value, "_asdict"):  # a named tuple
        return _plain(value._asdict())
    if isinstance(value, dict):
        return {key: _plain(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(entry) for entry in value]
    if isinstance(value, jax.Array | np.ndarray | np.generic):
        return _plain(value.tolist())
    if not isinstance(value, float):
        return value
    return float(f"{value:.{_DIGITS}g}") if math.isfinite(value) else None
