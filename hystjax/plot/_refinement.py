"""Before and after refinement, and how sure its result is."""

import numpy as np
from matplotlib.figure import Figure

from .._recording import Recording
from .._simulate import Trajectory
from .._solution import Solution
from . import _canvas, _panels

_CERTAIN = 1.96  # standard errors to either side hold 95 % of a normal distribution


def refinement(
    recording: Recording, before: Trajectory, after: Trajectory, solution: Solution
) -> Figure:
    """Four panels: the errors before and after; the error after with the 95 % band of
    the simulated output; the autocorrelation of the residuals; and the correlation of
    the parameters.

    **Arguments:**

    - `recording`: the (first) recording that was refined on.
    - `before`, `after`: simulations of its rows.
    - `solution`: what `hystjax.refine` returned.

    **Raises:** `InputError` when a trajectory does not have the recording's rows.
    """
    figure = _canvas.figure(10.0, 6.4)
    panels = figure.subplot_mosaic(
        [["errors", "correlation"], ["band", "autocorrelation"]], width_ratios=(1.7, 1)
    )
    scores = [_panels.score(recording, run) for run in (before, after)]
    labels = [f"before: {scores[0]}", f"after: {scores[1]}"]
    _panels.draw_error(panels["errors"], recording, [before, after], labels)
    _canvas.legend_above(panels["errors"])
    _draw_band(panels["band"], recording, solution)
    _draw_autocorrelation(panels["autocorrelation"], solution)
    _draw_correlation(figure, panels["correlation"], solution)
    return figure


def _draw_band(ax, recording, solution) -> None:
    """Residuals with the band within which the simulated output is certain."""
    n = len(recording)
    t = np.asarray(recording.t)
    residuals = np.asarray(solution.stats["residuals"])[0, :n]
    spread = _CERTAIN * np.asarray(solution.stats["certainty"].output)[0, :n]
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
    across = _panels.time_label(recording)
    _canvas.finish(ax, across, _canvas.axis_label("residual", recording.units[1]))
    _canvas.legend_above(ax)


def _draw_autocorrelation(ax, solution) -> None:
    """Autocorrelation over the lag, with the band of white noise."""
    correlation = np.asarray(solution.stats["autocorrelation"])[0]
    used = np.count_nonzero(np.asarray(solution.stats["residuals"])[0])
    lags = np.arange(1, len(correlation) + 1)
    ax.vlines(lags, 0, correlation, color=_canvas.COLOURS[0])
    limit = _CERTAIN / max(used, 1) ** 0.5
    ax.axhspan(-limit, limit, color="0.85", zorder=0, label="white noise, 95 %")
    ax.axhline(0, color="black", linewidth=0.8)
    _canvas.finish(ax, "lag (samples)", "autocorrelation of residuals")
    _canvas.legend_above(ax)


def _draw_correlation(figure, ax, solution) -> None:
    """Correlation of the estimated parameters as a map."""
    names = list(solution.value.parameters())
    names = [name for name in names if name in solution.stats["standard_errors"]]
    covariance = np.asarray(solution.stats["covariance"])[: len(names), : len(names)]
    errors = np.sqrt(np.diag(covariance))
    image = ax.imshow(
        covariance / np.outer(errors, errors), vmin=-1, vmax=1, cmap="RdBu_r"
    )
    ax.set_xticks(range(len(names)), names, rotation=45, ha="right")
    ax.set_yticks(range(len(names)), names)
    ax.set_title("correlation of the parameters", fontsize="medium")
    figure.colorbar(image, ax=ax, shrink=0.8)
