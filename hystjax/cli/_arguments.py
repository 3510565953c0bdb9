"""Arguments that several commands share, and what those that find laws do."""

import argparse
import csv
import io
import os
import re
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import ArrayLike

from .._core import files
from .._core.checks import ComputationError, InputError, warn
from .._core.compiling import changed, run_once, side_by_side
from .._core.show import plain_table
from ..library import VARIABLES, Library, Polynomial
from ..models import AbstractLaw, AbstractModel
from ..recording import Recording, doubts
from ..signals import BandLimited, Cubic, Linear
from ..simulation import Judgement, judge

_INTERPOLATIONS = {"linear": Linear, "cubic": Cubic, "band-limited": BandLimited}

# What verbs say to those who call them, and what that is on the command line.
_OPTIONS = {
    r"`discover` says": "`hystjax discover` says",
    r"`guard=False` admits": "--any-reach admits",
    r"`fading=False` admits": "--any-memory admits",
    r"`signs=None` admits": "leaving out --sign admits",
    r"`largest=(\d+)`": r"--largest \1",
    r"`seconds=([\d.e+-]+)`": r"--seconds \1",
    r"`SavitzkyGolay\(window=(\d+)\)`": r"--smooth \1",
    r"a smaller `window`": "a smaller --smooth",
    r"`window` must be odd and larger than `order`.*window=(-?\d+), order=(\d+)": (
        r"--smooth must be odd and larger than \2, got \1"
    ),
    r"`time_unit='(\w+)'`": r"--time-unit \1",
    r"`count` must be at least 1": "--average must be at least 1",
    r"`(?:recording\.)?averaged\((-?\d+)\)`": r"--average \1",
    r"`time='([^']+)'`": r"--time '\1'",
    r"where `seconds` ended": "where --seconds ended",
    r"`threshold=`": "--threshold",
    r"a larger `threshold`": "a larger --threshold",
    r"give that pace instead: `t = period \* numpy\.arange\(n\)`": (
        "give --period in place of --time"
    ),
    r"give its period, about ([\d.e+-]+) s": r"give --period, about \1 s",
    r"give the period of these in their place, or no time at all": (
        "give --period in place of --time, or neither"
    ),
    r"take windows without them(, or give them no weight)?": "take --rows without them",
    r"Give these samples no weight": "Take --rows without them",
    r"`begin` is \"zero\"": "--begin is zero",
    r"let cycles `begin` at a \"tip\"": "leave out --begin",
    r"\(`hystjax\.loops\.centred`\)": "(--centre)",
    r'`summary\(\.\.\., begin="zero"\)`': "--begin zero",
    r"`period=(-?\d+)` must be 3 samples": r"--cycle \1 must be 3 samples",
    r"`(families|variables|w0|u0|speed|substeps|degree|threshold|ridge|largest|width|"
    r"smoothing|name|known)` (?=must|names|becomes|is|says|holds)": r"--\1 ",
    r"`signs`": "--sign",
    r"`to_(c|text)`": r"--to \1",
    r"`limits` (.*) without `u0`": r"--limits \1 without --u0",
    r"make a recording of each, the first of them up to row (\d+), and give a list": (
        r"put each into a file of its own, the first of them up to row \1"
    ),
    r"Check `period`, and leave out rows (.*) with `window`": (
        r"Check --cycle, and leave out rows \1 by --rows"
    ),
    r"Read the columns as arrays, with NaN": (
        "From Python, read the columns as arrays, with NaN"
    ),
    r" or fill them \(`numpy\.interp`\),": " or fill them,",
    r"choose a window": "choose --rows",
    r"no term of `library` is left with `rate_independent=\w+, odd=\w+`: give "
    r"candidates that are, such as `library\.Duhem\(\)`": (
        "no candidate is left with --rate-independent or --odd: give others by "
        "--variables and --degree"
    ),
    r"make it with its right `units`": "give its right --units",
    r"`interpolation\.BandLimited`": "--interpolation band-limited",
    r"`interpolation\.Cubic\(\)`": "--interpolation cubic",
    r"neither `time` nor `period`": "neither --time nor --period",
    r"such as (\w+)=\('([^']+)', (\d+)\)": r"such as --\1 \2:\3",
    r"give either `time`, a column, or `period`(.*) got time=(.*) and period=": (
        r"give either --time, a column, or --period\1 got --time \2 and --period "
    ),
    r"Read a MATLAB file with `Recording\.from_mat`": (
        "Give the name of a MATLAB file the ending .mat"
    ),
    # Files are read whole: what comes before --rows is what a device remembers there.
    r", or leave it out with `rows`": "",
    r"make the recording with `interpolation=[\w.]+Cubic\(\)`, or `BandLimited\(\)`": (
        "give --interpolation cubic, or band-limited"
    ),
    # What the command line has no option for.
    r"Or `TotalVariation` did not converge: [^.]*\. ": "",
    r"`STLSQ` drops terms below its `threshold`: (.*?)\. `NonNegative` .* others": (
        r"Terms below --threshold are dropped: \1"
    ),
    r"Dropouts of an output can stay: (`hystjax\.bridged`)": (
        r"From Python, dropouts of an output can stay: \1"
    ),
    r"try terms of `library\.\w+\(\w+\)`, or the famil(.+?) of `compare`": (
        r"try the famil\1 of `hystjax compare`"
    ),
    r"`rainflow` counts": "from Python, `hystjax.loops.rainflow` counts",
    r"Try (`method=[\w.]+\(\)`), whose solver `Kvaerno5` is made for that, or a larger "
    r"`rtol`": r"From Python, `hystjax.simulate` takes \1, which is made for that",
    r"or with (`shooting=[\w.]+\(\)`); fix parameters that the data do not tell "
    r"\(`fixed`\); or allow more `max_steps`": (
        r"or refine from Python, with \1, with parameters `fixed` that the data do not "
        "tell, or with more `max_steps`"
    ),
    r"give more `substeps`, or judge the law by (`[\w.]+\(\)`)": (
        r"from Python, give more `substeps`, or judge the law by \1"
    ),
}


