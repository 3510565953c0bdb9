"""Recordings and what laws, families of models and controllers make of them; and loops
with their marks, what they lose, backbones, and reversal-curve diagrams."""

import math
import re
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import ArrayLike
from matplotlib.axes import Axes
from matplotlib.colors import TwoSlopeNorm
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from .._core import checks
from .._core.checks import InputError
from .._core.show import with_unit
from .._core.solution import Solution
from ..comparison import Comparison
from ..compensation import Tracking
from ..export import to_latex, to_text
from ..loops import Backbone, Bilinear, Eeep, Forc, summary
from ..models import AbstractModel
from ..recording import Recording
from ..refinement import Refined, known_covariance
from ..simulation import Trajectory, simulate
from . import _canvas


@_canvas.of_numbers
def record(recording: Recording, *, axes: Iterable[Axes] | None = None) -> Figure:
    """Input above, output below, over time; `axes` are the two panels."""
    top, bottom = _canvas.stacked(axes, 1)
    _canvas.line(top, recording.t, recording.u, color=_canvas.COLOURS[1])
    _canvas.line(bottom, recording.t, recording.w, color=_canvas.COLOURS[0])
    _canvas.finish(top, "", _canvas.input_label(recording))
    across = _canvas.time_label(recording)
    _canvas.finish(bottom, across, _canvas.output_label(recording))
    return _canvas.root(top)


@_canvas.of_numbers
def loop(
    recording: Recording,
    *trajectories: Trajectory,
    labels: Sequence[str] | None = None,
    ax: Axes | None = None,
) -> Figure:
    """Output over input: the recorded loop, and simulated ones on it.

    **Arguments:**

    - `recording`: the record that the loop is of.
    - `trajectories`: any number of simulations of its rows.
    - `labels`: one for each trajectory, for the legend.
    - `ax`: axes to draw into; a new figure by default.

    **Raises:** `InputError` when a trajectory or the labels do not fit.
    """
    ax = _canvas.single(ax, 5.2, 4.6)
    _canvas.draw_loop(ax, recording, trajectories, labels)
    _canvas.legend_above(ax)
    return _canvas.root(ax)


@_canvas.of_numbers
def fit(
    recording: Recording,
    trajectory: Trajectory,
    *,
    weights: ArrayLike | None = None,
    axes: Iterable[Axes] | None = None,
) -> Figure:
    """Recorded and simulated output over time, and their difference below.

    **Arguments:** the record, a simulation of its rows, and

    - `weights`: of the samples, shape (n,), as `judge` takes them; those of weight 0
        are not drawn.
    - `axes`: the two panels.

    **Raises:** `InputError` when the trajectory does not have the recording's rows, and
    for weights of another length.
    """
    top, bottom = _canvas.stacked(axes, 2.2)
    _canvas.draw_output(top, recording, trajectory, "simulated", weights)
    _canvas.draw_error(bottom, recording, [trajectory], weights=weights)
    score = _canvas.score(recording, trajectory, weights)
    top.set_title(score, loc="right", fontsize="medium")
    _canvas.legend_above(top)
    return _canvas.root(top)


@_canvas.of_numbers
def error(
    recording: Recording,
    *trajectories: Trajectory,
    labels: Sequence[str] | None = None,
    ax: Axes | None = None,
) -> Figure:
    """Simulated minus recorded output over time; arguments as for `loop`."""
    ax = _canvas.single(ax, 7.0, 3.0)
    _canvas.draw_error(ax, recording, trajectories, labels)
    _canvas.legend_above(ax)
    return _canvas.root(ax)


_SIGN = re.compile(" (?=[+-] )")
_DENSITY = 8.5  # characters of the title an inch
_LINES = 4  # of the title, before the law is only counted
_TITLE = 36  # letters as broad as a panel
_BEYOND = 0.01  # of the inputs that were fitted, from which on others go beyond


