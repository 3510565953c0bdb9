"""Tables that print, compare figures of the paper, of a rerun of its scripts and of
hystjax, and become files."""

import json
import math
import os
import re
import textwrap
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path
from typing import Any

import jax
import numpy as np
from matplotlib.figure import Figure

from .. import plot
from .._core import files
from .._core.show import markdown_table
from ..models import AbstractModel

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


_COLUMNS = ("", "paper", "rerun", "hystjax")
_RELATIVE = "relative error, %"


@dataclass(frozen=True)
class Row:
    """One figure from three sources.

    **Attributes:**

    - `quantity`: what it is, with its unit.
    - `paper`: as printed; `None` where the paper has none.
    - `rerun`: by the paper's scripts with PySINDy 2.1.0; `None` where not measured.
    - `hystjax`: by hystjax.
    - `relative`: for squared errors, ours by the formula that the paper prints, %.
    """

    quantity: str
    paper: float | str | None
    rerun: float | str | None
    hystjax: float | str
    relative: float | None = None

    def values(self) -> tuple[float | str | None, ...]:
        """The figures, in the order of the columns."""
        return self.paper, self.rerun, self.hystjax, self.relative


@dataclass(frozen=True)
class Comparison(AbstractDocument):
    """The table of one experiment.

    **Attributes:**

    - `title`: the experiment.
    - `rows`: its figures.
    - `notes`: lines below the table.
    - `drawing`: makes the figure.
    """

    rows: tuple[Row, ...]

    def cells(self):
        """Headings and figures, with relative errors only where there are any."""
        width = 5 if any(row.relative is not None for row in self.rows) else 4
        cells = [(row.quantity, *map(shown, row.values())) for row in self.rows]
        return [row[:width] for row in [(*_COLUMNS, _RELATIVE), *cells]]


def write(folder: str | os.PathLike, name: str, document: AbstractDocument) -> None:
    """Write `<name>.json`, `.md` and, where there is a figure, `.png`, each in one
    move; `experiment_<name>` for numbers.

    **Arguments:** the `folder`, made when it does not exist; the `name` of what was
    reproduced; its `document`.

    **Raises:** `InputError` when the folder cannot be written.
    """
    place = files.made_folder(folder)
    stem = f"experiment_{name}" if name.isdigit() else name
    files.write_text(Path(place, f"{stem}.json"), document.json())
    files.write_text(Path(place, f"{stem}.md"), document.markdown())
    if document.drawing is not None:
        plot.save(document.drawing(), Path(place, f"{stem}.png"))
