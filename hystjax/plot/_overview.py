"""The figure that tells the whole."""

import re

from matplotlib.figure import Figure

from .._errors import InputError
from .._recording import Recording
from .._simulate import Trajectory
from ..export import to_latex
from ..models import AbstractModel
from . import _canvas, _panels

_ADDENDS = 6  # on one line of the title


def overview(
    recording: Recording,
    trajectory: Trajectory,
    test_recording: Recording | None = None,
    test_trajectory: Trajectory | None = None,
    *,
    model: AbstractModel | None = None,
) -> Figure:
    """The loop, the outputs over time with their errors below, and the law.

    **Arguments:**

    - `recording`, `trajectory`: the fitted rows.
    - `test_recording`, `test_trajectory`: rows that were not fitted; the loop is then
        theirs.
    - `model`: the law of the title.

    **Raises:** `InputError` when a trajectory does not have its recording's rows, or
    only one of the two for the test is given.
    """
    parts = {"fitted rows": (recording, trajectory)}
    if test_recording is not None and test_trajectory is not None:
        parts["rows not fitted"] = (test_recording, test_trajectory)
    elif test_recording is not None or test_trajectory is not None:
        raise InputError("give both `test_recording` and `test_trajectory`, or neither.")
    figure = _canvas.figure(3.6 * (1 + len(parts)), 4.6)
    panels = figure.subplot_mosaic(
        [["loop", *parts], ["loop", *(f"{name}: error" for name in parts)]],
        height_ratios=(2.2, 1),
    )
    _draw(panels, parts)
    if model is not None:
        figure.suptitle(_title(model))
    return figure


def _draw(panels, parts) -> None:
    first = next(iter(parts))
    for name, (recording, trajectory) in parts.items():
        top, bottom = panels[name], panels[f"{name}: error"]
        _panels.draw_output(top, recording, trajectory, "law")
        _panels.draw_error(bottom, recording, [trajectory])
        top.set_title(f"{name}: {_panels.score(recording, trajectory)}", fontsize=10)
        bottom.sharex(top)
        top.tick_params(labelbottom=False)
        if name != first:
            top.sharey(panels[first])
            bottom.sharey(panels[f"{first}: error"])
    shown = list(parts)[-1]
    _panels.draw_loop(panels["loop"], *parts[shown][:1], parts[shown][1:], ["law"])
    panels["loop"].set_title(f"loop, {shown}", fontsize=10)
    panels["loop"].legend(loc="upper left", frameon=False)


def _title(model: AbstractModel) -> str:
    """The law as mathematics, on as many lines as it needs."""
    addends = re.split(r" (?=[+-] )", to_latex(model))
    rows = (addends[i : i + _ADDENDS] for i in range(0, len(addends), _ADDENDS))
    return "\n".join(f"${' '.join(row)}$" for row in rows)