@_canvas.of_numbers
def overview(
    recording: Recording,
    trajectory: Trajectory,
    test_recording: Recording | None = None,
    test_trajectory: Trajectory | None = None,
    *,
    model: AbstractModel | None = None,
    weights: Sequence[ArrayLike | None] = (None, None),
    labels: Sequence[str] = ("fitted rows", "rows not fitted"),
) -> Figure:
    """The loop, the outputs over time with their errors below, and the law.

    **Arguments:**

    - `recording`, `trajectory`: the fitted rows.
    - `test_recording`, `test_trajectory`: rows that were not fitted; the loop is then
        theirs.
    - `model`: the law of the title; the inputs that it was fitted on are a band where
        those of the loop go beyond.
    - `weights`: of the samples of each recording, as `judge` takes them, or `None`;
        those of weight 0 are not drawn.
    - `labels`: what the rows of each are.

    **Raises:** `InputError` when a trajectory does not have its recording's rows, or
    weights not their number, or only one of the two for the test is given,
    or fewer weights or labels than recordings.
    """
    parts = {"first": (recording, trajectory)}
    if test_recording is not None and test_trajectory is not None:
        parts["second"] = (test_recording, test_trajectory)
    elif test_recording is not None or test_trajectory is not None:
        raise InputError(
            "give both `test_recording` and `test_trajectory`, or neither."
        )
    for name, given in (("weights", weights), ("labels", labels)):
        if isinstance(given, str) or len(given) < len(parts):
            raise InputError(
                f"`{name}` must hold one for each of {len(parts)} recordings, got "
                f"{given!r}."
            )
    width = 3.6 * (1 + len(parts))
    figure = _canvas.figure(width, 4.8)
    panels = figure.subplot_mosaic(
        [["loop", *parts], ["loop", *(f"{name}: error" for name in parts)]],
        height_ratios=(2.2, 1),
    )
    _share_scales(panels, list(parts))
    _draw_rows(panels, parts, labels, weights)
    last = len(parts) - 1
    rows, simulated = list(parts.values())[last]
    loop, own = panels["loop"], weights[last]
    _canvas.draw_loop(loop, rows, [simulated], ["law"], weights=own)
    _draw_reach(loop, model, rows)
    _entitle(loop, f"loop, {labels[last]}")
    lines = loop.get_legend_handles_labels()
    figure.legend(*lines, loc="outside lower center", ncols=3, frameon=False)
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


def _draw_rows(panels, parts, labels, weights) -> None:
    """Outputs with their errors below, of all parts."""
    outputs, runs = [], [run for _, run in parts.values()]
    for (name, part), label, own in zip(parts.items(), labels, weights, strict=False):
        rows, run = part
        _canvas.draw_output(panels[name], rows, run, "law", own)
        _canvas.draw_error(panels[f"{name}: error"], rows, [run], weights=own)
        _entitle(panels[name], f"{label}: {_canvas.score(rows, run, own)}")
        outputs.append(_canvas.known(rows, own))
    # On one scale a run that diverges must leave the outputs of both visible.
    both = np.concatenate(outputs)
    _canvas.keep_in_view(panels["first"], both, both, runs)
    _canvas.keep_in_view(panels["first: error"], both, np.zeros(1), runs)


def _entitle(ax, text: str) -> None:
    ax.set_title(_canvas.wrapped(text, _TITLE), fontsize="medium")


def _draw_reach(ax, model: AbstractModel | None, recording: Recording) -> None:
    """A band of the inputs that a law was fitted on, where a loop goes beyond."""
    known = None if model is None else model.fitted_range
    if known is None:
        return
    low, high, u = float(known.low), float(known.high), np.asarray(recording.u)
    beyond = max(low - np.min(u), np.max(u) - high)
    if beyond > _BEYOND * (high - low):
        label = "inputs that it was fitted on"
        ax.axvspan(low, high, color="0.95", linewidth=0, zorder=0, label=label)


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


