"""What models are made of: operators, friction, the parts of a magnetisation; and
what they hide, the output of a law that nobody measures."""

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure

from .._core import checks
from .._core.checks import InputError, described
from .._core.compiling import jit
from .._core.show import as_factor
from .._core.solution import RESULTS, Solution, outcome
from ..models import (
    AbstractModel,
    JilesAtherton,
    LuGre,
    PrandtlIshlinskii,
    Preisach,
    compacted,
)
from ..models._sequence import warn_of_units
from ..recording import Recording
from ..refinement import deviations, known_covariance
from ..signals import AbstractInputPath, Signals
from ..simulation import Trajectory, trajectory
from ..simulation._simulate import first_output
from . import _canvas


@_canvas.of_numbers
def preisach(
    model: Preisach,
    turns: np.ndarray | jax.Array | None = None,
    *,
    ax: Axes | None = None,
) -> Figure:
    """The plane of thresholds: the weight of each relay, and the staircase between
    those that are up, below and to the left of it, and those that are down.

    **Arguments:**

    - `model`: the model.
    - `turns`: inputs one after the other, each the end of a straight line, to whose
        last the staircase belongs; by default none is drawn.
    - `ax`: the panel to draw into.

    **Source:** Mayergoyz (1991), doi 10.1007/978-1-4612-3028-1.
    """
    ax = _canvas.single(ax, 5.2, 4.4)
    levels = np.asarray(model.levels)
    plane = np.ma.masked_array(
        np.asarray(model.plane()), np.triu(np.ones((len(levels) - 1,) * 2), 1) > 0
    )
    # Cells reach from one level to the next, on both axes: relay (i, j) is the one
    # whose thresholds are their upper right and lower left corner.
    size = float(np.max(np.abs(plane))) or 1.0
    signed = bool(np.min(plane) < 0)
    colours = ax.pcolormesh(
        levels,
        levels,
        plane,
        cmap="RdBu_r" if signed else "Blues",
        vmin=-size if signed else 0.0,
        vmax=size,
    )
    unit = _canvas.axis_label("weight", model.units[1])
    _canvas.root(ax).colorbar(colours, ax=ax, label=unit)
    _canvas.line(ax, levels[[0, -1]], levels[[0, -1]], color="black", linewidth=0.8)
    if turns is not None:
        heights = _heights(model, turns)
        # Beyond the last input no relay of a column is up: its height is the diagonal.
        some = heights > np.arange(len(heights))
        tops = np.where(some, levels[heights], np.nan)
        x = np.repeat(levels, 2)[1:-1]
        _canvas.line(ax, x, np.repeat(tops, 2), "staircase", color="C1", linewidth=2)
    ax.locator_params(nbins=5)
    _canvas.legend_above(ax)
    name, of = model.names[0], model.units[0]
    _canvas.finish(
        ax,
        _canvas.axis_label(f"{name} that turns down", of),
        _canvas.axis_label(f"{name} that turns up", of),
    )
    return _canvas.root(ax)


def _heights(model: Preisach, given: Any) -> np.ndarray:
    try:
        turns = jnp.asarray(given, model.levels.dtype)
    except (TypeError, ValueError):
        turns = jnp.zeros(())
    if turns.ndim != 1 or not len(turns):
        raise InputError(
            "`turns` must be inputs in order, shape (n,), got "
            f"{checks.described(given)}."
        )
    checks.finite("turns", turns)
    memory = model.memory
    zero = jnp.zeros_like(turns[0])
    m = memory.start(Signals(zero, turns[0], zero))
    for u in turns[1:]:
        now = Signals(zero, u, zero)
        m = memory.after(m, now, now)
    return np.asarray(m)


@_canvas.of_numbers
def densities(
    models: PrandtlIshlinskii | Mapping[str, PrandtlIshlinskii],
    *,
    ax: Axes | None = None,
) -> Figure:
    """Weights of plays over their radii, as lines from zero; of several models with
    their labels.

    **Arguments:** a model, or several by label; and the panel to draw into.

    **Raises:** `InputError` for no model, or models of different units.
    """
    ax = _canvas.single(ax, 6.0, 3.6)
    several = {None: models} if isinstance(models, PrandtlIshlinskii) else dict(models)
    if not several:
        raise InputError("there is no model to draw: `models` is empty.")
    known = {model.units: label for label, model in several.items() if any(model.units)}
    if len(known) > 1:
        raise InputError(
            f"`models` have numbers in different units, {' and '.join(map(str, known))}"
            f" of {' and '.join(map(repr, known.values()))}; draw those of the same "
            "units together."
        )
    of_u, of_w = next(iter(known), ("", ""))
    for (label, model), look in zip(several.items(), _canvas.looks(), strict=False):
        radii, weights = np.abs(model.radii), np.asarray(model.weights)
        order = np.argsort(radii)
        ax.vlines(radii[order], 0, weights[order], color=look["color"], linewidth=1.5)
        label, colour = _canvas.entry(label), look["color"]
        ax.plot(radii[order], weights[order], "o", color=colour, label=label)
    ax.axhline(0, color="black", linewidth=0.8)
    _canvas.legend_above(ax)
    per = f"{of_w}/{as_factor(of_u)}" if of_u and of_w else ""
    _canvas.finish(
        ax, _canvas.axis_label("radius", of_u), _canvas.axis_label("weight", per)
    )
    return _canvas.root(ax)


