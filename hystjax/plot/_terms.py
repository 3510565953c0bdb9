"""Which terms, how many, and how sure: coefficients over thresholds, selections by
halves of the data, shares of redrawn data, errors by size; and values over any grid."""

from collections.abc import Iterable, Mapping, Sequence
from itertools import chain, repeat
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import ArrayLike
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from .._core import checks
from .._core.checks import InputError, described
from .._core.show import with_unit
from .._core.solution import Solution
from ..discovery import Discovered
from ..regression import Stability
from . import _canvas

_ENTRY = 0.32  # inches of the figure's height an entry of the legend asks for


@_canvas.of_numbers
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
    order = np.argsort(thresholds)
    thresholds, coefficients = thresholds[order], coefficients[order]
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
    _canvas.whole_numbers(bottom.yaxis)
    bottom.set_ylim(bottom=0)


def _check(thresholds, coefficients, names) -> None:
    expected = (thresholds.size, len(names))
    if thresholds.ndim != 1 or coefficients.shape != expected:
        raise InputError(
            "`thresholds` of shape (m,) and k `names` need `coefficients` of shape "
            f"(m, k); got {thresholds.shape}, {len(names)} names and "
            f"{coefficients.shape}."
        )
    checks.positive("thresholds", thresholds)


_ROW = 0.22  # inches of the figure's height an entry of the legend asks for


@_canvas.of_numbers
def stability(
    found: Stability, *, cutoff: float = 0.9, ax: Axes | None = None
) -> Figure:
    """The stability path: the share of the halves that select a term, by threshold, one
    line a term. Those that reach the cut-off are named, the others pale.

    **Arguments:** what `hystjax.stability` returned; the cut-off; and the panel to draw
    into.

    **Raises:** `InputError` for a cut-off that is not above 0.5 and at most 1.

    **Source:** Meinshausen and Bühlmann (2010), doi 10.1111/j.1467-9868.2010.00740.x.
    """
    stable = [found.names.index(name) for name in found.terms(cutoff)]
    ax = _canvas.single(ax, 7.0, max(3.8, 0.8 + _ROW * len(stable)))
    order = np.argsort(np.asarray(found.thresholds))
    thresholds = np.asarray(found.thresholds)[order]
    lines = np.asarray(found.probabilities)[order].T
    for i, look in zip(stable, _canvas.looks(), strict=False):
        _canvas.line(ax, thresholds, lines[i], found.names[i], **look)
    others = np.delete(lines, stable, axis=0)
    for line, label in zip(others, chain(["other terms"], repeat(None)), strict=False):
        _canvas.line(ax, thresholds, line, label, color=_canvas.MEASURED, zorder=1)
    ax.axhline(cutoff, color="black", linewidth=0.8, linestyle=":")
    ax.set_xscale("log")
    ax.set_ylim(-0.02, 1.02)
    _canvas.finish(ax, "threshold", "share of halves that select the term")
    ax.legend(loc="upper left", bbox_to_anchor=(1, 1), frameon=False)
    return _canvas.root(ax)


_LEAST = 0.005  # share that is worth a bar


@_canvas.of_numbers
def inclusion(shares: Mapping[str, float], *, ax: Axes | None = None) -> Figure:
    """Bars of the shares that `hystjax.inclusion` gives, those below half a per cent
    left out.

    **Arguments:** the shares by term; and the panel to draw into.

    **Raises:** `InputError` for what are no shares, and where no term is left.
    """
    check_shares("shares", shares)
    shown = {name: share for name, share in shares.items() if share >= _LEAST}
    if not shown:
        raise InputError(
            f"`shares` has no term with a share of {_LEAST:.1%} or more to draw, among "
            f"{len(shares)}; give what `hystjax.inclusion` returned."
        )
    ax = _canvas.single(ax, 6.4, 1.2 + 0.3 * len(shown))
    names = [_canvas.axis_label(name, "") for name in shown]
    bars = ax.barh(names, [100 * share for share in shown.values()], color="C0")
    ax.bar_label(bars, fmt="%.3g", padding=3)
    ax.invert_yaxis()
    ax.set_xlim(0, 108)
    _canvas.finish(ax, "chosen in so many of 100 resampled records", "")
    ax.grid(visible=False, axis="y")
    return _canvas.root(ax)


def check_shares(name: str, shares: Any) -> None:
    """Raise `InputError` for what are no shares by the names of terms."""
    named = isinstance(shares, Mapping) and all(isinstance(x, str) for x in shares)
    if not named:
        raise InputError(
            f"`{name}` must be what `hystjax.inclusion` returned, got "
            f"{described(shares)}."
        )
    for term, share in shares.items():
        checks.share(f"{name}[{term!r}]", share)


@_canvas.of_numbers
def frontier(found: Solution, *, ax: Axes | None = None) -> Figure:
    """Errors of all laws that `discover` tried, by their number of terms: the best of
    each connected, the chosen one named.

    **Arguments:** the `Solution` of `discover`; and the panel to draw into.

    **Raises:** `InputError` for the `Solution` of another verb.
    """
    known = _canvas.found_by("discover", "found", found, Discovered)
    ax = _canvas.single(ax, 6.4, 4.0)
    tried, best = known.candidates, known.frontier
    sizes = [len(candidate.terms) for candidate in tried]
    errors = [candidate.rmse for candidate in tried]
    ax.scatter(sizes, errors, s=12, color="0.7", label="tried", zorder=1)
    line = [candidate.rmse for candidate in best.values()]
    ax.plot(list(best), line, "o-", color="C0", label="best of its size", zorder=2)
    chosen = tried[0]
    label = _canvas.plain("chosen: " + ", ".join(chosen.named))
    ax.plot(
        len(chosen.terms), chosen.rmse, "o", ms=12, mfc="none", color="C3", label=label
    )
    _scale_errors(ax, np.array(errors))
    _canvas.whole_numbers(ax.xaxis)
    error = with_unit("rms error of the free run", found.value.units[1])
    _canvas.finish(ax, "number of terms", _canvas.plain(error))
    _canvas.legend_above(ax, columns=3)
    return _canvas.root(ax)


