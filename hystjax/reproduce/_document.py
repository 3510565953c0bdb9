"""Tables that print, and become files."""

import json
import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from matplotlib.figure import Figure

from ..report import markdown_table

_DIGITS = 6  # in files: what is left after these is rounding


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
        table = self.cells()
        widths = [max(map(len, column)) for column in zip(*table, strict=True)]
        lines = []
        for name, *values in table:
            padded = zip(values, widths[1:], strict=True)
            line = "  ".join([name.ljust(widths[0]), *(v.rjust(n) for v, n in padded)])
            lines.append(line.rstrip())
        return "\n".join([self.title, "", *lines, "", *self.notes])

    def markdown(self) -> str:
        """The table as a page in Markdown."""
        lines = "\n".join(f"- {note}" for note in self.notes)
        return f"# {self.title}\n\n{markdown_table(self.cells())}\n\n{lines}\n"

    def json(self) -> str:
        """The table for programs, numbers to six digits, so that a difference between
        two of them is one of results."""
        rows = [_plain(asdict(row)) for row in self.rows]
        content = {"title": self.title, "rows": rows, "notes": self.notes}
        return json.dumps(content, indent=2, ensure_ascii=False) + "\n"


def shown(value: float | str | None, digits: int = 5) -> str:
    """A figure or word as it is printed; a dash for none."""
    if value is None:
        return "-"
    if isinstance(value, str):
        return value
    return f"{value:.{digits}g}" if math.isfinite(value) else "diverged"


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _plain(entry) for key, entry in value.items()}
    if not isinstance(value, float):
        return value
    return float(f"{value:.{_DIGITS}g}") if math.isfinite(value) else None
