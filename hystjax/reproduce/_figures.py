"""What the experiments draw: the paper's figure beside a better one."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import ArrayLike, Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from .._core.solution import RESULTS
from ..models import AbstractModel
from ..plot import _canvas
from ..recording import Recording
from ..simulation import Trajectory, simulate

PUBLISHED = "As published: the fitted record"
Draw = Callable[[Axes, Recording, Sequence[Trajectory]], None]


@dataclass(frozen=True)
class Side:
    """One side of a figure.

    **Attributes:**

    - `title`: what is shown.
    - `record`: the loop.
    - `runs`: free runs along it, by the name of their law.
    - `known`: what the record is.
    """

    title: str
    record: Recording
    runs: Mapping[str, Trajectory]
    known: str = "true device"


def runs(laws: Mapping[str, AbstractModel], record: Recording) -> dict[str, Trajectory]:
    """Free runs of laws, by name."""
    return {name: simulate(law, record, throw=False) for name, law in laws.items()}


def as_run(record: Recording, w: Float[ArrayLike, " n"]) -> Trajectory:
    """Outputs at the times of a record, as a run along it."""
    done: Any = RESULTS.successful
    return Trajectory(record.t, record.u, jnp.asarray(w), done, {})


def published_side(
    laws: Mapping[str, AbstractModel], record: Recording, known: str = "true device"
) -> Side:
    """What the paper shows: laws of its scripts on the record that was fitted."""
    return Side(PUBLISHED, record, runs(laws, record), known)


def draw_sizes(ax: Axes, record: Recording, trajectories: Sequence[Trajectory]) -> None:
    """Sizes of errors over time, on a logarithmic scale."""
    for run, look in zip(trajectories, _canvas.looks(), strict=False):
        size = np.abs(np.asarray(run.w) - np.asarray(record.w))
        _canvas.line(ax, run.t, np.where(size > 0, size, np.nan), linewidth=0.7, **look)
    ax.set_yscale("log")
    label = _canvas.axis_label("size of the error", record.units[1])
    _canvas.finish(ax, _canvas.time_label(record), label)


def averaged(samples: int) -> Draw:
    """Draws errors as running means over so many samples, free of most noise."""

    def draw(ax, record, trajectories):
        half = samples // 2
        for run, look in zip(trajectories, _canvas.looks(), strict=False):
            error = np.asarray(run.w) - np.asarray(record.w)
            mean = np.convolve(error, np.full(samples, 1 / samples), "valid")
            inside = slice(half, half + len(mean))
            _canvas.line(ax, run.t[inside], mean, linewidth=1.0, **look)
        ax.axhline(0, color="black", linewidth=0.8)
        label = f"error, means of {samples} samples"
        _canvas.finish(
            ax, _canvas.time_label(record), _canvas.axis_label(label, record.units[1])
        )

    return draw


def side_by_side(*sides: Side, draw_errors: Draw = draw_sizes) -> Figure:
    """A column a side: the loop above, the errors over time below.

    **Arguments:** the `sides`; `draw_errors`: draws those of trajectories into axes.
    """
    figure = _canvas.figure(4.6 * len(sides), 6.4)
    panels = figure.subplots(2, len(sides), height_ratios=(1.7, 1), squeeze=False)
    for (top, bottom), side in zip(panels.T, sides, strict=True):
        trajectories, labels = [*side.runs.values()], [*side.runs]
        _canvas.draw_loop(top, side.record, trajectories, labels, known=side.known)
        top.locator_params(axis="x", nbins=6)  # labels side by side do not touch
        draw_errors(bottom, side.record, trajectories)
        top.set_title(side.title, fontsize="medium")
        _canvas.legend_below(bottom, top)
    if len({side.record.units for side in sides}) == 1:
        _one_scale(panels[1])
    return figure


def _one_scale(panels) -> None:
    """Errors beside each other are compared."""
    limits = np.array([ax.get_ylim() for ax in panels])
    for ax in panels:
        ax.set_ylim(limits[:, 0].min(), limits[:, 1].max())


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


_STYLES = ("--", "-")  # of the curves, by level
_APART = 0.15  # marks of levels, so that none hides another


def under_noise(
    loop: Side,
    points: Mapping[str, Mapping[str, float]],
    curves: Mapping[str, Mapping[str, np.ndarray]],
) -> Figure:
    """Three panels.

    **Arguments:**

    - `loop`: what the paper shows.
    - `points`: squared errors, %, by series and method.
    - `curves`: squared errors of many seeds, ratios in order, by level of noise and
        method.
    """
    figure = _canvas.figure(13.0, 6.0)
    left, middle, right = figure.subplots(1, 3)
    _canvas.draw_loop(
        left, loop.record, [*loop.runs.values()], [*loop.runs], known=loop.known
    )
    left.set_title(loop.title)
    _draw_points(middle, points)
    middle.set_title("Table II, and free runs against the truth")
    _draw_curves(right, curves)
    right.set_title("Free runs against the truth, 200 seeds")
    for ax in (left, middle, right):
        ax.title.set_fontsize("medium")
        _canvas.legend_below(ax, columns=1)
    return figure


def _draw_points(ax: Axes, points) -> None:
    """A row a method, and of each level an open and a filled mark."""
    methods = list(dict.fromkeys(name for each in points.values() for name in each))
    for i, (series, errors) in enumerate(points.items()):
        colour = _canvas.COLOURS[i // 2]
        fill = colour if i % 2 else "none"
        rows = [methods.index(name) + _APART * (i // 2) for name in errors]
        look = {"markersize": 8, "markerfacecolor": fill, "color": colour}
        ax.plot([*errors.values()], rows, "o", label=series, **look)
    ax.set_xscale("log")
    ax.set_yticks(range(len(methods)), methods)
    ax.invert_yaxis()
    _canvas.finish(ax, "squared error (%)", "")


def _draw_curves(ax: Axes, curves) -> None:
    """Share of the seeds with an error below."""
    for (level, errors), style in zip(curves.items(), _STYLES, strict=True):
        for i, (method, ordered) in enumerate(errors.items()):
            share = 100 * np.arange(1, len(ordered) + 1) / len(ordered)
            look = {"color": _canvas.COLOURS[i], "linestyle": style}
            look |= {"drawstyle": "steps-post", "linewidth": 2.6 - 0.7 * i}
            _canvas.line(ax, 100 * ordered, share, f"{level}{method}", **look)
    ax.set_xscale("log")
    _canvas.finish(ax, "squared error (%)", "seeds with a smaller error (%)")
