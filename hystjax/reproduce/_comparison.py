"""Figures of the paper, of a rerun of its scripts, and of hystjax side by side."""

import json
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass

from ..report import markdown_table

_COLUMNS = ("", "paper", "rerun", "hystjax")
_RELATIVE = "relative error, %"
_DIGITS = 6  # in files: what is left after these is rounding


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
class Comparison:
    """The table of one experiment.

    **Attributes:**

    - `title`: the experiment.
    - `rows`: its figures.
    - `notes`: lines below the table.
    """

    title: str
    rows: tuple[Row, ...]
    notes: tuple[str, ...] = ()

    def text(self) -> str:
        """The table for a terminal."""
        table = self._table()
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
        return f"# {self.title}\n\n{markdown_table(self._table())}\n\n{lines}\n"

    def json(self) -> str:
        """The table for programs, numbers to six digits, so that a difference between
        two of them is one of results."""
        rows = [
            {key: _plain(value) for key, value in asdict(row).items()}
            for row in self.rows
        ]
        content = {"title": self.title, "rows": rows, "notes": self.notes}
        return json.dumps(content, indent=2, ensure_ascii=False) + "\n"

    def _table(self) -> Sequence[Sequence[str]]:
        """Headings and cells, with relative errors only where there are any."""
        width = 5 if any(row.relative is not None for row in self.rows) else 4
        cells = [(row.quantity, *map(_shown, row.values())) for row in self.rows]
        return [row[:width] for row in [(*_COLUMNS, _RELATIVE), *cells]]


def _shown(value: float | str | None) -> str:
    if value is None:
        return "-"
    if isinstance(value, str):
        return value
    return f"{value:.5g}" if math.isfinite(value) else "diverged"


def _plain(value: float | str | None) -> float | str | None:
    if not isinstance(value, float):
        return value
    return float(f"{value:.{_DIGITS}g}") if math.isfinite(value) else None
