"""The figure that tells the whole."""

import re
import textwrap

from matplotlib.figure import Figure

from .._errors import InputError
from .._recording import Recording
from .._simulate import Trajectory
from ..export import to_latex, to_text
from ..models import AbstractModel
from . import _canvas, _panels

_SIGN = re.compile(" (?=[+-] )")
_DENSITY = 8.5  # characters of the title an inch
_LINES = 4  # of the title, before the law is only counted


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
        raise InputError(
            "give both `test_recording` and `test_trajectory`, or neither."
        )
    width = 3.6 * (1 + len(parts))
    figure = _canvas.figure(width, 4.8)
    panels = figure.subplot_mosaic(
        [["loop", *parts], ["loop", *(f"{name}: error" for name in parts)]],
        height_ratios=(2.2, 1),
    )
    _share_scales(panels, list(parts))
    for name, part in parts.items():
        _draw_rows(panels[name], panels[f"{name}: error"], name, *part)
    shown, (rows, simulated) = list(parts.items())[-1]
    _panels.draw_loop(panels["loop"], rows, [simulated], ["law"])
    panels["loop"].set_title(f"loop, {shown}", fontsize="medium")
    lines = panels["loop"].get_legend_handles_labels()
    figure.legend(*lines, loc="outside lower center", ncols=2, frameon=False)
    if model is not None:
        figure.suptitle(_title(model, width))
    return figure


def _share_scales(panels, names) -> None:
    """Errors over their outputs, and one scale for fitted and other rows."""
    for name in names:
        panels[f"{name}: error"].sharex(panels[name])
        panels[name].tick_params(labelbottom=False)
    for name in names[1:]:
        for kind in ("", ": error"):
            panels[name + kind].sharey(panels[names[0] + kind])


def _draw_rows(top, bottom, name, recording, trajectory) -> None:
    _panels.draw_output(top, recording, trajectory, "law")
    _panels.draw_error(bottom, recording, [trajectory])
    score = _panels.score(recording, trajectory)
    top.set_title(f"{name}: {score}", fontsize="medium")


def _title(model: AbstractModel, width: float) -> str:
    """The law as mathematics, on as many lines of some inches as it takes."""
    if model.addends() is None:
        lines = textwrap.wrap(str(model), int(_DENSITY * width))
        many = f"a {type(model).__name__} of {len(model.numbers())} numbers"
        return "\n".join(lines) if len(lines) <= _LINES else many
    addends = (re.split(_SIGN, law) for law in (to_latex(model), to_text(model)))
    lines, length = [""], 0.0
    for mathematics, text in zip(*addends, strict=True):
        if lines[-1] and length + len(text) > _DENSITY * width:
            lines, length = [*lines, ""], 0.0
        lines[-1] += f" {mathematics}"
        length += len(text) + 1
    if len(lines) > _LINES:
        return f"a law of {len(model.numbers())} terms"
    return "\n".join(f"${line.strip()}$" for line in lines)
