"""Experiments 6 and 8: a measured piezo actuator and electrical steel."""

from functools import partial

import jax.numpy as jnp
import numpy as np

from ..models import AbstractModel, Duhem
from ..plot import _canvas
from ..recording import Recording, datasets
from ..refinement import refine
from ..simulation import Trajectory, judge, simulate
from ._document import Comparison, Row
from ._figures import Side, as_run, averaged, published_side, runs, side_by_side
from ._published import (
    MEASURES,
    REFINED_LAW,
    ROUNDED,
    ROUNDED_LAW,
    coefficient_rows,
    error_row,
    free_run_error,
    learned,
    percent,
    squared_error,
    three_laws,
)

_SHORT = ("rounded law", "unrounded law", "refined law")
_PERIOD, _SAMPLES, _CYCLES = 10.0, 1000, 10
COPIED_STEEL = {
    "w": -0.814,
    "u": 0.651,
    "du": 2.983,
    "w*|w|": 0.063,
    "u*|du|": -0.026,
    "u*|w|": -0.058,
    "du*|du|": -0.132,
    "du*|w|": -0.061,
}
_NOTES = (
    "The input is the flux density as the script has it, 20 sin(pi t/5 - 3 pi/2) in "
    "units of 0.01 T and with 10 s for the period of 0.1 s; the output is the field "
    "strength in A/m.",
    "There is no second loop to judge on. Instead the laws run on for ten periods: the "
    "last is compared with the measured one.",
    "Refined without regard for that, the law follows the one loop to 1.76e-3 % and "
    "then diverges; so laws are required to forget their initial value.",
    "HystLab's record is another loop of this steel, moment over field, 988 rows with "
    "no rate. The fitted moment beside it in the file has next to no hysteresis: it "
    "passes 0 where the measured branches are 9.2 A m2 from it on either side. The "
    "Duhem law, with u' times a polynomial of degree 2, is fitted to all rows.",
)


def experiment_8() -> Comparison:
    """Field strength of NO27-1450H steel over its flux density."""
    record = steel_loop()
    law = learned(record, threshold=0.01)
    laws = three_laws(law, COPIED_STEEL, record, fading=True)
    script, better = laws[ROUNDED_LAW], laws[REFINED_LAW]
    later = {name: _tenth_period(each, record) for name, each in laws.items()}
    other = hystlab()
    rows = [
        *coefficient_rows(law, {name: (None, x) for name, x in COPIED_STEEL.items()}),
        error_row(
            "script's rounded law", free_run_error(script, record), None, 1.477e-2
        ),
        error_row("unrounded law", free_run_error(law, record)),
        error_row("refined law", free_run_error(better, record)),
    ]
    for name, run in zip(_SHORT, later.values(), strict=True):
        rows.append(error_row(f"{name}, tenth period", _error(record, run)))
    theirs, ours = (_error(other.record, run) for run in other.runs.values())
    rows += [
        error_row("HystLab's record: HystLab's fit", theirs),
        error_row("  a Duhem law of five numbers", ours),
    ]
    title = "Experiment 8: NO27 steel, squared errors in %"
    notes = (str(law), f"refined: {better}", MEASURES, ROUNDED, *_NOTES)
    drawing = partial(
        side_by_side,
        published_side({ROUNDED_LAW: script}, record, "measured"),
        Side("The tenth period", record, later, "measured"),
        other,
        draw_errors=_canvas.draw_error,
    )
    return Comparison(title, tuple(rows), notes, drawing)


def hystlab() -> Side:
    """HystLab's record of the steel: its own fit, and a Duhem law beside it."""
    record = datasets.load("no27_steel", "hystlab")
    slope = float(jnp.max(record.w) / jnp.max(record.u))
    beta = 5 / float(jnp.max(record.u))
    start = Duhem(beta * slope, beta, (slope, 0.0, 0.0))
    fit = refine(start, record, fading=True)
    run = simulate(fit.value, record, w0=fit.stats["w0"][0])
    theirs = as_run(record, datasets.no27_hystlab_fit())
    both = {"HystLab's fit": theirs, "a Duhem law": run}
    return Side("HystLab's record, a row a second", record, both, "measured")


