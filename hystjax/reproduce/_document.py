"""What studies print and draw: tables that compare figures of the paper, of a rerun of
its scripts and of hystjax, and become files; and the paper's figure beside a better
one."""

import json
import math
import os
import re
import textwrap
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import ArrayLike, Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from .. import plot
from .._core import files
from .._core.show import escaped, markdown_table
from .._core.solution import RESULTS
from ..models import AbstractModel
from ..plot import _canvas
from ..recording import Recording
from ..simulation import Trajectory, simulate

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
        lines = "\n".join(f"- {escaped(note)}" for note in self.notes)
        table = markdown_table([[escaped(x) for x in row] for row in self.cells()])
        return f"# {self.title}\n\n{table}\n\n{lines}\n"

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


def shown_share(ratio: float) -> str:
    """A ratio as it is printed in per cent; what is left of rounding is zero."""
    return "0" if abs(ratio) < _ROUNDING else shown(100 * float(ratio), 3)


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


PUBLISHED = "As published: the fitted record"
Draw = Callable[[Axes, Recording, Sequence[Trajectory]], None]


@dataclass(frozen=True)
class Side:
    """One side of a figure.

    **Attributes:**

    - `title`: what is shown.
    - `record`: the loop.
    - `runs`: free runs along it, by the name of their law.
    - `known`: what the record is.
    """

    title: str
    record: Recording
    runs: Mapping[str, Trajectory]
    known: str = "true device"


def runs(laws: Mapping[str, AbstractModel], record: Recording) -> dict[str, Trajectory]:
    """Free runs of laws, by name."""
    return {name: simulate(law, record, throw=False) for name, law in laws.items()}


def as_run(record: Recording, w: Float[ArrayLike, " n"]) -> Trajectory:
    """Outputs at the times of a record, as a run along it."""
    done: Any = RESULTS.successful
    return Trajectory(record.t, record.u, jnp.asarray(w), done, {})


def published_side(
    laws: Mapping[str, AbstractModel], record: Recording, known: str = "true device"
) -> Side:
    """What the paper shows: laws of its scripts on the record that was fitted."""
    return Side(PUBLISHED, record, runs(laws, record), known)


def draw_sizes(ax: Axes, record: Recording, trajectories: Sequence[Trajectory]) -> None:
    """Sizes of errors over time, on a logarithmic scale."""
    for run, look in zip(trajectories, _canvas.looks(), strict=False):
        size = np.abs(np.asarray(run.w) - np.asarray(record.w))
        _canvas.line(ax, run.t, np.where(size > 0, size, np.nan), linewidth=0.7, **look)
    ax.set_yscale("log")
    label = _canvas.axis_label("size of the error", record.units[1])
    _canvas.finish(ax, _canvas.time_label(record), label)


def averaged(samples: int) -> Draw:
    """Draws errors as running means over so many samples, free of most noise."""

    def draw(ax, record, trajectories):
        half = samples // 2
        for run, look in zip(trajectories, _canvas.looks(), strict=False):
            error = np.asarray(run.w) - np.asarray(record.w)
            mean = np.convolve(error, np.full(samples, 1 / samples), "valid")
            inside = slice(half, half + len(mean))
            _canvas.line(ax, run.t[inside], mean, linewidth=1.0, **look)
        ax.axhline(0, color="black", linewidth=0.8)
        label = f"error, means of {samples} samples"
        _canvas.finish(
            ax, _canvas.time_label(record), _canvas.axis_label(label, record.units[1])
        )

    return draw


def side_by_side(*sides: Side, draw_errors: Draw = draw_sizes) -> Figure:
    """A column a side: the loop above, the errors over time below.

    **Arguments:** the `sides`; `draw_errors`: draws those of trajectories into axes.
    """
    figure = _canvas.figure(4.6 * len(sides), 6.4)
    panels = figure.subplots(2, len(sides), height_ratios=(1.7, 1), squeeze=False)
    for (top, bottom), side in zip(panels.T, sides, strict=True):
        trajectories, labels = [*side.runs.values()], [*side.runs]
        _canvas.draw_loop(top, side.record, trajectories, labels, called=side.known)
        top.locator_params(axis="x", nbins=6)  # labels side by side do not touch
        draw_errors(bottom, side.record, trajectories)
        top.set_title(side.title, fontsize="medium")
        _canvas.legend_below(bottom, top)
    if len({side.record.units for side in sides}) == 1:
        _one_scale(panels[1])
    return figure


