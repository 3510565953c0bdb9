"""Curves as a figure."""

from collections.abc import Mapping, Sequence
from itertools import cycle
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullLocator

_COLUMNS = 3
_ENDS = ("lower", "upper")
# Okabe and Ito's, by who it is, so that a peer looks alike in all panels.
_COLOURS = {"hystjax": "#D55E00", "NumPy": "#0072B2", "PySINDy": "#009E73"}
_COLOURS |= {"SciPy": "#CC79A7"}


def drawn(tables: Sequence[Mapping[str, Any]]) -> Figure:
    """A panel for each of what `Curves.as_dict` gives: medians with quartiles."""
    rows = -(-len(tables) // _COLUMNS)
    figure = Figure(figsize=(11, 4.4 * rows), layout="constrained")
    panels = figure.subplots(rows, _COLUMNS, squeeze=False).ravel()
    for ax, table in zip(panels, tables, strict=False):
        _panel(ax, table)
    for ax in panels[len(tables) :]:
        ax.set_axis_off()
    return figure


def _panel(ax: Axes, table: Mapping[str, Any]) -> None:
    styles: dict[str, Any] = {}
    for name, points in table["curves"].items():
        who = next((peer for peer in _COLOURS if peer in name), "")
        look = styles.setdefault(who, cycle(("o-", "s--", "^:")))
        sizes, medians = ([p[key] for p in points] for key in ("size", "median"))
        lower, upper = ([p[f"{end}_quartile"] for p in points] for end in _ENDS)
        colour = _COLOURS.get(who, "0.4")
        ax.fill_between(sizes, lower, upper, color=colour, alpha=0.2, linewidth=0)
        ax.plot(sizes, medians, next(look), color=colour, label=name, markersize=4)
    ax.set(xscale="log", yscale="log", xlabel=table["over"], ylabel="time a call (s)")
    low, high = ax.get_ylim()
    if high < 10 * low:  # a whole decade: noise should not look like a trend
        ax.set_ylim(low / 3, high * 3)
    sizes = sorted({p["size"] for points in table["curves"].values() for p in points})
    if sizes[-1] < 10 * sizes[0]:
        ax.set_xticks(sizes, [str(size) for size in sizes])
        ax.xaxis.set_minor_locator(NullLocator())
    ax.set_title(table["title"], fontsize="medium", wrap=True)
    ax.grid(color="0.92", linewidth=0.8)
    ax.set_axisbelow(True)
    ax.spines[["top", "right"]].set_visible(False)
    ax.legend(
        frameon=False,
        fontsize="small",
        loc="upper center",
        bbox_to_anchor=(0.5, 0),
        borderaxespad=4.5,  # font sizes: below the ticks and the label
    )
