"""Errors over a setting, panels side by side."""

from collections.abc import Mapping, Sequence

from matplotlib.figure import Figure

from ...plot import _canvas


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