_POINTS = 401
_MEGA = 1e6
_BEYOND = 6.0  # Stribeck velocities that are shown where no record says how many


@_canvas.of_numbers
def friction(
    model: LuGre,
    recording: Recording | None = None,
    *,
    fastest: float | None = None,
    ax: Axes | None = None,
) -> Figure:
    """The Stribeck curve: the force of steady sliding over velocity, and what a record
    has beside it.

    **Arguments:**

    - `model`: a friction law with a `steady` force.
    - `recording`: shown as recorded forces over velocities, where given.
    - `fastest`: end of the velocity axis, m/s (input units a second); by default that
        of the record, or six times the model's Stribeck velocity.
    - `ax`: axes to draw into; a new figure by default.

    **Raises:** `InputError` for a record without a clock, which has no velocities, or
    whose input does not move, and for a `fastest` that is not positive.
    """
    ax = _canvas.single(ax, 5.6, 4.2)
    end = _BEYOND * float(model.stribeck) if fastest is None else fastest
    if recording is not None:
        if not recording.clocked:
            raise InputError("`recording` has no clock, so no velocity to draw over.")
        warn_of_units(model, recording)
        _, velocity = recording.path.samples()
        _canvas.recorded(ax, velocity, recording.w)
        end = float(np.max(np.abs(velocity))) if fastest is None else fastest
        if end == 0:
            raise InputError("the input of `recording` does not move; give `fastest`.")
    checks.positive("fastest", checks.number("fastest", end))
    # Not through 0, where steady forces jump.
    ahead = np.geomspace(1e-3 * end, end, _POINTS)
    colour = _canvas.COLOURS[0]
    for way, label in ((1, "steady sliding"), (-1, None)):
        velocities = way * ahead
        _canvas.line(ax, velocities, model.steady(velocities), label, color=colour)
    level = float(model.coulomb)
    for force in (level, -level):
        ax.axhline(force, color="black", linewidth=0.8, linestyle=":")
    ax.set_xlim(-1.05 * end, 1.05 * end)
    source = model if recording is None else recording
    unit = f"{source.units[0]}/s" if source.units[0] else "1/s"
    _canvas.finish_loop(
        ax,
        _canvas.axis_label("velocity", unit),
        _canvas.axis_label(source.names[1], source.units[1]),
    )
    _canvas.legend_above(ax)
    return _canvas.root(ax)


@_canvas.of_numbers
def magnetisation(
    model: JilesAtherton, trajectory: Trajectory, *, ax: Axes | None = None
) -> Figure:
    """Parts of the magnetisation over the field strength, along a simulation of the
    model: the anhysteretic curve that it is drawn to, what is irreversible and what is
    reversible.

    **Arguments:** the model; what `hystjax.simulate` made of it; the axes to draw into,
    by default those of a new figure.
    """
    ax = _canvas.single(ax, 6.2, 4.6)
    field = np.asarray(trajectory.u)
    parts = model.components(field, trajectory.w)
    _canvas.recorded(ax, field, parts.total / _MEGA, "magnetisation")
    drawn = {
        "anhysteretic": parts.anhysteretic,
        "irreversible": parts.irreversible,
        "reversible": parts.reversible,
    }
    for (label, part), look in zip(drawn.items(), _canvas.looks(), strict=False):
        _canvas.line(ax, field, part / _MEGA, label, **look)
    _canvas.finish_loop(ax, "field strength (A/m)", "magnetisation (MA/m)")
    _canvas.legend_above(ax)
    return _canvas.root(ax)


_STEPS = 16  # a sample interval, where no fit says how many it took
_BENEATH = {"linewidth": 3.2, "alpha": 0.4, "zorder": 1.9}
_UNNAMED = ("", ""), ("", "")  # input and output of a model, and their units


