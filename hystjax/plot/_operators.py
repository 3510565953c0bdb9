"""What operators of plays and relays are made of."""

from collections.abc import Mapping

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from .._core.errors import InputError
from ..models import PrandtlIshlinskii, Preisach
from ..signals import Signals
from . import _canvas


@_canvas.of_numbers
def preisach(
    model: Preisach,
    turns: np.ndarray | jax.Array | None = None,
    *,
    ax: Axes | None = None,
) -> Figure:
    """The plane of thresholds: the weight of each relay, and the staircase between
    those that are up, below and to the left of it, and those that are down.

    **Arguments:**

    - `model`: the model.
    - `turns`: inputs one after the other, each the end of a straight line, to whose
        last the staircase belongs; by default none is drawn.
    - `ax`: the panel to draw into.

    **Source:** Mayergoyz (1991), doi 10.1007/978-1-4612-3028-1.
    """
    ax = _canvas.single(ax, 5.2, 4.4)
    levels = np.asarray(model.levels)
    plane = np.ma.masked_array(
        np.asarray(model.plane()), np.triu(np.ones((len(levels) - 1,) * 2), 1) > 0
    )
    # Cells reach from one level to the next, on both axes: relay (i, j) is the one
    # whose thresholds are their upper right and lower left corner.
    size = float(np.max(np.abs(plane))) or 1.0
    signed = bool(np.min(plane) < 0)
    colours = ax.pcolormesh(
        levels,
        levels,
        plane,
        cmap="RdBu_r" if signed else "Blues",
        vmin=-size if signed else 0.0,
        vmax=size,
    )
    unit = _canvas.axis_label("weight", model.units[1])
    _canvas.root(ax).colorbar(colours, ax=ax, label=unit)
    _canvas.line(ax, levels[[0, -1]], levels[[0, -1]], color="black", linewidth=0.8)
    if turns is not None:
        heights = _heights(model, jnp.asarray(turns, model.levels.dtype))
        # Beyond the last input no relay of a column is up: its height is the diagonal.
        some = heights > np.arange(len(heights))
        tops = np.where(some, levels[heights], np.nan)
        x = np.repeat(levels, 2)[1:-1]
        _canvas.line(ax, x, np.repeat(tops, 2), "staircase", color="C1", linewidth=2)
    ax.locator_params(nbins=5)
    _canvas.legend_above(ax)
    name, of = model.names[0], model.units[0]
    _canvas.finish(
        ax,
        _canvas.axis_label(f"{name} that turns down", of),
        _canvas.axis_label(f"{name} that turns up", of),
    )
    return _canvas.root(ax)


def _heights(model: Preisach, turns: jax.Array) -> np.ndarray:
    if turns.ndim != 1 or not len(turns):
        raise InputError(
            f"`turns` must be inputs in order, shape (n,), got {turns.shape}."
        )
    memory = model.memory
    zero = jnp.zeros_like(turns[0])
    m = memory.start(Signals(zero, turns[0], zero))
    for u in turns[1:]:
        now = Signals(zero, u, zero)
        m = memory.after(m, now, now)
    return np.asarray(m)


@_canvas.of_numbers
def densities(
    models: PrandtlIshlinskii | Mapping[str, PrandtlIshlinskii],
    *,
    ax: Axes | None = None,
) -> Figure:
    """Weights of plays over their radii, as lines from zero; of several models with
    their labels.

    **Arguments:** a model, or several by label; and the panel to draw into.
    """
    ax = _canvas.single(ax, 6.0, 3.6)
    several = {"_": models} if isinstance(models, PrandtlIshlinskii) else dict(models)
    if not several:
        raise InputError("there is no model to draw: `models` is empty.")
    for (label, model), look in zip(several.items(), _canvas.looks(), strict=False):
        radii, weights = np.abs(model.radii), np.asarray(model.weights)
        order = np.argsort(radii)
        ax.vlines(radii[order], 0, weights[order], color=look["color"], linewidth=1.5)
        ax.plot(radii[order], weights[order], "o", color=look["color"], label=label)
    ax.axhline(0, color="black", linewidth=0.8)
    _canvas.legend_above(ax)
    first = next(iter(several.values()))
    per = f"{first.units[1]}/{first.units[0]}" if all(first.units) else ""
    _canvas.finish(
        ax,
        _canvas.axis_label("radius", first.units[0]),
        _canvas.axis_label("weight", per),
    )
    return _canvas.root(ax)
