"""Commands on a saved law. `hystjax simulate`: its free run along the input of a file.
`hystjax invert`: the input that makes it follow a reference. `hystjax export`: a
program, a unit for simulators, or text."""

import argparse
from functools import partial
from pathlib import Path

import numpy as np

from .. import export
from .._core import files
from .._core.checks import ComputationError, InputError
from .._core.compiling import run_once
from .._core.show import moment, plain_table, with_unit
from .._core.solution import raise_unless_successful
from ..inversion import invert
from ..inversion._invert import check_clock
from ..models import load
from ..models._around import sees
from ..models._sequence import warn_of_units
from ..simulation import FixedStep, judge, simulate
from ..simulation._simulate import (
    error_table,
    needs_start,
    warn_beyond,
    where_lost,
)
from . import _arguments

_ABOUT_SIMULATE = """\
With --output the free run starts from the measured output's first row and is judged
against it; without, --w0 says where it starts, but for operators such as
PrandtlIshlinskii, which do not depend on it. The result is a CSV file with the columns
t, u and w, and recorded with --output. A warning says where the input goes farther
than those that the law was fitted on, or faster, of a law that depends on the rate.

example:
  hystjax simulate report/law.json piezo.csv --time 1 --input 3 --output 2 \\
      --rows 17500:35000 --out simulated.csv
"""


def add_simulate(commands) -> None:
    """Add the command."""
    parser = _arguments.command(
        commands,
        "simulate",
        run_simulate,
        "run a saved law along an input",
        _ABOUT_SIMULATE,
    )
    parser.add_argument("model", metavar="MODEL.json", help="a law saved by hystjax")
    _arguments.add_recording(parser, output_required=False)
    _arguments.add_rows(parser)
    parser.add_argument("--w0", type=_arguments.number, help="output at the first row")
    _arguments.add_out(parser, "simulated.csv", "file for the result", "CSV")


def run_simulate(options) -> int:
    """Simulate, judge where there is a measured output, and write the table."""
    _arguments.check_out(options.out, options.model, options.file)
    model = load(options.model)
    if options.output is None and options.w0 is None and needs_start(model):
        raise InputError(
            "a free run needs a start: give --w0, or --output with the measured output."
        )
    record = _arguments.recording(options)
    record = _arguments.chosen_rows(options, record)
    table, first = "", options.rows[0] if options.rows else 0
    with run_once(len(record)):
        if options.output:
            judgement = judge(model, record, w0=options.w0)
            trajectory = judgement.trajectory
            warn_beyond(model, trajectory.stats.get("beyond"), trajectory.clocked)
            table = plain_table(error_table({"simulated": judgement}))
        else:
            trajectory = simulate(model, record, w0=options.w0, throw=False)
    raise_unless_successful(trajectory, lambda lost: where_lost(lost, first))
    columns = {"t": trajectory.t, "u": trajectory.u, "w": trajectory.w}
    recorded = {"recorded": record.w} if options.output else {}
    files.write_text(options.out, _arguments.csv_text(columns | recorded))
    print(model)
    for symbol, name, unit in zip("uw", model.names, model.units, strict=True):
        print(f"{symbol}: {with_unit(name, unit)}")
    if table:
        print(table)
    print(f"wrote {options.out}")
    return 0


_ABOUT_INVERT = """\
The reference is a file with columns of time and of the output that is asked for, such
as `hystjax simulate` writes. With --input, the input that was measured with it, the law
starts where that does, and what is found is compared with it. The result is a CSV file
with the columns t, u, w (the output that u leads to), error, margin and reached (1 or
0). Limits are kept; where the output cannot follow, that is said, and u is the closest
of the inputs tried.

example:
  hystjax invert report/law.json reference.csv --time t --output w \\
      --limits 0:150 --speed 2000 --out drive.csv
"""


def add_invert(commands) -> None:
    """Add the command."""
    parser = _arguments.command(
        commands,
        "invert",
        run_invert,
        "the input that makes a law follow",
        _ABOUT_INVERT,
    )
    parser.add_argument("model", metavar="MODEL.json", help="a law saved by hystjax")
    _arguments.add_recording(parser, output_required=True, input_required=False)
    option = parser.add_argument
    _arguments.add_rows(parser)
    option(
        "--u0",
        type=_arguments.number,
        help="input at the start (default: measured, or 0)",
    )
    option(
        "--limits", metavar="LOW:HIGH", type=_limits, help="least and greatest input"
    )
    option(
        "--speed", type=_arguments.number, help="most that the input may change in 1 s"
    )
    option(
        "--substeps", type=int, default=4, help="steps a sample interval (default: 4)"
    )
    _arguments.add_out(parser, "inverse.csv", "file for the result", "CSV")


def run_invert(options) -> int:
    """Invert, say how well that goes, and write the table."""
    _arguments.check_out(options.out, options.model, options.file)
    model = load(options.model)
    record = _arguments.recording(options)
    record = _arguments.chosen_rows(options, record)
    # Outputs alone tell neither of a clock nor of units.
    model.check_times(record.t, record.clocked)
    if options.speed is not None:
        check_clock(record.clocked)
    how = {
        "u0": options.u0,
        "limits": options.limits,
        "speed": options.speed,
        "method": FixedStep(options.substeps),
    }
    if options.input is None:
        warn_of_units(model, record)
        found = invert(model, record.w, record.t, **how)
    else:
        found = invert(model, record, **how)
    made = found.value.w[:-1] if sees(model, "du") else found.value.w
    if not (np.all(np.isfinite(found.value.u)) and np.all(np.isfinite(made))):
        raise ComputationError(
            "the law diverges on its way along the reference; look whether it can "
            "start there, or take more --substeps."
        )
    value, stats = found.value, found.stats
    columns = {name: getattr(value, name) for name in ("t", "u", "w", "error")}
    columns["margin"] = stats["margin"]
    columns["reached"] = np.asarray(stats["reached"]).astype(int)
    files.write_text(options.out, _arguments.csv_text(columns))
    print(model)
    for line in _met(found, record, model, options):
        print(line)
    print(f"wrote {options.out}")
    return 0


