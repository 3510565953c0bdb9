"""Experiment 8: electrical steel, one measured loop."""

from functools import partial

import jax.numpy as jnp
import numpy as np

from .. import datasets
from .._recording import Recording
from .._refine import refine
from .._simulate import Trajectory, simulate
from ..models import AbstractModel, Duhem
from ..plot import _panels
from ._comparison import Comparison
from ._figures import Side, as_run, published_side, side_by_side
from ._published import (
    MEASURES,
    REFINED_LAW,
    ROUNDED,
    ROUNDED_LAW,
    coefficient_rows,
    error_row,
    free_run_error,
    learned,
    squared_error,
    three_laws,
)

_SHORT = ("rounded law", "unrounded law", "refined law")
_PERIOD, _SAMPLES, _CYCLES = 10.0, 1000, 10
COPIED = {
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
    laws = three_laws(law, COPIED, record, fading=True)
    script, better = laws[ROUNDED_LAW], laws[REFINED_LAW]
    later = {name: _tenth_period(each, record) for name, each in laws.items()}
    other = hystlab()
    rows = [
        *coefficient_rows(law, {name: (None, x) for name, x in COPIED.items()}),
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
        draw_errors=_panels.draw_error,
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
