"""How sure the terms of a law are."""

from collections.abc import Mapping

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from . import _canvas

_LEAST = 0.005  # share that is worth a bar


def inclusion(shares: Mapping[str, float], *, ax: Axes | None = None) -> Figure:
    """Bars of the shares that `hystjax.inclusion` gives, those of 0 left out.

    **Arguments:** the shares by term; and the panel to draw into.
    """
    shown = {name: share for name, share in shares.items() if share >= _LEAST}
    ax = _canvas.single(ax, 6.4, 1.2 + 0.3 * len(shown))
    bars = ax.barh(list(shown), [100 * share for share in shown.values()], color="C0")
    ax.bar_label(bars, fmt="%.3g", padding=3)
    ax.invert_yaxis()
    ax.set_xlim(0, 108)
    _canvas.finish(ax, "chosen in so many of 100 resampled records", "")
    ax.grid(visible=False, axis="y")
    return _canvas.root(ax)
