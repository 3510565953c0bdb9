"""Which terms halves of the equations select, by threshold."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from .._stability import Stability
from . import _canvas

_ENTRY = 0.22  # inches of the figure's height an entry of the legend asks for


def stability(
    found: Stability, *, cutoff: float = 0.9, ax: Axes | None = None
) -> Figure:
    """The stability path: the share of the halves that select a term, by threshold, one
    line a term. Those that reach the cut-off are named, the others pale.

    **Arguments:** what `hystjax.stability` returned; the cut-off; and the panel to draw
    into.

    **Raises:** `InputError` for a cut-off that is not above 0.5 and at most 1.

    **Source:** Meinshausen and Bühlmann (2010), doi 10.1111/j.1467-9868.2010.00740.x.
    """
    stable = [found.names.index(name) for name in found.terms(cutoff)]
    ax = _canvas.single(ax, 7.0, max(3.8, 0.8 + _ENTRY * len(stable)))
    order = np.argsort(np.asarray(found.thresholds))
    thresholds = np.asarray(found.thresholds)[order]
    lines = np.asarray(found.probabilities)[order].T
    for i, look in zip(stable, _canvas.looks(), strict=False):
        _canvas.line(ax, thresholds, lines[i], found.names[i], **look)
    others = np.delete(lines, stable, axis=0)
    for line, label in zip(others, ["other terms"] + len(lines) * ["_"], strict=False):
        _canvas.line(ax, thresholds, line, label, color=_canvas.MEASURED, zorder=1)
    ax.axhline(cutoff, color="black", linewidth=0.8, linestyle=":")
    ax.set_xscale("log")
    ax.set_ylim(-0.02, 1.02)
    _canvas.finish(ax, "threshold", "share of halves that select the term")
    ax.legend(loc="upper left", bbox_to_anchor=(1, 1), frameon=False)
    return _canvas.root(ax)