def _met(found, record, model, options):
    u, error = np.asarray(found.value.u), np.asarray(found.value.error)
    reached = np.asarray(found.stats["reached"])
    if sees(model, "du"):  # no input makes the last output
        error, reached = error[:-1], reached[:-1]
    units = [own or its for own, its in zip(record.units, model.units, strict=True)]
    of_u, of_w = (f" {unit}" if unit else "" for unit in units)
    size = np.ptp(record.w) or 1.0
    rms = np.sqrt(np.mean(error**2))
    yield f"input from {u.min():.6g} to {u.max():.6g}{of_u}"
    yield f"output off by {rms:.3g}{of_w} rms, {100 * rms / size:.3g} % of its range"
    if not np.all(reached):
        first = moment(found.stats["first_missed"])
        yield (
            f"not reached at {np.sum(~reached)} of {len(reached)} samples, first at "
            f"{f'{first} s' if record.clocked else f'sample {first}'}"
        )
    margin = float(np.min(found.stats["margin"]))
    if margin <= 0:
        yield (
            "other inputs lead to the same output, which does not follow the input one "
            f"way everywhere: its least slope that way is {margin:.3g}"
        )
    if options.input is not None:
        off = np.sqrt(np.mean((u - np.asarray(record.u)) ** 2))
        share = f"{100 * off / (np.ptp(record.u) or 1.0):.3g} % of its range"
        yield f"off the measured input by {off:.3g}{of_u} rms, {share}"


def _limits(text: str) -> tuple[float, float]:
    """Parse `LOW:HIGH`."""
    low, colon, high = text.partition(":")
    try:
        limits = _arguments.number(low), _arguments.number(high)
    except argparse.ArgumentTypeError:
        limits = np.nan, np.nan
    if not (colon and limits[0] < limits[1]):
        raise argparse.ArgumentTypeError(
            f"{text!r} is no range of inputs such as -10:150"
        )
    return limits


_ABOUT_EXPORT = """\
With FILE, the recording that the law is from, the file that is made tells its range and
holds a test of itself against the first samples of it.

formats:
  c         C99: a struct, and functions for a step and for the inverse's step
  fmu2      a unit for co-simulation, FMI 2.0, with its C sources
  fmu3      the same, FMI 3.0
  python    functions that need NumPy alone
  matlab    a function of MATLAB and Octave
  modelica  a package of Modelica
  latex     the equation
  text      the equation, as it is printed

examples:
  hystjax export report/law.json --to c --out law.c
  hystjax export report/law.json piezo.csv --time 1 --input 3 --output 2 \\
      --to fmu3 --out piezo.fmu
"""


def _text(write, *names: str):
    """What writes the text that a function of a model makes, given options by names."""

    def to(path, model, **how) -> None:
        text = write(model, **{name: how[name] for name in names})
        files.write_text(path, text if text.endswith("\n") else f"{text}\n")

    return to


# How each is written, and how its file is called by default.
_FORMATS = {
    "c": (_text(export.to_c, "name", "record"), ".c"),
    "fmu2": (partial(export.fmu, version=2), ".fmu"),
    "fmu3": (partial(export.fmu, version=3), ".fmu"),
    "python": (_text(export.to_numpy, "name", "record"), ".py"),
    "matlab": (_text(export.to_matlab, "name", "record"), ".m"),
    "modelica": (_text(export.to_modelica, "name", "record"), ".mo"),
    "latex": (_text(export.to_latex), ".tex"),
    "text": (_text(export.to_text), ".txt"),
}
_EQUATIONS = ("latex", "text")


def add_export(commands) -> None:
    """Add the command."""
    parser = _arguments.command(
        commands, "export", run_export, "a saved law for use elsewhere", _ABOUT_EXPORT
    )
    parser.add_argument("model", metavar="MODEL.json", help="a law saved by hystjax")
    _arguments.add_recording(
        parser, output_required=False, input_required=False, file_required=False
    )
    option = parser.add_argument
    _arguments.add_rows(parser)
    option("--to", choices=_FORMATS, required=True, help="what to make")
    option(
        "--name",
        default="law",
        help="of what is made, with which names in C begin (default: law)",
    )
    option("--out", metavar="FILE", help="(default: its name and the usual ending)")


def run_export(options) -> int:
    """Write the file."""
    write, ending = _FORMATS[options.to]
    usual = f"{options.name}{ending}"
    out = Path(usual if options.out is None else options.out)
    _arguments.check_out(out, options.model, options.file)
    model = load(options.model)
    write(out, model, name=options.name, record=_record(options))
    print(model)
    print(f"wrote {out}")
    return 0


_OF_FILE = ("time", "period", "time_unit", "input", "output", "units", "rows")


def _record(options):
    if options.file is None:
        given = [name for name in _OF_FILE if getattr(options, name) is not None]
        if given:
            raise InputError(
                f"--{given[0].replace('_', '-')} is of a recording, and no FILE is "
                "given; name it, or leave that out."
            )
        return None
    if options.to in _EQUATIONS:
        raise InputError(
            f"--to {options.to} writes the equation alone, which has no place for a "
            f"recording; leave {options.file} out."
        )
    if options.input is None or options.output is None:
        raise InputError(
            f"{options.file} is taken for the recording that the law is from, of which "
            "--input and --output have to say the columns; a file to write is named by "
            "--out."
        )
    return _arguments.chosen_rows(options, _arguments.recording(options))
