"""What models are made of: operators, friction, the parts of a magnetisation."""

from collections.abc import Mapping

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from .._core.checks import InputError
from ..models import JilesAtherton, LuGre, PrandtlIshlinskii, Preisach
from ..recording import Recording
from ..signals import Signals
from ..simulation import Trajectory
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


_POINTS = 401
_MEGA = 1e6
_BEYOND = 6.0  # Stribeck velocities that are shown where no record says how many


@_canvas.of_numbers
def friction(
    model: LuGre,
    recording: Recording | None = None,
    *,
    fastest: float | None = None,
    ax: Axes | None = None,
) -> Figure:
    """The Stribeck curve: the force of steady sliding over velocity, and what a record
    has beside it.

    **Arguments:**

    - `model`: a friction law with a `steady` force.
    - `recording`: shown as recorded forces over velocities, where given.
    - `fastest`: end of the velocity axis, m/s (input units a second); by default that
        of the record, or six times the model's Stribeck velocity.
    - `ax`: axes to draw into; a new figure by default.

    **Raises:** `InputError` for a record without a clock, which has no velocities.
    """
    ax = _canvas.single(ax, 5.6, 4.2)
    end = _BEYOND * float(model.stribeck) if fastest is None else fastest
    if recording is not None:
        if not recording.clocked:
            raise InputError("`recording` has no clock, so no velocity to draw over.")
        _, velocity = recording.path.samples()
        _canvas.recorded(ax, velocity, recording.w)
        end = float(np.max(np.abs(velocity))) if fastest is None else fastest
    # Not through 0, where steady forces jump.
    ahead = np.geomspace(1e-3 * end, end, _POINTS)
    colour = _canvas.COLOURS[0]
    label = "steady sliding"
    for way in (1, -1):
        velocities = way * ahead
        _canvas.line(ax, velocities, model.steady(velocities), label, color=colour)
        label = "_"
    level = float(model.coulomb)
    for force in (level, -level):
        ax.axhline(force, color="black", linewidth=0.8, linestyle=":")
    ax.set_xlim(-1.05 * end, 1.05 * end)
    source = model if recording is None else recording
    unit = f"{source.units[0]}/s" if source.units[0] else "1/s"
    _canvas.finish(
        ax,
        _canvas.axis_label("velocity", unit),
        _canvas.axis_label(source.names[1], source.units[1]),
    )
    _canvas.legend_above(ax)
    return _canvas.root(ax)


@_canvas.of_numbers
def magnetisation(
    model: JilesAtherton, trajectory: Trajectory, *, ax: Axes | None = None
) -> Figure:
    """Parts of the magnetisation over the field strength, along a simulation of the
    model: the anhysteretic curve that it is drawn to, what is irreversible and what is
    reversible.

    **Arguments:** the model; what `hystjax.simulate` made of it; the axes to draw into,
    by default those of a new figure.
    """
    ax = _canvas.single(ax, 6.2, 4.6)
    field = np.asarray(trajectory.u)
    parts = model.components(field, trajectory.w)
    _canvas.recorded(ax, field, parts.total / _MEGA, "magnetisation")
    drawn = {
        "anhysteretic": parts.anhysteretic,
        "irreversible": parts.irreversible,
        "reversible": parts.reversible,
    }
    for (label, part), look in zip(drawn.items(), _canvas.looks(), strict=False):
        _canvas.line(ax, field, part / _MEGA, label, **look)
    _canvas.finish(ax, "field strength (A/m)", "magnetisation (MA/m)")
    _canvas.legend_above(ax)
    return _canvas.root(ax)