@_canvas.of_numbers
def hidden(
    recording: Recording,
    *found: AbstractModel | Solution,
    labels: Sequence[str] | None = None,
    w0: ArrayLike | None = None,
    settled: bool = False,
) -> Figure:
    """The output of the law inside of a model, which nobody measures, in a free run:
    over time, and over what drives the law, with its 95 % band. Below that band by
    itself, and by what further models differ from the first.

    The band is what the covariance of the fitted numbers makes of it, linearised, at
    each sample for itself; those that were `fixed` or `tied` count as known. So does
    the output that models begin with, but for one that was fitted, and the recording's
    first, which has the noise that the fit leaves. The band does not tell what the law
    may lack, and where residuals are correlated it is as much too narrow as standard
    errors are too small.

    **Arguments:**

    - `recording`: along which models run, n samples.
    - `found`: one model or several of a kind that hides a law (`inner`), such as
        `models.Oscillator`, whose hysteretic spring makes a force over the position, or
        `models.Butterfly`, whose device makes a polarisation over the input; for a band
        the `Solution` of `hystjax.refine` or `hystjax.discover`.
    - `labels`: one for each of them, for the legend.
    - `w0`: output that models begin with, as in `simulate`: by default the recording's
        first, which is as noisy as every other; `stats["w0"]` is the fitted one.
    - `settled`: whether the device had settled before the first sample. If so, models
        first go through the input that is known before it, as windows of a recording
        keep it; else they begin with the recording, as in `simulate`.

    **Raises:** `InputError` for models that hide no law, of two kinds, or of a batch,
    for labels that do not fit, for a `recording` without a clock where a model depends
    on the rate, and for one that is said to be `settled` though no input before it is
    known.
    """
    models = _checked(found)
    for model in models:
        model.check_times(recording.t, recording.clocked)
    path = _whole(recording) if settled else recording.path
    fits = [each.stats if isinstance(each, Solution) else {} for each in found]
    steps = max(int(stats.get("substeps", _STEPS)) for stats in fits)
    first = recording.w[0] if w0 is None else first_output(w0)
    runs, spreads = [], []
    for model, given in zip(models, found, strict=True):
        known = _with_start(given, w0, settled)
        seen = _seen(compacted(model), path, first, steps, *known)
        driver, made, spread = (x[-len(recording) :] for x in seen)
        runs.append(Trajectory(recording.t, driver, made, _ended(made), {}))
        spreads.append(_canvas.CERTAIN * np.asarray(spread))
    axes: Any = models[0].inner_axes(recording.names, recording.units)
    return _drawn(recording, runs, spreads, labels, axes)


def _with_start(
    given: Any, w0: ArrayLike | None, settled: bool
) -> tuple[tuple[str, ...], Float[np.ndarray, "q q"]]:
    """The fitted parameters by name; and their covariance, and behind it that of the
    output which a run begins with."""
    names, covariance = known_covariance(given)
    whole, p = np.pad(np.asarray(covariance), (0, 1)), len(names)
    if not names or settled:
        return names, whole
    stats = given.stats
    if w0 is None:
        whole[p, p] = np.nan_to_num(float(stats["rmse"][0])) ** 2
        return names, whole
    for i in np.flatnonzero(np.asarray(stats["w0"]) == np.asarray(w0)):  # fitted
        known = stats["certainty"].names
        whole[p, p] = float(stats["w0_standard_errors"][i]) ** 2
        if (start := f"start[{i}]") in known:
            row = known.index(start)
            every = np.asarray(stats["covariance"])[row]
            whole[p] = whole[:, p] = np.append(every[:p], every[row])
    return names, whole


def _ended(made: Float[Array, " n"]) -> RESULTS:
    return outcome(jnp.all(jnp.isfinite(made)), RESULTS.diverged)


def hides(model: Any) -> bool:
    """Whether there is a law inside of the model that `hidden` can draw."""
    return isinstance(model, AbstractModel) and model.inner_axes(*_UNNAMED) is not None


def _checked(found: Sequence[Any]) -> list[AbstractModel]:
    """The models; `InputError` unless they can be drawn together."""
    models = [each.value if isinstance(each, Solution) else each for each in found]
    strange = [described(each) for each in models if not hides(each)]
    if strange or not models:
        raise InputError(
            "`hidden` draws what the law inside of a `models.Oscillator` or `models."
            f"Butterfly` makes; got {strange[0] if strange else 'none'}. Outputs that "
            "were measured are drawn by `fit`."
        )
    made = {each.inner_axes(*_UNNAMED)[1] for each in models}
    if len(made) > 1:
        said = " and a ".join(sorted(name for name, _ in made))
        raise InputError(f"`hidden` got models of a {said}; draw one kind at a time.")
    return models