def _scale_errors(ax: Axes, errors: np.ndarray) -> None:
    """Logarithmic where errors differ by more than a factor of e, and on the way to
    zero, if one is, linear."""
    positive = errors[(errors > 0) & np.isfinite(errors)]
    if positive.size and np.max(positive) > np.e * np.min(positive):
        ax.set_yscale("log")
    if positive.size and np.any(errors == 0):
        ax.set_yscale("symlog", linthresh=np.min(positive))


if TYPE_CHECKING:
    import xarray

_TICKS = 6  # labels that fit along a panel


@_canvas.of_numbers
def heat_map(
    values: "xarray.DataArray",
    label: str = "",
    *,
    limits: tuple[float, float] | None = None,
    ax: Axes | None = None,
) -> Figure:
    """A part of the dataset of `hystjax.sweep` as cells of equal size.

        share = found["support"].all("term").mean("seed")
        hj.plot.heat_map(share.transpose("samples", "noise", "threshold"), "share")

    **Arguments:**

    - `values`: numbers along two axes, upwards and to the right; or along three, with
        a panel for each value of the first. Cells that are not finite stay empty.
    - `label`: what the colours say.
    - `limits`: values of the first and the last colour, by default the extremes.
    - `ax`: the panel to draw into, for two axes.

    **Raises:** `InputError` for another number of axes, no finite number, or other
    limits.
    """
    import xarray

    if not isinstance(values, xarray.DataArray) or values.dtype.kind not in "biuf":
        raise InputError(
            "`values` must be the numbers of one array of the dataset of a sweep, such "
            f"as `found['rms']`, got {checks.described(values)}."
        )
    if values.ndim not in ((2, 3) if ax is None else (2,)):
        given = ", ".join(map(str, values.dims)) or "none"
        raise InputError(
            f"`values` must have two axes, or, without `ax`, three; got {given}. "
            "Average over the others, or pick one of their values."
        )
    known = values.values[np.isfinite(values.values)]
    if limits is None and not known.size:
        raise InputError("`values` has no finite number to choose colours by.")
    parts = [values] if values.ndim == 2 else list(values)
    if ax is None:
        figure = _canvas.figure(1.6 + 3.0 * len(parts), 3.6)
        panels = figure.subplots(1, len(parts), sharey=True, squeeze=False)[0]
    else:
        figure, panels = _canvas.root(ax), [ax]
    if limits is None:
        low, high = float(np.min(known)), float(np.max(known))
    else:
        low, high = _ends(limits)
    look = {"cmap": "viridis", "vmin": low, "vmax": high}
    for panel, part in zip(panels, parts, strict=True):
        cells = np.where(np.isfinite(part.values), part.values, np.nan)
        image = panel.imshow(cells, origin="lower", aspect="auto", **look)
        _label(panel, part)
    if values.ndim == 3:
        first = values[values.dims[0]]
        unit = first.attrs.get("units", "")
        for panel, written in zip(panels, _written(first.values), strict=True):
            title = f"{first.name} = {written} {unit}".strip()
            title = _canvas.wrapped(title, _canvas.letters(panel))
            panel.set_title(title, fontsize="medium")
    for panel in panels[1:]:
        panel.set_ylabel("")
    figure.colorbar(image, ax=list(panels), label=_canvas.axis_label(label, ""))
    return figure


def _ends(limits: Any) -> tuple[float, float]:
    """Values of the first and the last colour."""
    ends = np.asarray(limits)
    if ends.shape != (2,) or ends.dtype.kind not in "iuf" or not ends[0] < ends[1]:
        raise InputError(f"`limits` must be two numbers that rise, got {limits!r}.")
    return float(ends[0]), float(ends[1])


def _label(ax: Axes, part: "xarray.DataArray") -> None:
    for axis, name in zip((ax.yaxis, ax.xaxis), part.dims, strict=True):
        coordinate = part[name]
        step = -(-len(coordinate) // _TICKS)
        places = np.arange(len(coordinate))[::step]
        texts = _written(coordinate.values[places])
        room = _canvas.letters(ax) * step / len(coordinate)
        long = max(map(len, texts)) > room
        leaning = {"rotation": 30, "ha": "right", "rotation_mode": "anchor"}
        look = leaning if long and axis is ax.xaxis else {}
        axis.set_ticks(places, list(map(_canvas.plain, texts)), **look)
        unit = coordinate.attrs.get("units", "")
        axis.set_label_text(_canvas.axis_label(str(name), unit))


def _written(values: np.ndarray) -> list[str]:
    """Numbers with as many digits as tell them apart, and at least three."""
    if not np.issubdtype(values.dtype, np.inexact):
        return [str(v) for v in values]
    for digits in range(3, 18):
        texts = [f"{v:.{digits}g}" for v in values]
        if len({*texts}) == len(np.unique(values)):
            break
    return texts
