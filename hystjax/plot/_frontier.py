"""How well laws do by their number of terms."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from .._solution import Solution
from . import _canvas


def frontier(found: Solution, *, ax: Axes | None = None) -> Figure:
    """Errors of all laws that `discover` tried, by their number of terms: the best of
    each connected, the chosen one named.

    **Arguments:** the `Solution` of `discover`; and the panel to draw into.
    """
    ax = _canvas.single(ax, 6.4, 4.0)
    tried, best = found.stats["candidates"], found.stats["frontier"]
    unit = f" ({found.value.units[1]})" if found.value.units[1] else ""
    sizes = [len(candidate.terms) for candidate in tried]
    errors = [candidate.rmse for candidate in tried]
    ax.scatter(sizes, errors, s=12, color="0.7", label="tried", zorder=1)
    line = [candidate.rmse for candidate in best.values()]
    ax.plot(list(best), line, "o-", color="C0", label="best of its size", zorder=2)
    chosen = tried[0]
    label = "chosen: " + ", ".join(chosen.terms)
    ax.plot(
        len(chosen.terms), chosen.rmse, "o", ms=12, mfc="none", color="C3", label=label
    )
    ax.set_yscale("log" if np.ptp(np.log(errors)) > 1 else "linear")
    ax.xaxis.set_major_locator(MaxNLocator(integer=True))
    _canvas.finish(ax, "number of terms", f"rms error of the free run{unit}")
    _canvas.legend_above(ax, columns=3)
    return _canvas.root(ax)
