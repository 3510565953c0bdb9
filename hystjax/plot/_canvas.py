"""What all figures share: a figure without pyplot, colours, labels and legends, and
files."""

import functools
import io
import os
import textwrap
from collections.abc import Callable, Iterable, Iterator
from itertools import cycle, product
from pathlib import Path
from typing import ParamSpec, TypeVar

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from .._core import checks
from .._core.errors import InputError
from .._core.files import write_atomically

# Colours that the colour-blind tell apart, by Okabe and Ito, *Color Universal Design*
# (2008); the grey is our own.
MEASURED = "#a9a9a9"
COLOURS = ("#D55E00", "#0072B2", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")

_Inputs = ParamSpec("_Inputs")
_Figure = TypeVar("_Figure")
MANY = 20_000  # points from which a line is a picture inside a PDF or SVG
_WIDE = 26  # characters after which a label is wrapped


class NotebookFigure(Figure):
    """A figure that notebooks show although pyplot knows nothing of it."""

    def _repr_png_(self) -> bytes:
        stream = io.BytesIO()
        self.savefig(stream, format="png", dpi=100)
        return stream.getvalue()


def of_numbers(function: Callable[_Inputs, _Figure]) -> Callable[_Inputs, _Figure]:
    """A function that draws numbers: traced ones it refuses by its own name."""

    @functools.wraps(function)
    def checked(*args: _Inputs.args, **kwargs: _Inputs.kwargs) -> _Figure:
        checks.concrete(f"`hystjax.plot.{function.__name__}`", args, kwargs)
        return function(*args, **kwargs)

    return checked


def figure(width: float, height: float) -> NotebookFigure:
    """An empty figure, sizes in inches, whose layout keeps everything inside."""
    return NotebookFigure(figsize=(width, height), layout="constrained")


def single(ax: Axes | None, width: float, height: float) -> Axes:
    """The given axes, or those of a new figure."""
    return figure(width, height).add_subplot() if ax is None else ax


def stacked(axes: Iterable[Axes] | None, ratio: float) -> tuple[Axes, Axes]:
    """The two given axes, or new ones above each other that share their x axis."""
    if axes is None:
        new = figure(7.0, 4.6)
        top, bottom = new.subplots(2, 1, sharex=True, height_ratios=(ratio, 1))
        return top, bottom
    given = tuple(axes)
    if len(given) != 2:
        raise InputError(
            f"`axes` must be two axes, the upper and the lower one; got {len(given)}."
        )
    return given


def looks() -> Iterator[dict[str, str]]:
    """Colours, and the same colours in other dashes when they are used up."""
    pairs = product(("-", "--", ":", "-."), COLOURS)
    return cycle({"linestyle": style, "color": colour} for style, colour in pairs)


def line(ax: Axes, x, y, label: str = "_", **look) -> None:
    """One line; a label that begins with `_` stays out of the legend."""
    look = {"linewidth": 1.2, "solid_capstyle": "round"} | look
    (drawn,) = ax.plot(np.asarray(x), np.asarray(y), label=plain(label), **look)
    drawn.set_rasterized(len(x) > MANY)


def recorded(ax: Axes, x, y, label: str = "recorded") -> None:
    """What was recorded, measured or simulated: broad and pale, so that a law drawn on
    it leaves both visible."""
    line(ax, x, y, label, color=MEASURED, linewidth=3.2)


def axis_label(name: str, unit: str) -> str:
    """Such as `displacement (µm)`."""
    text = plain(f"{name} ({unit})" if unit else name)
    return textwrap.fill(text, _WIDE)


def plain(text: str) -> str:
    """Text in which a dollar is a dollar, and no mathematics begins."""
    return text.replace("$", r"\$")


def finish(ax: Axes, x: str, y: str) -> None:
    """Axis labels, and quiet lines around the data."""
    ax.set_xlabel(x)
    ax.set_ylabel(y)
    ax.yaxis.get_offset_text().set_horizontalalignment("right")  # beside a legend
    ax.spines[["top", "right"]].set_visible(False)
    ax.grid(color="0.92", linewidth=0.8)
    ax.set_axisbelow(True)


def legend_above(ax: Axes, columns: int = 2) -> None:
    """A legend that hides nothing, if there is something to say."""
    if ax.get_legend_handles_labels()[0]:
        ax.legend(
            loc="lower left",
            bbox_to_anchor=(0, 1),
            ncols=columns,
            frameon=False,
            borderaxespad=0.2,
            handlelength=1.5,
            columnspacing=1.5,
        )


def legend_below(ax: Axes, source: Axes | None = None, columns: int = 2) -> None:
    """A legend under the label of the x axis, of what `source` shows, by default the
    axes themselves."""
    handles, labels = (source or ax).get_legend_handles_labels()
    ax.legend(
        handles,
        labels,
        loc="upper center",
        bbox_to_anchor=(0.5, 0),
        borderaxespad=4.5,  # font sizes: below the ticks and the label
        ncols=columns,
        frameon=False,
    )


def root(ax: Axes) -> Figure:
    """The figure of some axes, also when they lie in a part of it."""
    return ax.figure.figure  # pyright: ignore[reportReturnType]


_FORMATS = (".png", ".pdf", ".svg")


def save(figure: Figure, path: str | os.PathLike) -> None:
    """Write a figure; the file is there whole or not at all.

    **Arguments:**

    - `figure`: what a function of this module returned, or any other figure.
    - `path`: ends with `.png`, `.pdf` or `.svg`.

    **Raises:** `InputError` for another ending, or a file that cannot be written.
    """
    ending = Path(path).suffix.lower()
    if ending not in _FORMATS:
        raise InputError(
            f"`path` must end with one of {', '.join(_FORMATS)}, which says what to "
            f"write; got {str(path)!r}."
        )
    write_atomically(path, lambda out: figure.savefig(out, format=ending[1:], dpi=200))
