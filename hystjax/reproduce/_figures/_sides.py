"""Loops side by side, and how far laws are from them."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import ArrayLike, Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ..._recording import Recording
from ..._simulate import Trajectory, simulate
from ..._solution import RESULTS
from ...models import AbstractModel
from ...plot import _canvas, _panels

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
    _canvas.finish(ax, _panels.time_label(record), label)


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
            ax, _panels.time_label(record), _canvas.axis_label(label, record.units[1])
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
        _panels.draw_loop(top, side.record, trajectories, labels, known=side.known)
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
