"""`hystjax invert`: the input that makes a saved law follow a reference."""

import argparse

import numpy as np

from .._core import files
from .._core.checks import ComputationError
from ..inversion import invert
from ..models import load
from ..simulation import FixedStep
from . import _arguments

_DETAILS = """\
The reference is a file with columns of time and of the output that is asked for, such
as `hystjax simulate` writes. With --input, the input that was measured with it, the law
starts where that does, and what is found is compared with it. The result is a CSV file
with the columns t, u, w (the output that u leads to), error, margin and reached (1 or
0). Limits are kept; where the output cannot follow, that is said, and u comes as close
as can be.

example:
  hystjax invert report/law.json reference.csv --time t --output w \\
      --limits 0:150 --speed 2000 --out drive.csv
"""


def add(commands) -> None:
    """Add the command."""
    parser = _arguments.command(
        commands, "invert", run, "the input that makes a law follow", _DETAILS
    )
    parser.add_argument("model", metavar="MODEL.json", help="a law saved by hystjax")
    _arguments.add_recording(parser, output_required=True, input_required=False)
    option = parser.add_argument
    _arguments.add_rows(parser)
    option("--u0", type=float, help="input at the start (default: measured, or 0)")
    option(
        "--limits", metavar="LOW:HIGH", type=_limits, help="least and greatest input"
    )
    option("--speed", type=float, help="most that the input may change in 1 s")
    option(
        "--substeps", type=int, default=4, help="steps a sample interval (default: 4)"
    )
    option("--out", metavar="CSV", default="inverse.csv", help="file for the result")


def run(options) -> int:
    """Invert, say how well that goes, and write the table."""
    _arguments.check_out(options.out, options.model, options.file)
    model = load(options.model)
    record = _arguments.recording(options)
    record = _arguments.chosen_rows(options, record)
    model.check_times(record.t, record.clocked)  # outputs alone do not tell of a clock
    how = {
        "u0": options.u0,
        "limits": options.limits,
        "speed": options.speed,
        "method": FixedStep(options.substeps),
    }
    if options.input is None:
        found = invert(model, record.w, record.t, **how)
    else:
        found = invert(model, record, **how)
    if not np.all(np.isfinite(found.value.u)):
        raise ComputationError(
            "the law diverges on its way along the reference; look whether it can "
            "start there, or take more --substeps."
        )
    files.write_text(options.out, _csv(found))
    print(model)
    for line in _told(found, record, options):
        print(line)
    print(f"wrote {options.out}")
    return 0


def _told(found, record, options):
    u, error = np.asarray(found.value.u), np.asarray(found.value.error)
    of_u, of_w = (f" {unit}" if unit else "" for unit in record.units)
    size = np.ptp(record.w) or 1.0
    rms = np.sqrt(np.mean(error**2))
    yield f"input from {u.min():.6g} to {u.max():.6g}{of_u}"
    yield f"output off by {rms:.3g}{of_w} rms, {100 * rms / size:.3g} % of its range"
    reached = np.asarray(found.stats["reached"])
    if not np.all(reached):
        first = f"{float(found.stats['first_missed']):.6g}"
        yield (
            f"not reached at {np.sum(~reached)} of {len(reached)} samples, first at "
            f"{f'{first} s' if record.clocked else f'sample {first}'}"
        )
    margin = float(np.min(found.stats["margin"]))
    if margin <= 0:
        yield (
            f"the input is not the only one: the output's least slope is {margin:.3g}"
        )
    if options.input is not None:
        off = np.sqrt(np.mean((u - np.asarray(record.u)) ** 2))
        share = f"{100 * off / (np.ptp(record.u) or 1.0):.3g} % of its range"
        yield f"off the measured input by {off:.3g}{of_u} rms, {share}"


def _limits(text: str) -> tuple[float, float]:
    """Parse `LOW:HIGH`."""
    low, colon, high = text.partition(":")
    try:
        limits = float(low), float(high)
    except ValueError:
        limits = np.nan, np.nan
    if not (colon and limits[0] < limits[1]):
        raise argparse.ArgumentTypeError(
            f"{text!r} is no range of inputs such as -10:150; write --limits=-10:150 "
            "where it begins with a minus."
        )
    return limits


def _csv(found) -> str:
    value, stats = found.value, found.stats
    columns = (value.t, value.u, value.w, value.error, stats["margin"])
    rows = zip(*(np.asarray(column).tolist() for column in columns), strict=True)
    reached = np.asarray(stats["reached"]).astype(int).tolist()
    texts = (
        ",".join([*map(repr, row), str(good)])
        for row, good in zip(rows, reached, strict=True)
    )
    return "t,u,w,error,margin,reached\n" + "".join(f"{text}\n" for text in texts)
