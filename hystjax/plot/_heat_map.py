"""Values over a grid, as colours."""

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from .._errors import InputError
from . import _canvas

if TYPE_CHECKING:
    import xarray

_TICKS = 6  # labels that fit along a panel


def heat_map(
    values: "xarray.DataArray",
    label: str = "",
    *,
    limits: tuple[float, float] | None = None,
    ax: Axes | None = None,
) -> Figure:
    """A part of the dataset of `hystjax.sweep` as cells of equal size.

        share = found["support"].all("term").mean("seed")
        hj.plot.heat_map(share.transpose("samples", "noise", "threshold"), "share")

    **Arguments:**

    - `values`: numbers along two axes, upwards and to the right; or along three, with
        a panel for each value of the first. Lanes without a number stay empty.
    - `label`: what the colours say.
    - `limits`: values of the first and the last colour, by default the extremes.
    - `ax`: the panel to draw into, for two axes.

    **Raises:** `InputError` for another number of axes.
    """
    if values.ndim not in ((2, 3) if ax is None else (2,)):
        given = ", ".join(map(str, values.dims)) or "none"
        raise InputError(
            f"`values` must have two axes, or, without `ax`, three; got {given}. "
            "Average over the others, or pick one of their values."
        )
    parts = [values] if values.ndim == 2 else list(values)
    if ax is None:
        figure = _canvas.figure(1.6 + 3.0 * len(parts), 3.6)
        panels = figure.subplots(1, len(parts), sharey=True, squeeze=False)[0]
    else:
        figure, panels = _canvas.root(ax), [ax]
    low, high = limits or (float(values.min()), float(values.max()))
    look = {"cmap": "viridis", "vmin": low, "vmax": high}
    for panel, part in zip(panels, parts, strict=True):
        image = panel.imshow(part.values, origin="lower", aspect="auto", **look)
        _label(panel, part)
        if values.ndim == 3:
            panel.set_title(_title(part[values.dims[0]]), fontsize="medium")
    for panel in panels[1:]:
        panel.set_ylabel("")
    figure.colorbar(image, ax=list(panels), label=_canvas.plain(label))
    return figure


def _title(value: "xarray.DataArray") -> str:
    (written,) = _written(value.values[None])
    unit = value.attrs.get("units", "")
    return _canvas.plain(f"{value.name} = {written} {unit}".strip())


def _label(ax: Axes, part: "xarray.DataArray") -> None:
    for axis, name in zip((ax.yaxis, ax.xaxis), part.dims, strict=True):
        coordinate = part[name]
        places = np.arange(len(coordinate))[:: -(-len(coordinate) // _TICKS)]
        axis.set_ticks(places, _written(coordinate.values[places]))
        unit = coordinate.attrs.get("units", "")
        axis.set_label_text(_canvas.axis_label(str(name), unit))


def _written(values: np.ndarray) -> list[str]:
    inexact = np.issubdtype(values.dtype, np.inexact)
    return [f"{v:.3g}" if inexact else _canvas.plain(str(v)) for v in values]