@_canvas.of_numbers
def refinement(
    recording: Recording,
    before: Trajectory,
    after: Trajectory,
    solution: Solution,
    *,
    weights: ArrayLike | None = None,
) -> Figure:
    """Four panels: the errors before and after; the error after with the 95 % band of
    the simulated output; the autocorrelation of the residuals; and the correlation of
    the parameters.

    **Arguments:**

    - `recording`: the (first) recording that was refined on, or its rows after a
        lead-in.
    - `before`, `after`: simulations of its rows.
    - `solution`: what `hystjax.refine` returned.
    - `weights`: of the samples, as `judge` takes them; those of weight 0 are not drawn.

    **Raises:** `InputError` when a trajectory does not have the recording's rows, for a
    longer recording than was refined on, and for the `Solution` of another verb.
    """
    fit = _canvas.found_by("refine", "solution", solution, Refined)
    fitted = int(np.asarray(fit.lengths)[0])
    if len(recording) > fitted:
        raise InputError(
            f"the recording has {len(recording)} rows, and the first that `solution` "
            f"was refined on {fitted}; draw that one."
        )
    figure = _canvas.figure(10.0, 6.4)
    panels = figure.subplot_mosaic(
        [["errors", "correlation"], ["band", "autocorrelation"]], width_ratios=(1.7, 1)
    )
    scores = [_canvas.score(recording, run, weights) for run in (before, after)]
    labels = [f"before: {scores[0]}", f"after: {scores[1]}"]
    _canvas.draw_error(panels["errors"], recording, [before, after], labels, weights)
    _canvas.legend_above(panels["errors"])
    _draw_band(panels["band"], recording, fit)
    _draw_autocorrelation(panels["autocorrelation"], fit)
    _draw_correlation(figure, panels["correlation"], solution)
    return figure


def _draw_band(ax, recording, fit: Refined) -> None:
    """Residuals with the band within which the simulated output is certain."""
    t, end = np.asarray(recording.t), int(np.asarray(fit.lengths)[0])
    # Of the samples that were fitted the lead-in comes first.
    rows = 0, slice(end - len(recording), end)
    residuals = np.asarray(fit.residuals)[rows]
    if fit.weights is not None:
        counts = np.asarray(fit.weights[0])[rows[1]] > 0
        residuals = np.where(counts, residuals, np.nan)
    spread = _canvas.CERTAIN * np.asarray(fit.certainty.output)[rows]
    _canvas.line(ax, t, residuals, "residuals", color="0.7", linewidth=0.6)
    ax.fill_between(
        t,
        -spread,
        spread,
        color=_canvas.COLOURS[0],
        alpha=0.6,
        linewidth=0,
        zorder=3,
        label="95 % band of the simulated output",
    )
    across = _canvas.time_label(recording)
    _canvas.finish(ax, across, _canvas.axis_label("residual", recording.units[1]))
    _canvas.legend_above(ax)


def _draw_autocorrelation(ax, fit: Refined) -> None:
    """Autocorrelation over the lag, with the band of white noise."""
    correlation = np.asarray(fit.autocorrelation)[0]
    used = np.count_nonzero(np.asarray(fit.residuals)[0])
    lags = np.arange(1, len(correlation) + 1)
    ax.vlines(lags, 0, correlation, color=_canvas.COLOURS[0])
    limit = _canvas.CERTAIN / max(used, 1) ** 0.5
    ax.axhspan(-limit, limit, color="0.85", zorder=0, label="white noise, 95 %")
    ax.axhline(0, color="black", linewidth=0.8)
    _canvas.finish(ax, "lag (samples)", "autocorrelation of residuals")
    _canvas.legend_above(ax)


_NAMED = 12  # parameters, whose names fit beside the map