def _one_scale(panels) -> None:
    """Errors beside each other are compared."""
    limits = np.array([ax.get_ylim() for ax in panels])
    for ax in panels:
        ax.set_ylim(limits[:, 0].min(), limits[:, 1].max())


def errors_over(
    setting: Sequence[float],
    name: str,
    panels: Mapping[str, Mapping[str, Sequence[float | None]]],
) -> Figure:
    """A panel a title, with a line a method; both axes are logarithmic.

    **Arguments:** the `setting`'s values and its `name`; squared errors in %, by title
    and method, one for each value, or none.
    """
    figure = _canvas.figure(4.6 * len(panels), 4.8)
    axes = figure.subplots(1, len(panels), sharey=True, squeeze=False)[0]
    for ax, (title, errors) in zip(axes, panels.items(), strict=True):
        for method, look in zip(errors, _canvas.looks(), strict=False):
            values = [float("nan") if x is None else x for x in errors[method]]
            _canvas.line(ax, setting, values, method, marker="o", **look)
        ax.set(xscale="log", yscale="log", title=title)
        ax.set_xticks(setting, [f"{each:g}" for each in setting], minor=False)
        ax.set_xticks([], minor=True)
        _canvas.finish(ax, name, "squared error (%)")
        _canvas.legend_below(ax)
    return figure


_STYLES = ("--", "-")  # of the curves, by level
_APART = 0.15  # marks of levels, so that none hides another


def under_noise(
    loop: Side,
    points: Mapping[str, Mapping[str, float]],
    curves: Mapping[str, Mapping[str, np.ndarray]],
) -> Figure:
    """Three panels.

    **Arguments:**

    - `loop`: what the paper shows.
    - `points`: squared errors, %, by series and method.
    - `curves`: squared errors of many seeds, ratios in order, by level of noise and
        method.
    """
    figure = _canvas.figure(13.0, 6.0)
    left, middle, right = figure.subplots(1, 3)
    _canvas.draw_loop(
        left, loop.record, [*loop.runs.values()], [*loop.runs], called=loop.known
    )
    left.set_title(loop.title)
    _draw_points(middle, points)
    middle.set_title("Table II, and free runs against the truth")
    _draw_curves(right, curves)
    right.set_title("Free runs against the truth, 200 seeds")
    for ax in (left, middle, right):
        ax.title.set_fontsize("medium")
        _canvas.legend_below(ax, columns=1)
    return figure


def _draw_points(ax: Axes, points) -> None:
    """A row a method, and of each level an open and a filled mark."""
    methods = list(dict.fromkeys(name for each in points.values() for name in each))
    for i, (series, errors) in enumerate(points.items()):
        colour = _canvas.COLOURS[i // 2]
        fill = colour if i % 2 else "none"
        rows = [methods.index(name) + _APART * (i // 2) for name in errors]
        look = {"markersize": 8, "markerfacecolor": fill, "color": colour}
        ax.plot([*errors.values()], rows, "o", label=series, **look)
    ax.set_xscale("log")
    ax.set_yticks(range(len(methods)), methods)
    ax.invert_yaxis()
    _canvas.finish(ax, "squared error (%)", "")


def _draw_curves(ax: Axes, curves) -> None:
    """Share of the seeds with an error below."""
    for (level, errors), style in zip(curves.items(), _STYLES, strict=True):
        for i, (method, ordered) in enumerate(errors.items()):
            share = 100 * np.arange(1, len(ordered) + 1) / len(ordered)
            look = {"color": _canvas.COLOURS[i], "linestyle": style}
            look |= {"drawstyle": "steps-post", "linewidth": 2.6 - 0.7 * i}
            _canvas.line(ax, 100 * ordered, share, f"{level}{method}", **look)
    ax.set_xscale("log")
    _canvas.finish(ax, "squared error (%)", "seeds with a smaller error (%)")