def as_options(text: str) -> str:
    """What a verb says, in words of the command line."""
    for said, option in _OPTIONS.items():
        text = re.sub(said, option, text)
    return text


def command(commands, name: str, run, summary: str, details: str = ""):
    """A subparser that runs `run(options)`; `details` end its help."""
    parser = commands.add_parser(
        name,
        help=summary,
        description=summary[0].upper() + summary[1:] + ".",
        epilog=details,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.set_defaults(run=run, parser=parser)
    return parser


def add_recording(
    parser, *, output_required: bool, input_required=True, file_required=True
) -> None:
    """Arguments that say where a recording is, and what it is between samples, but
    where its input is not what something is driven by."""
    parser.add_argument(
        "file",
        nargs=None if file_required else "?",
        metavar="FILE",
        help="CSV, TSV or blank separated text, with or without header; .gz, .bz2 or "
        ".xz of it, .npy, .npz, .parquet, .json, .xlsx or .mat",
    )
    column = "column, by header name or by number from 0 (.mat: VARIABLE or VARIABLE:N)"
    parser.add_argument("--time", metavar="T", help=f"time: {column}")
    parser.add_argument(
        "--period", metavar="S", type=positive, help="sampling period, without --time"
    )
    parser.add_argument(
        "--time-unit",
        metavar="UNIT",
        help="of times and period: s, ms, us, ns, min, h or d (default: as the file "
        "says, or s)",
    )
    parser.add_argument(
        "--input", metavar="U", required=input_required, help=f"input: {column}"
    )
    parser.add_argument(
        "--output", metavar="W", required=output_required, help=f"output: {column}"
    )
    parser.add_argument(
        "--units",
        metavar="U,W",
        help="units of input and output, V,µm (default: those in the file)",
    )
    if not input_required:
        parser.set_defaults(interpolation="linear")
        return
    parser.add_argument(
        "--interpolation",
        choices=_INTERPOLATIONS,
        default="linear",
        help="the input between samples (default: linear)",
    )


def recording(options) -> Recording:
    """The recording that the arguments name, all rows of it; without a clock where they
    tell none."""
    units = tuple(unit.strip() for unit in (options.units or ",").split(","))
    if len(units) != 2:
        raise InputError(
            f"--units must be two units with a comma between, got {options.units!r}."
        )
    chosen: dict[str, Any] = {
        "input": options.output if options.input is None else options.input,
        "output": options.input if options.output is None else options.output,
        "time": options.time,
        "period": options.period,
    }
    fields: dict[str, Any] = {
        "interpolation": _INTERPOLATIONS[options.interpolation or "linear"](),
        "time_unit": options.time_unit,
    }
    if options.units is not None:
        fields["units"] = units
    if Path(options.file).suffix.lower() == ".mat":
        chosen = {key: _variable(value) for key, value in chosen.items()}
        read = Recording.from_mat(options.file, **chosen, **fields)
    else:
        read = Recording.from_csv(options.file, **chosen, **fields)
    for doubt in doubts(read):
        if options.time is not None or not doubt.startswith("times"):
            warn(doubt)
    if options.units is not None:
        return read
    # A column in the place of another one does not have the unit of that.
    given = options.input, options.output
    known = zip(given, read.units, strict=True)
    units = tuple("" if column is None else unit for column, unit in known)
    return changed(read, units=units)


def check_out(out, *read) -> None:
    """That a result does not take the place of a file that is read; `None` is none.

    **Raises:** `InputError` if it would.
    """
    for file in filter(None, read):
        # What cannot be looked at, reading or writing it tells.
        there = os.path.exists(out) and os.path.exists(file)
        if there and os.path.samefile(out, file):
            raise InputError(
                f"{out}, to be written by --out, is the file {file} that is read; "
                "name another place, and it stays as it is."
            )


def check_apart(fitted: tuple[int, int], unseen: tuple[int, int]) -> None:
    """That no row is fitted and judged.

    **Raises:** `InputError` if one is.
    """
    if max(fitted[0], unseen[0]) < min(fitted[1], unseen[1]):
        raise InputError(
            "--test {}:{} shares rows with the fitted ones, {}:{}; errors on rows that "
            "the law was fitted on flatter it.".format(*unseen, *fitted)
        )


def csv_text(columns: Mapping[str, ArrayLike]) -> str:
    """A table with a line of names, whose numbers are read back as they are."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(columns)
    each = (np.asarray(column).tolist() for column in columns.values())
    writer.writerows(zip(*each, strict=True))
    return out.getvalue()


def rows(text: str) -> tuple[int, int]:
    """Parse `A:B`, rows A to B (not included) counted from 0."""
    match = re.fullmatch(r"(\d{1,18}):(\d{1,18})", text)
    if match is None:
        raise argparse.ArgumentTypeError(
            f"{text!r} is not a range of rows such as 0:5000"
        )
    return int(match[1]), int(match[2])


def check_rows(name: str, chosen: tuple[int, int] | None, record: Recording) -> None:
    """Raise `InputError` unless rows, if any were chosen, are in a recording."""
    if chosen is not None and not chosen[0] < chosen[1] <= len(record):
        raise InputError(
            f"{name} {chosen[0]}:{chosen[1]} is not in the file: its rows run from 0 "
            f"to {len(record)}, and the first must be less than the last."
        )


def add_rows(parser) -> None:
    """The argument that says which rows of a recording, for `chosen_rows`."""
    parser.add_argument("--rows", metavar="A:B", type=rows, help="rows (default: all)")


def add_average(parser) -> None:
    """The argument that says of how many rows means are taken."""
    parser.add_argument(
        "--average",
        metavar="N",
        type=int,
        default=1,
        help="take means of N rows in turn, where there are many more than loops need",
    )


def chosen_rows(options, record: Recording) -> Recording:
    """Those of a recording, or all.

    **Raises:** `InputError` for rows that it does not have.
    """
    check_rows("--rows", options.rows, record)
    return record.window(*options.rows) if options.rows else record


def seed(text: str) -> int:
    """Parse a seed, a whole number of at most 63 bits."""
    if not re.fullmatch(r"[0-9]{1,18}", text):
        raise argparse.ArgumentTypeError(
            f"{text!r} is not a whole number from 0 with at most 18 digits"
        )
    return int(text)


def number(text: str) -> float:
    """Parse a number; what Python takes for one too is none in a file: 1_0."""
    if "_" in text:
        raise argparse.ArgumentTypeError(f"invalid float value: {text!r}")
    try:
        return float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"invalid float value: {text!r}") from None


def positive(text: str) -> float:
    """Parse a positive number."""
    try:
        found = number(text)
    except argparse.ArgumentTypeError:
        found = -1.0
    if not sys.float_info.min <= found < float("inf"):
        raise argparse.ArgumentTypeError(f"{text!r} is not a positive number")
    return found


def _variable(value):
    if not isinstance(value, str) or ":" not in value:
        return value
    name, _, number = value.rpartition(":")
    return (name, int(number)) if re.fullmatch(r"\d{1,9}", number) else value


ROWS = """\
The law is fitted on some rows and judged by free run on others. Rows are counted from
0, without a header line, the last one not included. Without --rows the first 70 % are
fitted; without --test the rows after the fitted ones (or before, if none are left) are
unseen.
"""


class Split(NamedTuple):
    """A recording, the rows of it that are fitted, and unseen ones if any are left;
    these, or their means; and what they are, in words."""

    record: Recording
    fitted_rows: tuple[int, int]
    unseen_rows: tuple[int, int] | None
    fitted: Recording
    unseen: Recording | None
    settings: dict[str, str]

    def judged(self, law: AbstractLaw) -> dict[str, Judgement]:
        """A law's free runs along both, whose programs are compiled at a time."""
        rows = {"fitted": self.fitted}
        if self.unseen is not None:
            rows["unseen"] = self.unseen
        with run_once(sum(map(len, rows.values()))):
            done = dict(side_by_side(lambda name: judge(law, rows[name]), tuple(rows)))
        return {name: done[name] for name in rows}


def add_out(
    parser, default: str, what: str = "report folder", metavar: str = "DIR"
) -> None:
    """The argument that says where what is made goes."""
    about = f"{what} (default: {default})"
    parser.add_argument("--out", metavar=metavar, default=default, help=about)


def add(parser, default: str = "all") -> None:
    """Arguments that say what is fitted by which terms, those of the `default`
    variables, and where the report goes."""
    add_recording(parser, output_required=True)
    add = parser.add_argument
    add("--rows", metavar="A:B", type=rows, help="rows to fit")
    add_average(parser)
    add("--test", metavar="A:B", type=rows, help="unseen rows to judge on")
    add("--degree", type=int, default=2, help="of the polynomial library (default: 2)")
    add(
        "--variables",
        metavar="NAMES",
        help=f"any of {','.join(VARIABLES)} (default: {default})",
    )
    add_out(parser, "hystjax-report")


def split(options, variables: Sequence[str] = VARIABLES) -> tuple[Split, Library]:
    """Read the file and divide its rows; and the candidate terms, of some variables
    where the arguments name none."""
    given = options.variables
    named = variables if given is None else [x.strip() for x in given.split(",")]
    library = Polynomial(options.degree, named)
    record = recording(options)
    files.check_folder(options.out)
    for name, chosen in (("--rows", options.rows), ("--test", options.test)):
        check_rows(name, chosen, record)
    fitted, unseen = _chosen_rows(options, len(record))
    every = f", means of {options.average}" if options.average != 1 else ""
    settings = {
        "file": options.file,
        "fitted rows": "{}:{}".format(*fitted) + every,
        "unseen rows": "{}:{}".format(*unseen) + every if unseen else "none left",
        "library": f"polynomial of degree {options.degree} in {','.join(named)}",
        "input between samples": options.interpolation,
    }
    seen = record.window(*fitted).averaged(options.average)
    kept = record.window(*unseen).averaged(options.average) if unseen else None
    return Split(record, fitted, unseen, seen, kept, settings), library


def conclude(
    options,
    law: AbstractModel,
    judgements: Mapping[str, Judgement],
    settings: Mapping[str, str],
    advice: str,
    told: str,
    **more,
) -> int:
    """Write the report of a law, and print it with what is `told` of it and its errors;
    `advice` for one that diverges."""
    from .. import report  # and with it Matplotlib

    path = report.write(options.out, law, judgements, settings=settings, **more)
    print(law)
    print(told)
    print(plain_table(report.error_table(judgements)))
    print(f"report: {path}")
    require_finite(judgements, advice)
    return 0


def _chosen_rows(options, n: int):
    fitted = options.rows or (0, round(0.7 * n))
    if options.test:
        check_apart(fitted, options.test)
        return fitted, options.test
    after, before = (fitted[1], n), (0, fitted[0])
    for unseen in (after, before):
        if unseen[1] - unseen[0] >= 3 * options.average:
            return fitted, unseen
    return fitted, None


def require_finite(judgements, advice: str) -> None:
    lost = [name for name, j in judgements.items() if not bool(j.succeeded)]
    if lost:
        raise ComputationError(
            f"the law diverges on the {' and '.join(lost)} rows; the report says "
            f"where. {advice}"
        )
