"""Experiment 8: electrical steel, one measured loop."""

import jax.numpy as jnp
import numpy as np

from .. import datasets
from .._recording import Recording
from .._refine import refine
from .._simulate import simulate
from ..models import AbstractModel, Duhem
from ._comparison import Comparison, Row
from ._published import (
    MEASURES,
    ROUNDED,
    coefficient_rows,
    copied,
    error_row,
    free_run_error,
    learned,
    refined,
    squared_error,
)

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
    law, script = learned(record, threshold=0.01), copied(COPIED, record)
    better = refined(law, record, fading=True)
    rows = [
        *coefficient_rows(law, {name: (None, x) for name, x in COPIED.items()}),
        error_row(
            "script's rounded law", free_run_error(script, record), None, 1.477e-2
        ),
        error_row("unrounded law", free_run_error(law, record)),
        error_row("refined law", free_run_error(better, record)),
    ]
    for name, each in (("rounded", script), ("unrounded", law), ("refined", better)):
        rows.append(error_row(f"{name} law, tenth period", _later(each, record)))
    rows += hystlab_rows()
    title = "Experiment 8: NO27 steel, squared errors in %"
    notes = (str(law), f"refined: {better}", MEASURES, ROUNDED, *_NOTES)
    return Comparison(title, tuple(rows), notes)


def hystlab_rows() -> list[Row]:
    """HystLab's record of the steel: its own fit, and a Duhem law beside it."""
    record = datasets.load("no27_steel", "hystlab")
    slope = float(jnp.max(record.w) / jnp.max(record.u))
    beta = 5 / float(jnp.max(record.u))
    start = Duhem(beta * slope, beta, (slope, 0.0, 0.0))
    fit = refine(start, record, fading=True)
    run = simulate(fit.value, record, w0=fit.stats["w0"][0])
    theirs = squared_error(record.w, datasets.no27_hystlab_fit())
    return [
        error_row("HystLab's record: HystLab's fit", theirs),
        error_row("  a Duhem law of five numbers", squared_error(record.w, run.w)),
    ]


def steel_loop() -> Recording:
    """The measured loop with the time and the input of the script."""
    measured = datasets.load("no27_steel")
    t = np.linspace(0, _PERIOD, _SAMPLES)
    record = Recording(t, measured.u, measured.w, names=measured.names)
    return record.with_input(_sine)


def _sine(t):
    return 20 * jnp.sin(jnp.pi * t / 5 - 3 * jnp.pi / 2)


def _later(law: AbstractModel, record: Recording) -> float:
    """Error in the last of several periods under the same sine."""
    t = np.linspace(0, _CYCLES * _PERIOD, _CYCLES * (_SAMPLES - 1) + 1)
    zero = np.zeros_like(t)
    longer = Recording(t, zero, zero).with_input(_sine)
    w = simulate(law, longer, w0=record.w[0], throw=False).w
    return squared_error(record.w, w[-_SAMPLES:])
