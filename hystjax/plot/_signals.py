"""Inputs, outputs, loops and errors of one recording."""

from collections.abc import Iterable, Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from .._recording import Recording
from .._simulate import Trajectory
from . import _canvas, _panels


def record(recording: Recording, *, axes: Iterable[Axes] | None = None) -> Figure:
    """Input above, output below, over time; `axes` are the two panels."""
    top, bottom = _canvas.stacked(axes, 1)
    _canvas.line(top, recording.t, recording.u, color=_canvas.COLOURS[1])
    _canvas.line(bottom, recording.t, recording.w, color=_canvas.COLOURS[0])
    _canvas.finish(top, "", _panels.input_label(recording))
    across = _panels.time_label(recording)
    _canvas.finish(bottom, across, _panels.output_label(recording))
    return _canvas.root(top)


def loop(
    recording: Recording,
    *trajectories: Trajectory,
    labels: Sequence[str] | None = None,
    ax: Axes | None = None,
) -> Figure:
    """Output over input: the recorded loop, and simulated ones on it.

    **Arguments:**

    - `recording`: the record that the loop is of.
    - `trajectories`: any number of simulations of its rows.
    - `labels`: one for each trajectory, for the legend.
    - `ax`: axes to draw into; a new figure by default.

    **Raises:** `InputError` when a trajectory or the labels do not fit.
    """
    ax = _canvas.single(ax, 5.2, 4.6)
    _panels.draw_loop(ax, recording, trajectories, labels)
    _canvas.legend_above(ax)
    return _canvas.root(ax)


def fit(
    recording: Recording, trajectory: Trajectory, *, axes: Iterable[Axes] | None = None
) -> Figure:
    """Recorded and simulated output over time, and their difference below.

    `axes` are the two panels. **Raises:** `InputError` when the trajectory does not
    have the recording's rows.
    """
    top, bottom = _canvas.stacked(axes, 2.2)
    _panels.draw_output(top, recording, trajectory, "simulated")
    _panels.draw_error(bottom, recording, [trajectory])
    top.set_title(_panels.score(recording, trajectory), loc="right", fontsize="medium")
    _canvas.legend_above(top)
    return _canvas.root(top)


def error(
    recording: Recording,
    *trajectories: Trajectory,
    labels: Sequence[str] | None = None,
    ax: Axes | None = None,
) -> Figure:
    """Simulated minus recorded output over time; arguments as for `loop`."""
    ax = _canvas.single(ax, 7.0, 3.0)
    _panels.draw_error(ax, recording, trajectories, labels)
    _canvas.legend_above(ax)
    return _canvas.root(ax)