def steel_loop() -> Recording:
    """The measured loop with the time and the input of the script."""
    measured = datasets.load("no27_steel")
    t = np.linspace(0, _PERIOD, _SAMPLES)
    units = "0.01 T", measured.units[1]
    record = Recording(t, measured.u, measured.w, names=measured.names, units=units)
    return record.with_input(_sine)


def _sine(t):
    return 20 * jnp.sin(jnp.pi * t / 5 - 3 * jnp.pi / 2)


def _error(record: Recording, run: Trajectory) -> float:
    return squared_error(record.w, run.w)


def _tenth_period(law: AbstractModel, record: Recording) -> Trajectory:
    """The last of several periods under the same sine, at the times of the first."""
    t = np.linspace(0, _CYCLES * _PERIOD, _CYCLES * (_SAMPLES - 1) + 1)
    zero = np.zeros_like(t)
    longer = Recording(t, zero, zero).with_input(_sine)
    w = simulate(law, longer, w0=record.w[0], throw=False).w
    return as_run(record, w[-_SAMPLES:])


COPIED_PIEZO = {"1": -0.176, "w": -2.388, "u": 0.581, "du": 0.119, "w*|w|": -0.076}
_PUBLISHED = {
    "1": (-0.176, -0.176),
    "w": (-2.38, -2.383),
    "u": (0.58, 0.580),
    "du": (0.12, 0.119),
    "w*|w|": (-0.076, -0.076),
}
_NOTE = (
    "The law is fitted to rows 35001:45001; rows 17500:35000 are unseen. `hystjax "
    "reproduce measured` refines laws of this and other devices."
)


def experiment_6() -> Comparison:
    """Measured piezo actuator, rows 35001:45001, judged on rows 17500:35000 too."""
    own, unseen = piezo(35001, 45001), piezo(17500, 35000)
    law = learned(own, threshold=0.01)
    laws = three_laws(law, COPIED_PIEZO, own, free_start=True)
    script, better = laws[ROUNDED_LAW], laws[REFINED_LAW]
    rounded, later = judge(script, own), judge(script, unseen)
    over_own = float(later.errors["rmse"]) / float(jnp.ptp(own.w))
    rows = (
        *coefficient_rows(law, _PUBLISHED),
        Row("NRMSE, own rows, %", 0.23, None, _nrmse(law, own)),
        Row("  with the script's rounded law", 0.23, 0.2328, percent(rounded, "nrmse")),
        Row("  with the refined law", None, None, _nrmse(better, own)),
        Row("NRMSE, unseen rows 17500:35000, %", None, None, _nrmse(law, unseen)),
        Row("  rounded law, unseen", None, None, percent(later, "nrmse")),
        Row(
            "  rounded law, over the range of the own rows", None, 0.248, 100 * over_own
        ),
        Row("  refined law, unseen", None, None, _nrmse(better, unseen)),
        Row("R2, own rows, rounded law", 0.99, 0.99996, float(rounded.errors["r2"])),
        Row(
            "squared error, own rows, rounded law, %",
            None,
            4.37e-3,
            percent(rounded, "relative_squared_error"),
            percent(rounded, "relative_error"),
        ),
    )
    title = "Experiment 6: measured piezo actuator, u = 150 sin(2 pi t - 46.2)"
    drawing = partial(
        side_by_side,
        published_side({ROUNDED_LAW: script}, own, "measured"),
        Side("On unseen rows", unseen, runs(laws, unseen), "measured"),
        draw_errors=averaged(101),
    )
    return Comparison(title, rows, (str(law), ROUNDED, _NOTE), drawing)


def _nrmse(law: AbstractModel, record: Recording) -> float:
    return percent(judge(law, record), "nrmse")


def piezo(start: int, stop: int) -> Recording:
    """Rows of the recording with its input replaced by the fitted sine, as the paper's
    script does."""
    record = datasets.load("piezo_ayala").window(start, stop)
    return record.with_input(_fitted_sine)


def _fitted_sine(t):
    return 150 * jnp.sin(6.28318530724 * t - 46.2178545458)
