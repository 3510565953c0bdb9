"""A device under control, by several schemes."""

from collections.abc import Iterable, Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter

from .._core.errors import InputError
from .._core.solution import Solution
from ..compensation import Tracking
from . import _canvas

_STRAIGHT = 0.1  # % of the stroke, up to which the axis of errors is linear
_ROOM = 1.6  # beyond the largest error


@_canvas.of_numbers
def tracking(
    runs: Mapping[str, Tracking | Solution],
    *,
    names: tuple[str, str] = ("input", "output"),
    units: tuple[str, str] = ("", ""),
    axes: Iterable[Axes] | None = None,
) -> Figure:
    """A reference and where a device got, and below the errors in % of the stroke, the
    range of the reference, on an axis that is linear up to 0.1 % and logarithmic
    beyond, so that bad and good schemes are seen together.

    **Arguments:**

    - `runs`: what `hystjax.control` returned, by what it is called in the legend; all
        along one reference.
    - `names`, `units`: of input and output, such as those of the device.
    - `axes`: two axes, the upper and the lower one; those of a new figure by default.

    **Raises:** `InputError` where there is no run, or references differ.
    """
    shown = {
        name: run.value if isinstance(run, Solution) else run
        for name, run in runs.items()
    }
    first = _first(shown)
    t, reference = np.asarray(first.t), np.asarray(first.reference)
    top, bottom = _canvas.stacked(axes, 1.0)
    _canvas.recorded(top, t, reference, "reference")
    largest = _STRAIGHT
    for (name, run), look in zip(shown.items(), _canvas.looks(), strict=False):
        share = 100 * np.asarray(run.error) / np.ptp(reference)
        largest = max(largest, float(np.nanmax(np.abs(share))))
        score = f"{name}: {np.sqrt(np.mean(share**2)):.2g} % rms"
        _canvas.line(top, t, run.w, score, **look)
        _canvas.line(bottom, t, share, linewidth=0.7, **look)
    bottom.set_yscale("symlog", linthresh=_STRAIGHT)
    bottom.set_ylim(-_ROOM * largest, _ROOM * largest)
    decades = _STRAIGHT * 10.0 ** np.arange(np.ceil(np.log10(largest / _STRAIGHT)) + 1)
    ticks = [x for x in decades if x <= _ROOM * largest]
    bottom.set_yticks([*(-x for x in reversed(ticks)), 0, *ticks])
    bottom.yaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
    _canvas.finish(top, "", _canvas.axis_label(names[1], units[1]))
    _canvas.finish(bottom, "time (s)", "error (% of stroke)")
    _canvas.legend_above(top, columns=2)
    return _canvas.root(top)


def _first(runs: Mapping[str, Tracking]) -> Tracking:
    """One of the runs, which all have its times and reference."""
    if not runs:
        raise InputError(
            "`runs` is empty; give what `hystjax.control` returned, named."
        )
    first = next(iter(runs.values()))
    for name, run in runs.items():
        same = np.array_equal(run.t, first.t)
        if not same or not np.array_equal(run.reference, first.reference):
            raise InputError(
                f"{name!r} was led along another reference than the first of `runs`; "
                "draw runs of one reference together."
            )
        if np.ndim(run.w) != 1:
            raise InputError(
                f"{name!r} is a batch, of shape {np.shape(run.w)}; pick one run of it."
            )
    return first
