"""What all figures share: one without pyplot, colours, labels, files, and panels."""

import functools
import inspect
import io
import os
import textwrap
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import cycle, product
from types import UnionType
from typing import Any, ParamSpec, TypeVar, get_args, get_origin

import numpy as np
from jaxtyping import ArrayLike
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from .._core import checks
from .._core.checks import InputError
from .._core.files import path_of, write_atomically
from .._core.show import moment, with_unit
from .._core.solution import AbstractFindings, Solution
from ..compensation import Tracking
from ..models import AbstractModel
from ..models._base import check_answers
from ..recording import Recording
from ..simulation import Trajectory, metrics

# Colours that the colour-blind tell apart, by Okabe and Ito, *Color Universal Design*
# (2008); the grey is our own.
MEASURED = "#a9a9a9"
COLOURS = ("#D55E00", "#0072B2", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")

_Inputs = ParamSpec("_Inputs")
_Figure = TypeVar("_Figure")
_Findings = TypeVar("_Findings", bound=AbstractFindings)
CERTAIN = 1.96  # standard errors to either side hold 95 % of a normal distribution
MANY = 20_000  # points from which a line is a picture inside a PDF or SVG
_WIDE = 26  # characters after which a label is wrapped


class NotebookFigure(Figure):
    """A figure that notebooks show although pyplot knows nothing of it."""

    def _repr_png_(self) -> bytes:
        stream = io.BytesIO()
        self.savefig(stream, format="png", dpi=100)
        return stream.getvalue()


def of_numbers(function: Callable[_Inputs, _Figure]) -> Callable[_Inputs, _Figure]:
    """A function that draws numbers: traced ones it refuses by its own name, other
    nouns than those that it is annotated with, and batches."""
    signature = inspect.signature(function)
    call = f"hystjax.plot.{function.__name__}"

    @functools.wraps(function)
    def checked(*args: _Inputs.args, **kwargs: _Inputs.kwargs) -> _Figure:
        checks.concrete(f"`{call}`", args, kwargs)
        for name, value in signature.bind_partial(*args, **kwargs).arguments.items():
            parameter = signature.parameters[name]
            several = parameter.kind is parameter.VAR_POSITIONAL
            for each in value if several else (value,):
                _check_noun(f"`{name}` of `{call}`", each, parameter.annotation)
                for one in each.values() if isinstance(each, Mapping) else (each,):
                    _check_one(f"`{name}` of `{call}`", one)
        return function(*args, **kwargs)

    return checked


def _check_noun(what: str, value: Any, annotation: Any) -> None:
    """That a value is one of the nouns of hystjax, or a mapping, that are asked for."""
    union = isinstance(annotation, UnionType)
    kinds = get_args(annotation) if union else (annotation,)
    kinds = tuple(get_origin(kind) or kind for kind in kinds)
    nouns = [k for k in kinds if k is Mapping or _is_noun(k)]
    if not nouns or isinstance(value, kinds):
        return
    names = " or ".join(checks.with_article(kind.__name__) for kind in nouns)
    hint = ""
    if isinstance(value, Solution) and isinstance(value.value, kinds):
        hint = "; give its `value`"
    raise InputError(f"{what} must be {names}, got {checks.described(value)}{hint}.")


def _is_noun(kind: Any) -> bool:
    return isinstance(kind, type) and kind.__module__.startswith("hystjax.")


def _check_one(what: str, value: Any) -> None:
    """Raise `InputError` for a batch of models, of records or of runs."""
    value = value.value if isinstance(value, Solution) else value
    pick = "pick one with `jax.tree.map(lambda x: x[i], batch)`."
    if isinstance(value, Recording | Trajectory | Tracking) and np.ndim(value.w) != 1:
        raise InputError(f"{what} is a batch, of shape {np.shape(value.w)}; {pick}")
    if not isinstance(value, AbstractModel):
        return
    try:
        check_answers(value)
    except InputError as error:
        raise InputError(
            f"{what} is a batch, or a {type(value).__name__} whose answers do not fit "
            f"one another; {pick}"
        ) from error


def found_by(verb: str, name: str, given: Any, findings: type[_Findings]) -> _Findings:
    """What a verb has found; `InputError` for what tells of none, such as the
    `Solution` of another verb."""
    if not findings.told_by(given):
        other = " of another verb" if isinstance(given, Solution) else ""
        raise InputError(
            f"`{name}` must be what `{verb}` returned, got "
            f"{checks.described(given)}{other}."
        )
    return findings.of(given)


def figure(width: float, height: float) -> NotebookFigure:
    """An empty figure, sizes in inches, whose layout keeps everything inside."""
    return NotebookFigure(figsize=(width, height), layout="constrained")


def single(ax: Axes | None, width: float, height: float) -> Axes:
    """The given axes, or those of a new figure."""
    if ax is None:
        return figure(width, height).add_subplot()
    _check_axes("ax", ax)
    return ax


def stacked(axes: Iterable[Axes] | None, ratio: float) -> tuple[Axes, Axes]:
    """The two given axes, or new ones above each other that share their x axis."""
    if axes is None:
        new = figure(7.0, 4.6)
        top, bottom = new.subplots(2, 1, sharex=True, height_ratios=(ratio, 1))
        return top, bottom
    given = tuple(axes) if isinstance(axes, Iterable) else (axes,)
    if len(given) != 2:
        raise InputError(
            f"`axes` must be two axes, the upper and the lower one; got {len(given)}."
        )
    for each in given:
        _check_axes("axes", each)
    return given


def _check_axes(name: str, given: Any) -> None:
    """Raise `InputError` for what is none, such as a figure, or an array of axes."""
    if not isinstance(given, Axes):
        raise InputError(
            f"`{name}` must be of Matplotlib, as `figure.subplots()` makes them; got "
            f"{checks.described(given)}."
        )


def looks() -> Iterator[dict[str, str]]:
    """Colours, and the same colours in other dashes when they are used up."""
    pairs = product(("-", "--", ":", "-."), COLOURS)
    return cycle({"linestyle": style, "color": colour} for style, colour in pairs)


def line(ax: Axes, x, y, label: str | None = None, **look) -> None:
    """One line, without a label out of the legend; of one point a dot."""
    look = {"linewidth": 1.2, "solid_capstyle": "round"} | look
    (drawn,) = ax.plot(np.asarray(x), np.asarray(y), label=entry(label), **look)
    if len(x) == 1:
        drawn.set_marker("o")
    drawn.set_rasterized(len(x) > MANY)


def recorded(ax: Axes, x, y, label: str = "recorded") -> None:
    """What was recorded, measured or simulated: broad and pale, so that a law drawn on
    it leaves both visible."""
    line(ax, x, y, label, color=MEASURED, linewidth=3.2)


def axis_label(name: str, unit: str) -> str:
    """Such as `displacement (µm)`."""
    return wrapped(with_unit(name, unit), _WIDE)


def wrapped(text: str, room: int) -> str:
    """Plain text in lines of so many letters."""
    # No line may end between a dollar and the backslash before it.
    return plain(textwrap.fill(text, room))


def plain(text: str) -> str:
    """Text in which a dollar is a dollar, and no mathematics begins."""
    return text.replace("$", r"\$")


def entry(label: str | None) -> str | None:
    """What Matplotlib shows in a legend as the label is: it leaves out those that begin
    with `_`, so a space without width goes first."""
    if label is None:
        return None
    return plain(f"\u200b{label}" if label.startswith("_") else label)


def finish(ax: Axes, x: str, y: str) -> None:
    """Axis labels, and quiet lines around the data."""
    ax.set_xlabel(x)
    ax.set_ylabel(y)
    ax.yaxis.get_offset_text().set_horizontalalignment("right")  # beside a legend
    ax.spines[["top", "right"]].set_visible(False)
    ax.grid(color="0.92", linewidth=0.8)
    ax.set_axisbelow(True)


def finish_loop(ax: Axes, x: str, y: str) -> None:
    """The same of outputs over inputs, which may be such as -0.00020."""
    finish(ax, x, y)
    ax.locator_params(axis="x", nbins=max(letters(ax) // _NUMBER, 2))


def whole_numbers(axis: Axis) -> None:
    """Ticks at whole numbers only, be it one."""
    axis.set_major_locator(MaxNLocator(integer=True, min_n_ticks=1))


def legend_above(ax: Axes, columns: int = 2) -> None:
    """A legend that hides nothing, if there is something to say, as broad as the axes:
    long labels take fewer columns, or several lines. What it has more than three lines
    makes a figure of our own higher."""
    handles, labels = ax.get_legend_handles_labels()
    if handles:
        room = max(letters(ax), 2 * _HANDLE)
        bare = (label.replace(r"\$", "$") for label in labels)
        labels = [wrapped(label, room - _HANDLE) for label in bare]
        columns = _columns(labels, columns, room)
        lines = sum(1 + label.count("\n") for label in labels) / columns
        figure = root(ax)
        if isinstance(figure, NotebookFigure) and lines > _LINES:
            more = _LINE * (lines - _LINES)
            figure.set_figheight(figure.get_figheight() + more)
        ax.legend(
            handles,
            labels,
            loc="lower left",
            bbox_to_anchor=(0, 1),
            ncols=columns,
            frameon=False,
            borderaxespad=0.2,
            handlelength=1.5,
            columnspacing=1.5,
        )


def letters(ax: Axes) -> int:
    """How many stand side by side in a line as broad as the axes, about."""
    return int(_LETTERS * root(ax).get_figwidth() * ax.get_position().width)


_LETTERS = 12  # an inch
_NUMBER = 9  # letters that one below an axis takes
_HANDLE = 6  # letters that the line before a label takes
_LINES, _LINE = 3, 0.22  # of a legend that a figure has room for, and inches of one


def _columns(labels: Sequence[str], most: int, room: int) -> int:
    """In how many columns labels fit into so many letters: one at least."""
    for columns in range(most, 1, -1):
        rows = -(-len(labels) // columns)
        parts = (labels[i : i + rows] for i in range(0, len(labels), rows))
        if sum(_HANDLE + max(map(len, part)) for part in parts) <= room:
            return columns
    return 1


def legend_below(ax: Axes, source: Axes | None = None, columns: int = 2) -> None:
    """A legend under the label of the x axis, of what `source` shows, by default the
    axes themselves."""
    handles, labels = (source or ax).get_legend_handles_labels()
    ax.legend(
        handles,
        labels,
        loc="upper center",
        bbox_to_anchor=(0.5, 0),
        borderaxespad=4.5,  # font sizes: below the ticks and the label
        ncols=columns,
        frameon=False,
    )


def root(ax: Axes) -> Figure:
    """The figure of some axes, also when they lie in a part of it."""
    return ax.figure.figure  # pyright: ignore[reportReturnType]


_FORMATS = (".png", ".pdf", ".svg")


def save(figure: Figure, path: str | os.PathLike) -> None:
    """Write a figure; the file is there whole or not at all.

    **Arguments:**

    - `figure`: what a function of this module returned, or any other figure.
    - `path`: ends with `.png`, `.pdf` or `.svg`.

    **Raises:** `InputError` for what is no figure, for another ending, or a file that
    cannot be written.
    """
    if not isinstance(figure, Figure):
        raise InputError(
            f"`figure` must be a figure, got {checks.described(figure)}. The order is "
            "`save(figure, path)`."
        )
    ending = path_of(path).suffix.lower()
    if ending not in _FORMATS:
        raise InputError(
            f"`path` must end with one of {', '.join(_FORMATS)}, which says what to "
            f"write; got {str(path)!r}."
        )
    write_atomically(path, lambda out: figure.savefig(out, format=ending[1:], dpi=200))


def time_label(along: Recording | Tracking) -> str:
    """What runs along the axis of `t`."""
    return "time (s)" if along.clocked else "sample"


def input_label(recording: Recording) -> str:
    """Name and unit of the input."""
    return axis_label(recording.names[0], recording.units[0])


def output_label(recording: Recording) -> str:
    """Name and unit of the output."""
    return axis_label(recording.names[1], recording.units[1])


def score(
    recording: Recording, trajectory: Trajectory, weights: ArrayLike | None = None
) -> str:
    """The error of a simulation, such as `NRMSE 0.233 %`, or when it diverges."""
    _check_rows(recording, trajectory)
    if (when := lost(trajectory)) is not None:
        return diverges(recording, when)
    w, w_hat = np.asarray(recording.w), np.asarray(trajectory.w)
    weights = None if weights is None else np.asarray(weights)
    with np.errstate(all="ignore"):  # of an output that stands still
        per_cent = 100 * float(metrics.nrmse(w, w_hat, weights))
    if not np.isfinite(per_cent):
        return "NRMSE undefined"
    return f"NRMSE {f'{per_cent:#.3g}'.rstrip('.')} %"


def known(recording: Recording, weights: ArrayLike | None) -> np.ndarray:
    """The output, with gaps where samples have no weight: what stands there was not
    measured."""
    w = np.array(recording.w, float)
    if weights is None:
        return w
    left_out = np.asarray(checks.weights(weights, recording.w)) == 0
    if np.all(left_out):
        raise InputError("`weights` are all 0: no sample is left to be drawn.")
    w[left_out] = np.nan
    return w


def draw_loop(
    ax: Axes,
    recording: Recording,
    trajectories: Sequence[Trajectory],
    labels: Sequence[str] | None,
    called: str = "recorded",
    weights: ArrayLike | None = None,
) -> None:
    """Output over input; what the recording is `called`."""
    w = known(recording, weights)
    recorded(ax, recording.u, w, called)
    for trajectory, look in labelled(recording, trajectories, labels):
        line(ax, trajectory.u, trajectory.w, **look)
    keep_in_view(ax, w, w, trajectories)
    finish_loop(ax, input_label(recording), output_label(recording))


def draw_output(
    ax: Axes,
    recording: Recording,
    trajectory: Trajectory,
    label: str,
    weights: ArrayLike | None = None,
) -> None:
    """Output over time."""
    _check_rows(recording, trajectory)
    w = known(recording, weights)
    recorded(ax, recording.t, w)
    line(ax, trajectory.t, trajectory.w, label, **next(looks()))
    keep_in_view(ax, w, w, [trajectory])
    finish(ax, "", output_label(recording))


def draw_error(
    ax: Axes,
    recording: Recording,
    trajectories: Sequence[Trajectory],
    labels: Sequence[str] | None = None,
    weights: ArrayLike | None = None,
) -> None:
    """Simulated minus recorded output over time."""
    w = known(recording, weights)
    for trajectory, look in labelled(recording, trajectories, labels):
        difference = np.asarray(trajectory.w) - w
        line(ax, trajectory.t, difference, linewidth=0.6, **look)
    ax.axhline(0, color="black", linewidth=0.8)
    keep_in_view(ax, w, np.zeros(1), trajectories)
    finish(ax, time_label(recording), axis_label("error", recording.units[1]))


def labelled(recording, trajectories, labels):
    """Each trajectory with the label and the colour of its line."""
    if labels is None:
        several = len(trajectories) > 1
        numbers = range(1, len(trajectories) + 1)
        labels = [f"simulated {i}" if several else "simulated" for i in numbers]
    if isinstance(labels, str) or len(labels) != len(trajectories):
        raise InputError(
            f"`labels` must hold one text for each of {len(trajectories)} trajectories,"
            f" got {labels!r}."
        )
    given = zip(trajectories, labels, looks(), strict=False)
    for trajectory, label, look in given:
        _check_rows(recording, trajectory)
        if (when := lost(trajectory)) is not None:
            label = f"{label} ({diverges(recording, when)})"
        yield trajectory, {"label": label, **look}


def lost(trajectory: Trajectory | Tracking) -> float | None:
    """When a simulation ceases to be finite."""
    rows = np.flatnonzero(~np.isfinite(np.asarray(trajectory.w)))
    return float(trajectory.t[rows[0]]) if rows.size else None


def diverges(along: Recording | Tracking, when: float) -> str:
    """What is said of a run that is not finite from then on."""
    where = moment(when)
    where = f"{where} s" if along.clocked else f"sample {where}"
    return f"diverges at {where}"


def keep_in_view(ax: Axes, w, shown, trajectories) -> None:
    """The scale of the output w that is followed, but for its gaps, about what is
    `shown`, where one that diverges would flatten it."""
    if any(lost(trajectory) is not None for trajectory in trajectories):
        low, high = np.nanmin(w), np.nanmax(w)
        # Of an output that stands still its size has to do.
        margin = ((high - low) or abs(high) or 1.0) / 2
        ax.set_ylim(np.nanmin(shown) - margin, np.nanmax(shown) + margin)


def _check_rows(recording: Recording, trajectory: Trajectory) -> None:
    if np.array_equal(recording.t, trajectory.t):
        return
    raise InputError(
        f"the trajectory, of {len(trajectory.w)} rows, does not have the times of the "
        f"recording, of {len(recording)} rows. Simulate along the recording that is "
        "drawn: `simulate(model, recording)`."
    )
