"""Loops side by side, and how far laws are from them."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure

from ..._recording import Recording
from ..._simulate import Trajectory, simulate
from ...models import AbstractModel
from ...plot import _canvas, _panels


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


def paper_side(
    laws: Mapping[str, AbstractModel], record: Recording, known: str = "true device"
) -> Side:
    """What the paper shows: on the record that was fitted, the first of the laws."""
    name, law = next(iter(laws.items()))
    return Side(
        "As in the paper: the fitted record", record, runs({name: law}, record), known
    )


def side_by_side(*sides: Side, orders: bool = True) -> Figure:
    """A column a side: the loop above, the errors over time below.

    **Arguments:** the `sides`; `orders`: whether errors differ by orders of magnitude,
    so that their sizes are drawn on a logarithmic scale.
    """
    figure = _canvas.figure(4.6 * len(sides), 6.4)
    panels = figure.subplots(2, len(sides), height_ratios=(1.7, 1), squeeze=False)
    draw_errors = _draw_sizes if orders else _panels.draw_error
    for (top, bottom), side in zip(panels.T, sides, strict=True):
        trajectories, labels = [*side.runs.values()], [*side.runs]
        _panels.draw_loop(top, side.record, trajectories, labels, known=side.known)
        draw_errors(bottom, side.record, trajectories)
        top.set_title(side.title, fontsize="medium")
    _one_scale(panels[1])
    _one_legend(figure, panels[0])
    return figure


def _one_scale(panels) -> None:
    """Errors beside each other are compared."""
    limits = np.array([ax.get_ylim() for ax in panels])
    for ax in panels:
        ax.set_ylim(limits[:, 0].min(), limits[:, 1].max())


def _one_legend(figure: Figure, panels) -> None:
    """Below, of all names in the panels; a name has the same look in each."""
    lines = {}
    for ax in panels:
        handles, labels = ax.get_legend_handles_labels()
        lines |= dict(zip(labels, handles, strict=True))
    place = {"loc": "outside lower center", "ncols": len(lines), "frameon": False}
    figure.legend([*lines.values()], [*lines], **place)


def _draw_sizes(ax, record: Recording, trajectories) -> None:
    for run, look in zip(trajectories, _canvas.looks(), strict=False):
        size = np.abs(np.asarray(run.w) - np.asarray(record.w))
        _canvas.line(ax, run.t, np.where(size > 0, size, np.nan), linewidth=0.7, **look)
    ax.set_yscale("log")
    label = _canvas.axis_label("size of the error", record.units[1])
    _canvas.finish(ax, _panels.TIME, label)
