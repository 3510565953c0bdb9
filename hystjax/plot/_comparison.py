"""Families of models on a record."""

import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from ..comparison import Comparison
from ..recording import Recording
from ..simulation import simulate
from . import _canvas, _panels

_SHOWN = 3  # families whose loops are drawn
_FAR = 50.0  # times the least error, beyond which a family is not placed on the axis


@_canvas.of_numbers
def comparison(found: Comparison, recording: Recording) -> Figure:
    """Errors of all families on blocks left out, with their standard errors, and on all
    samples; and beside them the loops of the best three.

    **Arguments:** what `hystjax.compare` returned; and a record to draw loops of, such
    as the one compared on.
    """
    shown = [row for row in found.rows[:_SHOWN] if math.isfinite(row.error)]
    figure = _canvas.figure(4.6 + 3.2 * len(shown), 4.4)
    left, *right = figure.subplots(
        1, 1 + len(shown), width_ratios=[1.4, *[1] * len(shown)]
    )
    _errors(left, found)
    for ax, row in zip(right, shown, strict=True):
        run = simulate(row.model, recording, throw=False)
        _panels.draw_loop(ax, recording, [run], [row.family])
        _canvas.legend_above(ax, columns=1)
    return figure


def _errors(ax: Axes, found: Comparison) -> None:
    """One row a family, the best at the top, in % of the output's range."""
    most = _FAR * found.best.error
    rows = [row for row in found.rows if row.error <= most]
    places = np.arange(len(rows))[::-1]
    errors = np.array([100 * row.error for row in rows])
    spread = np.nan_to_num([100 * row.standard_error for row in rows])
    # On a logarithmic axis an error bar does not reach zero.
    below = np.minimum(spread, 0.9 * errors)
    ax.errorbar(
        errors,
        places,
        xerr=[below, spread],
        fmt="o",
        color=_canvas.COLOURS[0],
        label="blocks left out",
    )
    own = [100 * row.own for row in rows]
    ax.plot(own, places, "|", color="0.4", markersize=10, label="all samples")
    ax.set_xscale("log")
    ax.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    ax.xaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
    ax.xaxis.set_minor_formatter(NullFormatter())
    names = [row.family for row in rows]
    ax.set_yticks(places, names)
    _canvas.finish(ax, "error (% of the output's range)", "")
    _canvas.legend_above(ax)
