"""Loops with their marks, what they lose, backbones, and reversal-curve diagrams."""

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import TwoSlopeNorm
from matplotlib.figure import Figure

from .._core.checks import InputError
from .._core.show import with_unit
from ..loops import Backbone, Bilinear, Eeep, Forc, summary
from ..recording import Recording
from . import _canvas

if TYPE_CHECKING:
    import xarray

_SIGNIFICANT = 3.0  # standard errors of the density within the contour
_FULL = 0.999  # share of densities within the colours
_MANY = 12  # cycles up to which tips are marked large
_FEW = 50  # points of a backbone up to which each is marked


@_canvas.of_numbers
def cycles(
    recording: Recording,
    dataset: "xarray.Dataset | None" = None,
    *,
    ax: Axes | None = None,
) -> Figure:
    """The loop with its marks: the tips of the cycles, where the last one passes the
    axes (which magneticians call remanence and coercivity), and the line from tip to
    tip, the secant stiffness.

    **Arguments:** the record; its numbers, by default `hystjax.loops.summary` of it;
    the axes to draw into, by default those of a new figure.
    """
    known = summary(recording) if dataset is None else dataset
    ax = _canvas.single(ax, 5.6, 4.8)
    _canvas.recorded(ax, recording.u, recording.w, "recorded")
    colours = _canvas.COLOURS
    last = known.isel(cycle=-1)
    values = {name: float(last[name]) for name in last if last[name].ndim == 0}
    ax.axhline(0, color="0.6", linewidth=0.8, zorder=1)
    ax.axvline(0, color="0.6", linewidth=0.8, zorder=1)
    rows = np.unique([known[name].values for name in ("start", "turn", "stop")])
    u, w = (np.asarray(column)[rows] for column in (recording.u, recording.w))
    size = 6 if len(known["cycle"]) <= _MANY else 3
    ax.plot(u, w, "o", color=colours[1], markersize=size, label="tips")
    u, w = ([values[f"{x}_min"], values[f"{x}_max"]] for x in "uw")
    look = {"color": colours[1], "linewidth": 1, "linestyle": "--"}
    _canvas.line(ax, u, w, "secant, last cycle", **look)
    signs = np.array([-1.0, 1.0])
    driver, answer = recording.names
    remanent = values["w_bias"] + signs * values["remanence"]
    coercive = values["u_bias"] + signs * values["coercivity"]
    # Both names may be one.
    for name, x, y, marker, colour in (
        (driver, np.zeros(2), remanent, "s", colours[0]),
        (answer, coercive, np.zeros(2), "D", colours[2]),
    ):
        if np.all(np.isfinite([x, y])):
            label = _canvas.plain(f"at {name} 0")
            look = {"color": colour, "markersize": 6, "label": label}
            ax.plot(x, y, marker, **look)
    _canvas.finish(ax, _canvas.input_label(recording), _canvas.output_label(recording))
    _canvas.legend_above(ax, columns=2)
    return _canvas.root(ax)


@_canvas.of_numbers
def energy(dataset: "xarray.Dataset", *, axes: Iterable[Axes] | None = None) -> Figure:
    """The signed area of each cycle, with two standard errors, and below the equivalent
    damping.

    **Arguments:** what `hystjax.loops.summary` returned; two panels to draw into, by
    default those of a new figure.
    """
    if isinstance(dataset, Recording):
        raise InputError(
            "`dataset` must be what `hystjax.loops.summary` returned, got a Recording; "
            "draw `energy(summary(recording))`."
        )
    top, bottom = _canvas.stacked(axes, 1)
    for ax, name, label in (
        (top, "energy", "energy a cycle"),
        (bottom, "damping", "equivalent damping ratio"),
    ):
        number, unit = dataset[name], dataset[name].attrs["units"]
        ax.errorbar(
            dataset["cycle"].values,
            number.values,
            2 * dataset[f"{name}_error"].values,
            fmt="o-",
            markersize=4,
            linewidth=1,
            capsize=2,
            color=_canvas.COLOURS[0 if name == "energy" else 1],
        )
        below = ax is bottom
        label = _canvas.axis_label(label, "" if unit == "1" else unit)
        _canvas.finish(ax, "cycle" if below else "", label)
        _canvas.whole_numbers(ax.xaxis)
        # Numbers that hardly differ are read whole, not as what they are above another.
        ax.ticklabel_format(axis="y", useOffset=False)
    return _canvas.root(top)


