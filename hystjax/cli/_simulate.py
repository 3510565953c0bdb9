"""`hystjax simulate`: run a saved law along the input of a file."""

import numpy as np

from .. import report
from .._core import files
from .._core.checks import InputError
from .._core.show import with_unit
from .._core.solution import raise_unless_successful
from ..models import load
from ..simulation import judge, simulate
from ..simulation._simulate import warn_beyond, where_lost
from . import _arguments

_DETAILS = """\
With --output the free run starts from the measured output's first row and is judged
against it; without, --w0 says where it starts. The result is a CSV file with the
columns t, u and w, and recorded with --output. A warning says where the input goes
farther or faster than those that the law was fitted on.

example:
  hystjax simulate report/law.json piezo.csv --time 1 --input 3 --output 2 \\
      --rows 17500:35000 --out simulated.csv
"""


def add(commands) -> None:
    """Add the command."""
    parser = _arguments.command(
        commands, "simulate", run, "run a saved law along an input", _DETAILS
    )
    parser.add_argument("model", metavar="MODEL.json", help="a law saved by hystjax")
    _arguments.add_recording(parser, output_required=False)
    _arguments.add_rows(parser)
    parser.add_argument("--w0", type=float, help="output at the first row")
    parser.add_argument(
        "--out", metavar="CSV", default="simulated.csv", help="file for the result"
    )


def run(options) -> int:
    """Simulate, judge where there is a measured output, and write the table."""
    if options.output is None and options.w0 is None:
        raise InputError(
            "a free run needs a start: give --w0, or --output with the measured output."
        )
    _arguments.check_out(options.out, options.model, options.file)
    model = load(options.model)
    record = _arguments.recording(options)
    record = _arguments.chosen_rows(options, record)
    if options.output:
        judgement = judge(model, record, w0=options.w0)
        trajectory = raise_unless_successful(judgement.trajectory, where_lost)
        warn_beyond(model, trajectory)
        table = report.plain_table(report.error_table({"simulated": judgement}))
    else:
        trajectory, table = simulate(model, record, w0=options.w0), ""
    recorded = record.w if options.output else None
    files.write_text(options.out, _csv(trajectory, recorded))
    print(model)
    for symbol, name, unit in zip("uw", model.names, model.units, strict=True):
        print(f"{symbol}: {with_unit(name, unit)}")
    if table:
        print(table)
    print(f"wrote {options.out}")
    return 0


def _csv(trajectory, recorded) -> str:
    columns = {"t": trajectory.t, "u": trajectory.u, "w": trajectory.w}
    if recorded is not None:
        columns["recorded"] = recorded
    rows = zip(*(np.asarray(x).tolist() for x in columns.values()), strict=True)
    lines = (",".join(map(repr, row)) for row in rows)
    return "\n".join([",".join(columns), *lines]) + "\n"
