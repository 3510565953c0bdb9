"""Figures of the paper, of a rerun of its scripts, and of hystjax side by side."""

from dataclasses import dataclass

_COLUMNS = ("", "paper", "rerun", "hystjax")


@dataclass(frozen=True)
class Row:
    """One figure from three sources.

    **Attributes:**

    - `quantity`: what it is, with its unit.
    - `paper`: as printed; `None` where the paper has none.
    - `rerun`: by the paper's scripts with PySINDy 2.1.0; `None` where not measured.
    - `ours`: by hystjax.
    """

    quantity: str
    paper: float | str | None
    rerun: float | str | None
    ours: float | str

    def cells(self) -> tuple[str, ...]:
        """The row as text."""
        values = (self.paper, self.rerun, self.ours)
        return (self.quantity, *(_shown(value) for value in values))


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
        table = [_COLUMNS, *(row.cells() for row in self.rows)]
        widths = [max(map(len, column)) for column in zip(*table, strict=True)]
        lines = []
        for name, *values in table:
            padded = zip(values, widths[1:], strict=True)
            line = "  ".join([name.ljust(widths[0]), *(v.rjust(n) for v, n in padded)])
            lines.append(line.rstrip())
        return "\n".join([self.title, "", *lines, "", *self.notes])


def _shown(value: float | str | None) -> str:
    if value is None:
        return "-"
    return value if isinstance(value, str) else f"{value:.5g}"
