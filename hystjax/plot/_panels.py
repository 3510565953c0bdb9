"""Single panels, from which the figures are put together."""

from collections.abc import Sequence

import jax
import numpy as np
from matplotlib.axes import Axes

from .._core.errors import InputError
from ..recording import Recording
from ..simulation import Trajectory, metrics
from . import _canvas

CERTAIN = 1.96  # standard errors to either side hold 95 % of a normal distribution

_nrmse = jax.jit(metrics.nrmse)


def time_label(recording: Recording) -> str:
    """What runs along the axis of `t`."""
    return "time (s)" if recording.clocked else "sample"


def input_label(recording: Recording) -> str:
    """Name and unit of the input."""
    return _canvas.axis_label(recording.names[0], recording.units[0])


def output_label(recording: Recording) -> str:
    """Name and unit of the output."""
    return _canvas.axis_label(recording.names[1], recording.units[1])


def score(recording: Recording, trajectory: Trajectory) -> str:
    """The error of a simulation, such as `NRMSE 0.233 %`, or when it diverges."""
    _check_rows(recording, trajectory)
    if (lost := _lost(trajectory)) is not None:
        return _diverges(recording, lost)
    per_cent = 100 * float(_nrmse(recording.w, trajectory.w))
    return f"NRMSE {f'{per_cent:#.3g}'.rstrip('.')} %"


def draw_loop(
    ax: Axes,
    recording: Recording,
    trajectories: Sequence[Trajectory],
    labels: Sequence[str] | None = None,
    known: str = "recorded",
) -> None:
    """Output over input; `known` is what the recording is called."""
    _canvas.recorded(ax, recording.u, recording.w, known)
    for trajectory, look in labelled(recording, trajectories, labels):
        _canvas.line(ax, trajectory.u, trajectory.w, **look)
    _keep_in_view(ax, recording, recording.w, trajectories)
    _canvas.finish(ax, input_label(recording), output_label(recording))


def draw_output(
    ax: Axes, recording: Recording, trajectory: Trajectory, label: str
) -> None:
    """Output over time."""
    _check_rows(recording, trajectory)
    _canvas.recorded(ax, recording.t, recording.w)
    _canvas.line(ax, trajectory.t, trajectory.w, label, **next(_canvas.looks()))
    _keep_in_view(ax, recording, recording.w, [trajectory])
    _canvas.finish(ax, "", output_label(recording))


def draw_error(
    ax: Axes,
    recording: Recording,
    trajectories: Sequence[Trajectory],
    labels: Sequence[str] | None = None,
) -> None:
    """Simulated minus recorded output over time."""
    for trajectory, look in labelled(recording, trajectories, labels):
        difference = np.asarray(trajectory.w) - np.asarray(recording.w)
        _canvas.line(ax, trajectory.t, difference, linewidth=0.6, **look)
    ax.axhline(0, color="black", linewidth=0.8)
    _keep_in_view(ax, recording, np.zeros(1), trajectories)
    _canvas.finish(
        ax, time_label(recording), _canvas.axis_label("error", recording.units[1])
    )


def labelled(recording, trajectories, labels):
    """Each trajectory with the label and the colour of its line."""
    if labels is None:
        several = len(trajectories) > 1
        numbers = range(1, len(trajectories) + 1)
        labels = [f"simulated {i}" if several else "simulated" for i in numbers]
    if isinstance(labels, str) or len(labels) != len(trajectories):
        raise InputError(
            f"`labels` must hold one text for each of {len(trajectories)} trajectories,"
            f" got {labels!r}."
        )
    given = zip(trajectories, labels, _canvas.looks(), strict=False)
    for trajectory, label, look in given:
        _check_rows(recording, trajectory)
        if (lost := _lost(trajectory)) is not None:
            label = f"{label} ({_diverges(recording, lost)})"
        yield trajectory, {"label": label, **look}


def _lost(trajectory: Trajectory) -> float | None:
    """When a simulation ceases to be finite."""
    rows = np.flatnonzero(~np.isfinite(np.asarray(trajectory.w)))
    return float(trajectory.t[rows[0]]) if rows.size else None


def _diverges(recording: Recording, when: float) -> str:
    where = f"{when:g} s" if recording.clocked else f"sample {when:g}"
    return f"diverges at {where}"


def _keep_in_view(ax, recording, shown, trajectories) -> None:
    """The scale of the recorded output where one that diverges would flatten it."""
    if any(_lost(trajectory) is not None for trajectory in trajectories):
        margin = np.ptp(np.asarray(recording.w)) / 2
        ax.set_ylim(np.min(shown) - margin, np.max(shown) + margin)


def _check_rows(recording: Recording, trajectory: Trajectory) -> None:
    if np.array_equal(recording.t, trajectory.t) and trajectory.w.ndim == 1:
        return
    raise InputError(
        f"the trajectory, of shape {trajectory.w.shape}, does not have the times of "
        f"the recording, of {len(recording)} rows. Simulate along the recording that "
        "is drawn: `simulate(model, recording)`; pick one of a batch first."
    )
