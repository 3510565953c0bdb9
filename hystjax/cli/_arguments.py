"""Arguments that several commands share."""

import argparse
import re
from pathlib import Path
from typing import Any

from .._core.errors import InputError
from ..recording import Recording
from ..signals import BandLimited, Cubic, Linear

_INTERPOLATIONS = {"linear": Linear, "cubic": Cubic, "band-limited": BandLimited}


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
    """Arguments that say where a recording is."""
    parser.add_argument(
        "file",
        nargs=None if file_required else "?",
        metavar="FILE",
        help="CSV, TSV or blank separated text, with or without header; .gz of it, "
        ".npy, .npz, .parquet, .xlsx or .mat",
    )
    column = "column, by header name or by number from 0 (.mat: VARIABLE or VARIABLE:N)"
    parser.add_argument("--time", metavar="T", help=f"time: {column}")
    parser.add_argument(
        "--period", metavar="S", type=float, help="sampling period, without --time"
    )
    parser.add_argument(
        "--time-unit",
        metavar="UNIT",
        help="of times and period: s, ms, us, ns, min or h (default: as the file says, "
        "or s)",
    )
    parser.add_argument(
        "--input", metavar="U", required=input_required, help=f"input: {column}"
    )
    parser.add_argument(
        "--output", metavar="W", required=output_required, help=f"output: {column}"
    )
    parser.add_argument(
        "--units", metavar="U,W", help="units of input and output: V,µm"
    )
    parser.add_argument(
        "--interpolation",
        choices=_INTERPOLATIONS,
        default="linear",
        help="the input between samples (default: linear)",
    )


def recording(options) -> Recording:
    """The recording that the arguments name, all rows of it; without a clock where they
    tell none."""
    units = tuple((options.units or ",").split(","))
    if len(units) != 2:
        raise InputError(
            f"--units must be two units with a comma between, got {options.units!r}."
        )
    chosen: dict[str, Any] = {
        "input": options.input or options.output,
        "output": options.output or options.input,
        "time": options.time,
        "period": options.period,
    }
    fields: dict[str, Any] = {
        "interpolation": _INTERPOLATIONS[options.interpolation](),
        "time_unit": options.time_unit,
    }
    if options.units is not None:
        fields["units"] = units
    if Path(options.file).suffix.lower() == ".mat":
        chosen = {key: _variable(value) for key, value in chosen.items()}
        return Recording.from_mat(options.file, **chosen, **fields)
    return Recording.from_csv(options.file, **chosen, **fields)


def check_out(out, *read) -> None:
    """That a result does not take the place of a file that is read; `None` is none.

    **Raises:** `InputError` if it would.
    """
    for file in filter(None, read):
        if Path(out).exists() and Path(file).exists() and Path(out).samefile(file):
            raise InputError(
                f"--out, {out}, is the file {file} that is read; name another one, and "
                "it stays as it is."
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


def rows(text: str) -> tuple[int, int]:
    """Parse `A:B`, rows A to B (not included) counted from 0."""
    match = re.fullmatch(r"(\d+):(\d+)", text)
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


def positive(text: str) -> float:
    """Parse a positive number."""
    try:
        number = float(text)
    except ValueError:
        number = -1.0
    if not number > 0:
        raise argparse.ArgumentTypeError(f"{text!r} is not a positive number")
    return number


def _variable(value):
    if not isinstance(value, str) or ":" not in value:
        return value
    name, _, number = value.rpartition(":")
    return (name, int(number)) if number.isdecimal() else value
