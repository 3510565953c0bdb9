"""Figures of the paper, of a rerun of its scripts, and of hystjax side by side."""

from dataclasses import dataclass

from ._document import AbstractDocument, shown

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
