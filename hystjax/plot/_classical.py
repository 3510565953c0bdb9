"""What classical models are made of: a friction curve, the parts of a magnetisation."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from .._core.errors import InputError
from ..models import JilesAtherton, LuGre
from ..recording import Recording
from ..simulation import Trajectory
from . import _canvas

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
