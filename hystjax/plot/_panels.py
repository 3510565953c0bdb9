"""Single panels, from which the figures are put together."""

from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Array
from matplotlib.axes import Axes

from .. import metrics
from .._errors import InputError
from .._recording import Recording
from .._simulate import Trajectory
from . import _canvas

TIME = "time (s)"


def input_label(recording: Recording) -> str:
    """Name and unit of the input."""
    return _canvas.axis_label(recording.names[0], recording.units[0])


def output_label(recording: Recording) -> str:
    """Name and unit of the output."""
    return _canvas.axis_label(recording.names[1], recording.units[1])


def score(recording: Recording, trajectory: Trajectory) -> str:
    """The error of a free run, such as `NRMSE 0.233 %`."""
    _check_rows(recording, trajectory)
    return f"NRMSE {100 * float(metrics.nrmse(recording.w, trajectory.w)):.3g} %"


def draw_loop(
    ax: Axes,
    recording: Recording,
    trajectories: Sequence[Trajectory],
    labels: Sequence[str] | None = None,
) -> None:
    """Output over input."""
    _canvas.measured(ax, recording.u, recording.w)
    for trajectory, look in _looks(recording, trajectories, labels):
        _canvas.line(ax, trajectory.u, trajectory.w, **look)
    _keep_in_view(ax, recording, recording.w, trajectories)
    _canvas.finish(ax, input_label(recording), output_label(recording))


def draw_output(
    ax: Axes, recording: Recording, trajectory: Trajectory, label: str
) -> None:
    """Output over time."""
    _canvas.measured(ax, recording.t, recording.w)
    for simulated, look in _looks(recording, [trajectory], [label]):
        _canvas.line(ax, simulated.t, simulated.w, **look)
    _keep_in_view(ax, recording, recording.w, [trajectory])
    _canvas.finish(ax, "", output_label(recording))


def draw_error(
    ax: Axes,
    recording: Recording,
    trajectories: Sequence[Trajectory],
    labels: Sequence[str] | None = None,
) -> None:
    """Simulated minus measured output over time."""
    zero = np.zeros(len(recording))
    _canvas.line(ax, recording.t, zero, color=_canvas.MEASURED)
    for trajectory, look in _looks(recording, trajectories, labels):
        _canvas.line(ax, trajectory.t, trajectory.w - recording.w, **look)
    _keep_in_view(ax, recording, zero, trajectories)
    _canvas.finish(ax, TIME, _canvas.axis_label("error", recording.units[1]))


def _looks(recording, trajectories, labels):
    """Each trajectory with the label and the colour of its line."""
    if labels is None:
        labels = ["simulated"] if len(trajectories) == 1 else [
            f"simulated {i + 1}" for i in range(len(trajectories))
        ]
    if isinstance(labels, str) or len(labels) != len(trajectories):
        raise InputError(
            f"`labels` must hold one text for each of {len(trajectories)} trajectories,"
            f" got {labels!r}."
        )
    for trajectory, label, look in zip(
        trajectories, labels, _canvas.looks(), strict=False
    ):
        _check_rows(recording, trajectory)
        lost = _lost(trajectory)
        label += f" (diverges at {lost:g} s)" if lost is not None else ""
        yield trajectory, {"label": label, **look}


def _lost(trajectory: Trajectory) -> float | None:
    """When a simulation ceases to be finite, s."""
    rows = np.flatnonzero(~np.isfinite(np.asarray(trajectory.w)))
    return float(trajectory.t[rows[0]]) if rows.size else None


def _keep_in_view(ax, recording, shown, trajectories) -> None:
    """The scale of the measured output where one that diverges would flatten it."""
    if any(_lost(trajectory) is not None for trajectory in trajectories):
        margin = np.ptp(np.asarray(recording.w)) / 2
        ax.set_ylim(np.min(shown) - margin, np.max(shown) + margin)


def _check_rows(recording: Recording, trajectory: Trajectory) -> None:
    if np.array_equal(recording.t, trajectory.t) and trajectory.w.ndim == 1:
        return
    raise InputError(
        f"the trajectory, of shape {trajectory.w.shape}, does not have the times of the "
        f"recording, of {len(recording)} rows. Simulate along the recording that is "
        "drawn: `simulate(model, recording)`; pick one of a batch first."
    )