def _draw_correlation(figure, ax, solution) -> None:
    """Correlation of the estimated parameters as a map."""
    names, covariance = known_covariance(solution)
    errors = np.sqrt(np.diag(covariance))
    image = ax.imshow(
        covariance / np.outer(errors, errors), vmin=-1, vmax=1, cmap="RdBu_r"
    )
    # Of many every so-many-th is named: all would be one black mark.
    rows = range(0, len(names), -(-len(names) // _NAMED))
    labels = [_canvas.plain(names[row]) for row in rows]
    ax.set_xticks(rows, labels, rotation=45, ha="right")
    ax.set_yticks(rows, labels)
    ax.set_title("correlation of the parameters", fontsize="medium")
    figure.colorbar(image, ax=ax, shrink=0.8)


_SHOWN = 3  # families whose loops are drawn
_FAR = 50.0  # times the least error, beyond which a family is not placed on the axis


@_canvas.of_numbers
def comparison(found: Comparison, recording: Recording) -> Figure:
    """Errors of all families on blocks left out, with their standard errors, and on all
    samples, of those that are 50 times as far off as the best as numbers; and beside
    them the loops of the best three.

    **Arguments:** what `hystjax.compare` returned; and a record to draw loops of, such
    as the one compared on.

    **Raises:** `InputError` where no family has a finite error.
    """
    shown = [row for row in found.rows[:_SHOWN] if math.isfinite(row.error)]
    if not shown:
        raise InputError(
            "no family of `found` stays finite on the blocks left out: there are no "
            "errors to draw."
        )
    figure = _canvas.figure(4.6 + 3.2 * len(shown), 4.4)
    left, *right = figure.subplots(
        1, 1 + len(shown), width_ratios=[1.4, *[1] * len(shown)]
    )
    _errors(left, found)
    for ax, row in zip(right, shown, strict=True):
        run = simulate(row.model, recording, throw=False)
        _canvas.draw_loop(ax, recording, [run], [row.family])
        _canvas.legend_above(ax, columns=1)
    return figure


def _errors(ax: Axes, found: Comparison) -> None:
    """One row a family, the best at the top, in % of the output's range."""
    most = _FAR * found.best.error
    rows = [row for row in found.rows if row.error <= most]
    far = [row for row in found.rows if not row.error <= most]
    places = np.arange(len(found.rows))[::-1][: len(rows)]
    for place, row in enumerate(reversed(far)):
        off = f"{100 * row.error:.3g} %" if math.isfinite(row.error) else "diverges"
        where = {"xy": (0.98, place), "xycoords": ax.get_yaxis_transform()}
        ax.annotate(f"{off} →", **where, ha="right", va="center", fontsize="small")
    errors = np.array([100 * row.error for row in rows])
    spread = np.nan_to_num([100 * row.standard_error for row in rows])
    # On a logarithmic axis an error bar does not reach zero.
    below = np.minimum(spread, 0.9 * errors)
    ax.errorbar(
        errors,
        places,
        xerr=[below, spread],
        fmt="o",
        color=_canvas.COLOURS[0],
        label="blocks left out",
    )
    own = np.array([100 * row.own for row in rows])
    ax.plot(own, places, "|", color="0.4", markersize=10, label="all samples")
    ends = np.concatenate([errors - below, errors + spread, own])
    ends = ends[(ends > 0) & np.isfinite(ends)]
    low, high = np.min(ends), np.max(ends)
    # With room at both ends, and two ticks, however near all errors are.
    middle, reach = np.sqrt(low) * np.sqrt(high), max(1.2 * np.sqrt(high / low), 2.3)
    ax.set_xlim(middle / reach, middle * reach)
    ax.set_xscale("log")
    ax.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    ax.xaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
    ax.xaxis.set_minor_formatter(NullFormatter())
    names = [row.family for row in (*rows, *far)]
    ax.set_yticks(np.arange(len(names))[::-1], list(map(_canvas.plain, names)))
    ax.set_ylim(-0.5, len(names) - 0.5)
    _canvas.finish(ax, "error (% of the output's range)", "")
    _canvas.legend_above(ax)


_STRAIGHT = 0.1  # % of the stroke, up to which the axis of errors is linear
_ROOM = 1.6  # beyond the largest error
_TICKS = 5  # to either side of no error


@_canvas.of_numbers
def tracking(
    runs: Mapping[str, Tracking | Solution],
    *,
    axes: Iterable[Axes] | None = None,
) -> Figure:
    """A reference and where a device got, and below the errors in % of the stroke, the
    range of the reference, on an axis that is linear up to 0.1 % and logarithmic
    beyond, so that bad and good schemes are seen together.

    **Arguments:**

    - `runs`: what `hystjax.control` returned, by what it is called in the legend; all
        along one reference.
    - `axes`: two axes, the upper and the lower one; those of a new figure by default.

    **Raises:** `InputError` where there is no run, or one of another verb, where
    references differ, or the reference does not change, so that its range is none to
    take a share of.
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
        if (when := _canvas.lost(run)) is None:
            largest = max(largest, float(np.max(np.abs(share))))
            score = f"{name}: {np.sqrt(np.mean(share**2)):.2g} % rms"
        else:
            largest = max(largest, 100.0)
            score = f"{name}: {_canvas.diverges(first, when)}"
        _canvas.line(top, t, run.w, score, **look)
        _canvas.line(bottom, t, share, linewidth=0.7, **look)
    _canvas.keep_in_view(top, reference, reference, shown.values())
    bottom.set_yscale("symlog", linthresh=_STRAIGHT)
    bottom.set_ylim(-_ROOM * largest, _ROOM * largest)
    decades = int(np.ceil(np.log10(largest / _STRAIGHT)))
    step = decades // _TICKS + 1
    # Of wide steps none is at the end of the linear part, which is close to zero.
    powers = np.arange(decades, 0 if step > 1 else -1, -step)[::-1]
    ticks = [x for x in _STRAIGHT * 10.0**powers if x <= _ROOM * largest]
    bottom.set_yticks([*(-x for x in reversed(ticks)), 0, *ticks])
    bottom.yaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
    _canvas.finish(top, "", _canvas.axis_label(first.names[1], first.units[1]))
    _canvas.finish(bottom, _canvas.time_label(first), "error (% of stroke)")
    _canvas.legend_above(top, columns=2)
    return _canvas.root(top)


def _first(runs: Mapping[str, Tracking]) -> Tracking:
    """One of the runs, which all have its times and reference."""
    if not runs:
        raise InputError(
            "`runs` is empty; give what `hystjax.control` returned, named."
        )
    for name, run in runs.items():
        if not isinstance(run, Tracking):
            raise InputError(
                "`runs` must hold what `hystjax.control` returned, by label; got "
                f"{checks.described(run)} by the label {name!r}."
            )
    first = next(iter(runs.values()))
    for name, run in runs.items():
        same = np.array_equal(run.t, first.t)
        if not same or not np.array_equal(run.reference, first.reference):
            raise InputError(
                f"{name!r} was led along another reference than the first of `runs`; "
                "draw runs of one reference together."
            )
    if np.ptp(first.reference) == 0:
        raise InputError(
            "the reference of `runs` does not change, and errors are drawn as shares "
            "of its range; draw their `error`, in units of the output."
        )
    return first


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
    _check_summary(known, "cycles(recording, summary(recording))")
    if (last_row := int(np.max(known["stop"]))) >= len(recording):
        raise InputError(
            f"`dataset` is of another recording: its cycles end at row {last_row}, and "
            f"this one has {len(recording)} rows."
        )
    ax = _canvas.single(ax, 5.6, 4.8)
    _canvas.recorded(ax, recording.u, recording.w, "recorded")
    colours = _canvas.COLOURS
    last = known.isel(cycle=-1)
    values = {name: float(last[name]) for name in last if last[name].ndim == 0}
    # A zero that is far away would leave nothing of the loop.
    for draw, x in ((ax.axvline, recording.u), (ax.axhline, recording.w)):
        if np.min(x) <= 0 <= np.max(x):
            draw(0, color="0.6", linewidth=0.8, zorder=1)
    # Cycles from zero turn twice, and neither begin nor end at a tip.
    turns = ("turn", "back") if "back" in known.coords else ("start", "turn", "stop")
    rows = np.unique([known[name].values for name in turns])
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
    across, up = _canvas.input_label(recording), _canvas.output_label(recording)
    _canvas.finish_loop(ax, across, up)
    _canvas.legend_above(ax, columns=2)
    return _canvas.root(ax)


@_canvas.of_numbers
def energy(dataset: "xarray.Dataset", *, axes: Iterable[Axes] | None = None) -> Figure:
    """The signed area of each cycle, with two standard errors, and below the equivalent
    damping.

    **Arguments:** what `hystjax.loops.summary` returned; two panels to draw into, by
    default those of a new figure.
    """
    _check_summary(dataset, "energy(summary(recording))")
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


def _check_summary(dataset: Any, otherwise: str) -> None:
    """Raise `InputError` for what is no `summary` of one record."""
    if not isinstance(dataset, Mapping):
        found = checks.described(dataset)
    elif "damping" not in dataset:
        found = "a dataset without `damping`, such as of `core_loss`"
    elif "source" in dataset["damping"].dims:
        found = (
            "the numbers of several runs: `side_by_side(...).sel(source=...)` is one"
        )
    elif not dataset["damping"].sizes.get("cycle"):
        found = (
            "one that is not over `cycle`, as where one was taken out of it by its "
            "number: `isel(cycle=[0])` keeps it"
        )
    else:
        return
    raise InputError(
        f"`dataset` must be what `hystjax.loops.summary` returned, got {found}; draw "
        f"`{otherwise}`."
    )


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
    for (u, w), label in zip(sides, ("backbone", None), strict=True):
        marker = "o" if len(u) <= _FEW else None
        look = {"color": "black", "markersize": 3, "linewidth": 1.4}
        _canvas.line(ax, u, w, label, marker=marker, **look)
    for (label, fit), look in zip((fits or {}).items(), _canvas.looks(), strict=False):
        _canvas.line(ax, *_corners(fit, found), label, linewidth=1.8, **look)
    across, up = _canvas.input_label(recording), _canvas.output_label(recording)
    _canvas.finish_loop(ax, across, up)
    _canvas.legend_above(ax, columns=2)
    return _canvas.root(ax)


def _corners(fit: Bilinear | Eeep, found: Backbone):
    """Origin, yield and end of a fit."""
    if not isinstance(fit, Bilinear | Eeep):
        raise InputError(
            "`fits` must hold what `bilinear` or `eeep` returned, by label; got "
            f"{checks.described(fit)}."
        )
    if isinstance(fit, Eeep):
        return [0, fit.u_yield, fit.u_ultimate], [0, fit.w_yield, fit.w_yield]
    side = found.u if fit.u_yield > 0 else found.u_negative
    if not len(side):
        raise InputError(
            f"`fits` hold one that yields at {fit.u_yield:.4g}, and `found` has "
            "nothing on that side."
        )
    end = float(side[np.argmax(np.abs(side))])
    rise = fit.w_yield + fit.hardening * (end - fit.u_yield)
    return [0, fit.u_yield, end], [0, fit.w_yield, rise]


@_canvas.of_numbers
def forc(found: Forc, *, ax: Axes | None = None) -> Figure:
    """The diagram of first-order reversal curves: the density over coercivity Hc and
    interaction field Hu, red where positive, and a contour around what is more than
    three standard errors from zero, to either side.

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
        with_unit(f"coercivity {coercivity}", _canvas.plain(unit)),
        with_unit(f"interaction field {interaction}", _canvas.plain(unit)),
    )
    ax.grid(False)
    ax.set_title(
        f"smoothing {found.smoothed}; contour: {_SIGNIFICANT:g} standard errors",
        loc="left",
        fontsize="medium",
    )
    figure = _canvas.root(ax)
    # The labels of a bar that hangs at the axes find their room in a second layout.
    if isinstance(figure, _canvas.NotebookFigure):
        figure.draw_without_rendering()
    return figure


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
        np.abs(np.nan_to_num(found.significance)),
        levels=[_SIGNIFICANT],
        colors="black",
        linewidths=0.7,
    )
    unit = f"10$^{{{ten:.0f}}}$ {_canvas.plain(found.density_unit)}".strip()
    # As high as the diagram, whatever its shape.
    beside = ax.inset_axes((1.02, 0.0, 0.025, 1.0))
    _canvas.root(ax).colorbar(
        colours, cax=beside, label=f"density ({unit})", extend="both"
    )
