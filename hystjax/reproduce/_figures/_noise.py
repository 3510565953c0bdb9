"""Experiment 4: one noisy record, the paper's table, and many seeds."""

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ...plot import _canvas, _panels
from ._sides import Side

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
    _panels.draw_loop(
        left, loop.record, [*loop.runs.values()], [*loop.runs], known=loop.known
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
