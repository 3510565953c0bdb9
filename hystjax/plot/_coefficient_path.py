"""Coefficients along a path of thresholds."""

from collections.abc import Iterable, Sequence

import numpy as np
from jaxtyping import ArrayLike
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from .. import _checks
from .._errors import InputError
from . import _canvas

_ENTRY = 0.32  # inches of the figure's height an entry of the legend asks for


def coefficient_path(
    thresholds: ArrayLike,
    coefficients: ArrayLike,
    names: Sequence[str],
    *,
    axes: Iterable[Axes] | None = None,
) -> Figure:
    """Coefficients above and their number below, over the threshold.

    A term has no line where its coefficient is zero. The upper scale is logarithmic on
    both sides of zero when coefficients differ a hundredfold.

    **Arguments:**

    - `thresholds`: shape (m,), positive.
    - `coefficients`: shape (m, k), a row for each threshold.
    - `names`: names of the k terms, such as `library.names`.
    - `axes`: the two panels.

    **Raises:** `InputError` when shapes differ or a threshold is not positive.
    """
    thresholds, coefficients = np.asarray(thresholds), np.asarray(coefficients)
    _check(thresholds, coefficients, names)
    top, bottom = _canvas.stacked(axes, 2.2)
    used = np.flatnonzero(np.any(coefficients != 0, axis=0)).tolist()
    for i, look in zip(used, _canvas.looks(), strict=False):
        active = np.where(coefficients[:, i] != 0, coefficients[:, i], np.nan)
        _canvas.line(top, thresholds, active, names[i], drawstyle="steps-mid", **look)
    top.axhline(0, color="black", linewidth=0.8)
    number = np.count_nonzero(coefficients, axis=1)
    _canvas.line(bottom, thresholds, number, color="black", drawstyle="steps-mid")
    _scale(top, bottom, np.abs(coefficients[coefficients != 0]))
    _canvas.finish(top, "", "coefficient")
    _canvas.finish(bottom, "threshold", "number of terms")
    if used:
        top.legend(loc="upper left", bbox_to_anchor=(1, 1), frameon=False)
    figure = _canvas.root(top)
    if axes is None:  # a legend longer than its panel would push the lower one away
        figure.set_figheight(max(figure.get_figheight(), 1.5 + _ENTRY * len(used)))
    return figure


def _scale(top: Axes, bottom: Axes, sizes: np.ndarray) -> None:
    for ax in (top, bottom):
        ax.set_xscale("log")
    if sizes.size and sizes.max() > 100 * sizes.min():
        top.set_yscale("symlog", linthresh=sizes.min(), linscale=2)
        top.margins(y=0.1)
    bottom.yaxis.set_major_locator(MaxNLocator(integer=True))
    bottom.set_ylim(bottom=0)


def _check(thresholds, coefficients, names) -> None:
    expected = (thresholds.size, len(names))
    if thresholds.ndim != 1 or coefficients.shape != expected:
        raise InputError(
            "`thresholds` of shape (m,) and k `names` need `coefficients` of shape "
            f"(m, k); got {thresholds.shape}, {len(names)} names and "
            f"{coefficients.shape}."
        )
    _checks.positive("thresholds", thresholds)