@_canvas.of_numbers
def backbone(
    recording: Recording,
    found: Backbone,
    fits: Mapping[str, Bilinear | Eeep] | None = None,
    *,
    ax: Axes | None = None,
) -> Figure:
    """The record, its backbone on both sides, and straight lines in its place.

    **Arguments:** the record; what `hystjax.loops.backbone` made of it; fits of
    `bilinear` and `eeep` by label, of either side; the axes to draw into.
    """
    ax = _canvas.single(ax, 5.8, 4.6)
    _canvas.line(ax, recording.u, recording.w, "recorded", color="0.75", linewidth=1)
    sides = ((found.u, found.w), (found.u_negative, found.w_negative))
    for (u, w), label in zip(sides, ("backbone", "_"), strict=True):
        marker = "o" if len(u) <= _FEW else None
        look = {"color": "black", "markersize": 3, "linewidth": 1.4}
        _canvas.line(ax, u, w, label, marker=marker, **look)
    for (label, fit), look in zip((fits or {}).items(), _canvas.looks(), strict=False):
        _canvas.line(ax, *_corners(fit, found), label, linewidth=1.8, **look)
    _canvas.finish(ax, _canvas.input_label(recording), _canvas.output_label(recording))
    _canvas.legend_above(ax, columns=2)
    return _canvas.root(ax)


def _corners(fit: Bilinear | Eeep, found: Backbone):
    """Origin, yield and end of a fit."""
    if isinstance(fit, Eeep):
        return [0, fit.u_yield, fit.u_ultimate], [0, fit.w_yield, fit.w_yield]
    side = found.u if fit.u_yield > 0 else found.u_negative
    end = float(side[np.argmax(np.abs(side))])
    rise = fit.w_yield + fit.hardening * (end - fit.u_yield)
    return [0, fit.u_yield, end], [0, fit.w_yield, rise]


@_canvas.of_numbers
def forc(found: Forc, *, ax: Axes | None = None) -> Figure:
    """The diagram of first-order reversal curves: the density over coercivity Hc and
    interaction field Hu, red where positive, and a contour around what is more than
    three standard errors.

    **Arguments:** what `hystjax.loops.forc` returned; the axes to draw into. Fields
    in T are shown in mT.

    **Raises:** `InputError` where no density is known, or an axis has one value.
    """
    if min(found.density.shape) < 2:
        raise InputError(
            f"a diagram needs two or more of `hc` and of `hu`; it has {len(found.hc)} "
            f"and {len(found.hu)}."
        )
    # As high as a diagram of this shape needs, with its title and labels.
    shape = np.ptp(found.hu) / np.ptp(found.hc)
    ax = _canvas.single(ax, 7.4, float(np.clip(5.9 * shape + 1.0, 2.4, 8.0)))
    if not np.any(np.isfinite(found.density)):
        raise InputError("no density is known anywhere: there are too few points.")
    if found.units[0] == "T":
        scale, unit, coercivity, interaction = 1e3, "mT", r"$\mu_0 H_c$", r"$\mu_0 H_u$"
    else:
        scale, unit, coercivity, interaction = 1.0, found.units[0], "Hc", "Hu"
    _density(ax, found, scale)
    ax.axhline(0, color="0.4", linewidth=0.7, linestyle=":")
    ax.set_aspect("equal")
    _canvas.finish(
        ax,
        with_unit(f"coercivity {coercivity}", unit),
        with_unit(f"interaction field {interaction}", unit),
    )
    ax.grid(False)
    ax.set_title(
        f"smoothing {found.smoothed}; contour: {_SIGNIFICANT:g} standard errors",
        loc="left",
        fontsize="medium",
    )
    return _canvas.root(ax)


def _density(ax: Axes, found: Forc, scale: float) -> None:
    """Colours with their bar, and the contour around what is significant."""
    hc, hu = scale * found.hc, scale * found.hu
    # The ridge at Hc 0, the reversible part, would take all colours for itself.
    shown = found.density[:, found.inner]
    size = float(np.nanquantile(np.abs(shown), _FULL)) or 1.0
    ten = np.floor(np.log10(size))
    colours = ax.pcolormesh(
        hc,
        hu,
        found.density / 10**ten,
        cmap="RdBu_r",
        norm=TwoSlopeNorm(0.0, -size / 10**ten, size / 10**ten),
        shading="nearest",
        rasterized=True,
    )
    ax.contour(
        hc,
        hu,
        np.nan_to_num(found.significance),
        levels=[_SIGNIFICANT],
        colors="black",
        linewidths=0.7,
    )
    label = f"density (10$^{{{ten:.0f}}}$ {found.density_unit or '1'})"
    # As high as the diagram, whatever its shape.
    beside = ax.inset_axes((1.02, 0.0, 0.025, 1.0))
    _canvas.root(ax).colorbar(colours, cax=beside, label=label, extend="both")