def _whole(recording: Recording) -> AbstractInputPath:
    """The input of a recording and all that is known before it, as one path."""
    past = recording.past
    if past is None:
        raise InputError(
            "`settled=True` takes models through the input before the recording, and "
            "none is known. Take a later part of a longer recording, by `window`."
        )
    t = jnp.concatenate([past.t, recording.t])
    u = jnp.concatenate([past.u, recording.u])
    return recording.interpolation.path(t, u)


@jit
def _seen(
    model: AbstractModel,
    path: AbstractInputPath,
    first: Float[Array, ""],
    steps: int,
    names: tuple[str, ...],
    covariance: Float[ArrayLike, "p p"],
) -> tuple[Float[Array, " n"], Float[Array, " n"], Float[Array, " n"]]:
    """What drives the law inside of a model, what it makes, and the standard deviations
    of that by the covariance of some of the model's parameters and its first output."""

    def run(values: Float[Array, " p"]):
        *own, first = values
        device = model.with_parameters(dict(zip(names, own, strict=True)))
        x, m = trajectory(device, path, first, steps)
        inside: Any = jax.vmap(device.inner)
        driver, made = inside(x, m, path.signals())
        return made, (driver, made)

    own = model.parameters()
    values = jnp.array([*(own[name] for name in names), first], path.t.dtype)
    slopes, (driver, made) = jax.jacfwd(run, has_aux=True)(values)
    return driver, made, deviations(slopes, covariance)


def _drawn(
    recording: Recording,
    runs: Sequence[Trajectory],
    spreads: Sequence[np.ndarray],
    labels: Sequence[str] | None,
    axes: tuple[tuple[str, str], tuple[str, str]],
) -> Figure:
    """The panels of runs whose input is what drives a law, and whose output is hidden;
    `axes` are their names and units."""
    certain = any(np.any(spread > 0) for spread in spreads)
    below = certain or len(runs) > 1
    figure = _canvas.figure(10.0, 4.8 if below else 3.6)
    time, loop, *rest = figure.subplot_mosaic(
        [["time", "loop"], ["apart", "loop"]] if below else [["time", "loop"]],
        width_ratios=(1.5, 1),
        height_ratios=(2, 1) if below else (1,),
    ).values()
    first = np.asarray(runs[0].w)
    looks = _canvas.labelled(recording, runs, labels)
    for (run, look), spread in zip(looks, spreads, strict=True):
        w, colour = np.asarray(run.w), look["color"]
        # Beneath the first, which one that is close to it would hide.
        near: Any = {} if run is runs[0] else _BENEATH
        for ax, x in ((time, run.t), (loop, run.u)):
            _shade(ax, np.asarray(x), w, spread, colour)
            _canvas.line(ax, x, w, **look, **near)
        for ax in rest:
            _shade(ax, np.asarray(run.t), w - first, spread, colour, "95 % band")
            _canvas.line(ax, run.t, w - first, color=colour)
    driver, made = (_canvas.axis_label(*axis) for axis in axes)
    across = _canvas.time_label(recording)
    _canvas.finish(time, "" if below else across, made)
    _canvas.finish_loop(loop, driver, made)
    _canvas.legend_above(time, columns=3)
    for ax in rest:
        ax.sharex(time)
        time.tick_params(labelbottom=False)
        _canvas.finish(ax, across, _canvas.axis_label("deviation", axes[1][1]))
        _canvas.legend_above(ax)
    figure.align_ylabels([time, *rest])
    return figure


def _shade(ax: Axes, x, middle, spread, colour: str, label: str | None = None) -> None:
    """The band about a curve, one piece for each way that it goes: whole, it would
    cover itself where it turns, and not be filled there."""
    if not np.any(spread > 0):
        return
    ways = np.sign(np.diff(x))
    ends = [0, *(np.flatnonzero(ways[1:] != ways[:-1]) + 1), len(x) - 1]
    low, high = (np.stack([x, middle + s], axis=1) for s in (-spread, spread))
    pieces = [
        np.concatenate([low[a : b + 1], high[a : b + 1][::-1]])
        for a, b in pairwise(ends)
    ]
    look = {"color": colour, "alpha": 0.3, "linewidth": 0, "zorder": 1.8}
    band = ax.add_collection(PolyCollection(pieces, label=label, **look))
    band.set_rasterized(len(x) > _canvas.MANY)
    ax.autoscale_view()
