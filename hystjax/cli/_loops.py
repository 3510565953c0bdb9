"""`hystjax loops` and `hystjax forc`: what engineers read off loops and reversal
curves."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from .. import loops
from .._core import files
from .._core.checks import InputError
from .._core.compiling import changed
from .._core.show import (
    escaped,
    markdown_page,
    markdown_table,
    plain_table,
    quantity,
    with_unit,
)
from ..loops._corrections import drift_rate, tells_drift
from ..models import load, save
from ..simulation import simulate
from . import _arguments

_MOST = 40  # cycles in a table that people read
_TOLD = 3.0  # standard errors, from which on a drift is one
_SEEN = 0.01  # share of an energy, that a drift changes

_LOOPS = """\
The report folder gets report.md with a table, loops.csv with all numbers of all cycles
and their standard errors, and the figures loop.png, energy.png and, where the input
comes from zero, backbone.png.
Without --time and --period the record is quasi-static: it has no clock. The energy is
∮ w du of the output w over the input u: of B over H it is the loss with a minus sign.

examples:
  hystjax loops steel.csv --input H --output B --units A/m,T
  hystjax loops test.csv --time t --input stroke --output force --units mm,kN \\
      --begin zero --model report/law.json
"""

_FORC = """\
Files of MicroMag 2900/3900, Lake Shore 8600 tables, and columns of field and moment.
The report folder gets report.md, forc.csv (Hc, Hu, density, its standard error) and
forc.png, and with --preisach the model preisach.json, of whose curves every tenth is
left out to judge it.

example:
  hystjax forc MD00-2361 --out forc
"""


def add(commands) -> None:
    """Add both commands."""
    parser = _arguments.command(
        commands, "loops", run, "numbers of loops, cycle by cycle", _LOOPS
    )
    _arguments.add_recording(parser, output_required=True)
    parser.set_defaults(interpolation=None)
    option = parser.add_argument
    _arguments.add_rows(parser)
    option(
        "--threshold",
        type=_arguments.number,
        help="least swing of the input that counts (default: from its noise)",
    )
    option(
        "--begin",
        choices=("tip", "zero"),
        default="tip",
        help="where cycles do: at a tip, or where the input passes zero",
    )
    option(
        "--centre",
        action="store_true",
        help="half way between upper and lower tips take input and output for zero",
    )
    option(
        "--without-drift",
        action="store_true",
        help="take out what the output drifts by from cycle to cycle, evenly in time",
    )
    option("--model", metavar="LAW.json", help="a saved law, to be read beside it")
    _arguments.add_out(parser, "hystjax-loops")
    parser = _arguments.command(
        commands, "forc", run_forc, "diagram of first-order reversal curves", _FORC
    )
    option = parser.add_argument
    option("file", metavar="FILE", help="a file of reversal curves")
    option(
        "--smoothing",
        type=_arguments.number,
        help="half width of the window in steps (default: by points left out)",
    )
    option("--varying", action="store_true", help="smoothing that grows outwards")
    option("--no-drift", action="store_true", help="leave drift as it is")
    option("--preisach", action="store_true", help="make a Preisach model too")
    _arguments.add_out(parser, "hystjax-forc")


def run(options) -> int:
    """Read a record, print its numbers, and write the report."""
    if options.interpolation is not None and options.model is None:
        raise InputError(
            "--interpolation is of the input that a --model is run along; loops are "
            "read off samples. Leave it out."
        )
    _arguments.check_out(Path(options.out, "loops.csv"), options.file)
    record = _arguments.recording(options)
    record = _arguments.chosen_rows(options, record)
    run = None if options.model is None else simulate(load(options.model), record)
    record, run = _put_right(options, record, run)
    found = loops.reversals(record, threshold=options.threshold, begin=options.begin)
    numbers = loops.summary(record, found=found)
    law = [] if run is None else [_beside(record, found, run)]
    figures = _figures(record, numbers)
    cells = loops.table(numbers)
    shown = _first_and_last(cells)
    notes = _notes(numbers, found, record, options.without_drift)
    sections = [
        f"# Loops of {escaped(Path(options.file).name)}\n\n{found}; "
        f"{len(found.cycles)} cycles.",
        *notes,
        "Values ± standard errors of white noise; all numbers are in `loops.csv`.\n\n"
        + markdown_table(shown),
        *(f"## The law beside it\n\n{markdown_table(each)}" for each in law),
        *(f"![{name}]({name}.png)" for name in figures),
    ]
    place = files.made_folder(options.out)
    _save_figures(place, figures)
    first, _ = options.rows or (0, None)
    files.write_text(place / "loops.csv", _csv(numbers, first))
    files.write_text(place / "report.md", markdown_page(sections))
    print(found, *notes, sep="\n")
    print(plain_table(shown))
    if shown != cells:
        print(f"{len(cells) - 1 - _MOST} more cycles are in {place / 'loops.csv'}")
    print(f"report: {place / 'report.md'}")
    return 0


def _notes(numbers, found, record, mended: bool) -> list[str]:
    """Sentences on what the numbers do not tell: why some are not there; and that an
    output which drifts adds to ∮ w du as much as it moves by, times what the input is
    from its mean where a cycle begins, nothing at zero."""
    notes = []
    if np.all(np.isnan(numbers["remanence"])):
        notes.append(
            "The input does not pass zero well inside of its loops: remanence, "
            "coercivity and a backbone count from there, and --centre takes the middle "
            "for it."
        )
    first, between, *_, last = found.cycles.T
    # From one amplitude to the next an output moves without any drift.
    again = tells_drift(np.asarray(record.u), first, between, last)
    if mended or found.from_zero or not again.any():
        return notes
    error, energy, amplitude = (
        np.asarray(numbers[name])[again]
        for name in ("drift_error", "energy", "amplitude")
    )
    energy, amplitude = np.mean(np.abs(energy)), np.mean(amplitude)
    # Cycles in a row share tips: all that they drift by is what their last tip is from
    # the first one, each of which has half of the variance of a drift.
    begins = np.append(True, first[again][1:] != last[again][:-1])
    outer = error[begins], error[np.append(begins[1:], True)]
    unsure = np.linalg.norm(outer) / 2**0.5 / len(error)
    # Both kinds of tips tell: where the amplitude falls, one alone moves without any.
    long = np.mean(np.subtract(*np.asarray(record.t)[[last[again], first[again]]]))
    mean = drift_rate(record, found) * long
    share = abs(mean) * amplitude / (energy or np.inf)
    if abs(mean) <= _TOLD * unsure or share <= _SEEN:
        return notes
    by = quantity(float(mean), numbers["drift"].attrs["units"], 3)
    return [
        *notes,
        f"Loops do not close: the output moves by {by} a cycle on average. If that is "
        f"the instrument's, energies are off by about {100 * share:.2g} %, and "
        "--without-drift takes it out.",
    ]


def _first_and_last(table: list[list[str]]) -> list[list[str]]:
    """A table that has many rows with dots for those between."""
    head, *rows = table
    if len(rows) <= _MOST:
        return table
    dots = ["..."] * len(head)
    return [head, *rows[: _MOST // 2], dots, *rows[-_MOST // 2 :]]


def _figures(record, numbers):
    """All by name, that of a backbone where the input comes from zero."""
    from .. import plot  # and with it Matplotlib

    figures = {"loop": plot.cycles(record, numbers), "energy": plot.energy(numbers)}
    try:
        outer = loops.backbone(record)
    except InputError:  # the input comes from zero to no side
        return figures
    return figures | {"backbone": _backbone(record, outer)}


def _save_figures(place: Path, figures) -> None:
    """Write them; a backbone of an earlier report does not stay beside them."""
    from .. import plot  # and with it Matplotlib

    for name, figure in figures.items():
        plot.save(figure, place / f"{name}.png")
    if "backbone" not in figures and (place / "report.md").is_file():
        (place / "backbone.png").unlink(missing_ok=True)


def _backbone(record, outer):
    """Backbone and, where there is one on a side, its equal-energy curve."""
    from .. import plot  # and with it Matplotlib

    fits = {}
    for label, u, w in (
        ("EEEP", outer.u, outer.w),
        ("EEEP, negative side", outer.u_negative, outer.w_negative),
    ):
        try:
            fits[label] = loops.eeep(u, w)
        except InputError:  # outputs that fall with the input have none
            continue
    return plot.backbone(record, outer, fits)


def _put_right(options, record, run):
    """A record without its drift and with its zero in the middle, where that is asked
    for, by the turns that count; and the run of a law, if there is one, without a drift
    of its own and by the same zero."""
    if not (options.without_drift or options.centre):
        return record, run
    tips = loops.reversals(record, threshold=options.threshold)
    if options.without_drift:
        if run is not None:
            own = changed(record, w=run.w)
            run = replace(run, w=loops.without_drift(own, found=tips).w)
        record = loops.without_drift(record, found=tips)
    return _centred(record, run, tips) if options.centre else (record, run)


def _centred(record, run, tips):
    """A record with its zero in the middle, and the run of a law by the same zero."""
    moved = loops.centred(record, found=tips)
    if run is not None:
        run = replace(run, u=moved.u, w=run.w - (record.w - moved.w))
    return moved, run


def _beside(record, found, run):
    """The numbers of the record and of the law's run."""
    return loops.table(loops.side_by_side(record, {"law": run}, found=found))


def _csv(numbers, first: int) -> str:
    """A row for each cycle, with rows of the file, of which `first` is the first that
    was chosen; numbers at levels have a column for each."""
    columns = {"cycle": numbers["cycle"].values}
    for name in ("start", "turn", "back", "stop"):
        if name in numbers.coords:
            columns[name] = first + numbers[name].values
    for name in map(str, numbers.data_vars):
        unit, values = numbers[name].attrs["units"], numbers[name].values
        if values.ndim == 1:
            columns[_headed(name, unit)] = values
            continue
        for level, column in zip(numbers["level"].values, values.T, strict=True):
            columns[_headed(f"{name} at {level:g}", unit)] = column
    return _arguments.csv_text(columns)


def _headed(name: str, unit: str) -> str:
    """The head of a column, as files are read back."""
    return f"{name} [{unit}]" if unit else name


def run_forc(options) -> int:
    """Read the curves, draw their diagram, and write the report."""
    from .. import plot  # and with it Matplotlib

    if options.varying and options.smoothing is not None:
        raise InputError("give --smoothing or --varying, not both.")
    for written in ("forc.csv", "preisach.json"):
        _arguments.check_out(Path(options.out, written), options.file)
    curves = loops.read_forc(options.file, drift=not options.no_drift)
    smoothing = loops.Varying() if options.varying else options.smoothing
    found = loops.forc(curves, smoothing=smoothing)
    place = files.made_folder(options.out)
    plot.save(plot.forc(found), place / "forc.png")
    across, along = np.meshgrid(found.hc, found.hu)
    (field, moment), density = found.units, found.density_unit
    columns = {
        _headed("Hc", field): across.ravel(),
        _headed("Hu", field): along.ravel(),
        _headed("density", density): found.density.ravel(),
        _headed("standard error", density): found.error.ravel(),
    }
    files.write_text(place / "forc.csv", _arguments.csv_text(columns))
    lines = [
        f"{len(curves)} curves of {len(curves.field)} points",
        str(found),
        f"noise {quantity(found.noise, moment, 3)} about the surface",
    ]
    if options.preisach:
        lines.append(_preisach(curves, place))
    elif (place / "preisach.json").exists():
        lines.append("preisach.json beside this is of something else: see --preisach")
    table = [["smoothing", with_unit("error at points left out", moment)]]
    table += [[f"{s:g}", f"{e:.5g}"] for s, e in found.compared.items()]
    sections = [
        f"# Reversal curves of {escaped(Path(options.file).name)}",
        "\n".join(f"- {line}" for line in lines),
        "Hc = (Hb - Ha) / 2 and Hu = (Ha + Hb) / 2 of the reversal field Ha and the "
        "field Hb; the density is -1/2 ∂²M / ∂Ha ∂Hb.",
        markdown_table(table) if found.compared else "",
        "![forc](forc.png)",
    ]
    files.write_text(place / "report.md", markdown_page(sections))
    print(*lines, f"report: {place / 'report.md'}", sep="\n")
    return 0


def _preisach(curves, place: Path) -> str:
    """Save the model of all curves; say how one of nine in ten does on the tenth."""
    save(place / "preisach.json", loops.preisach(curves))
    error = loops.left_out(curves)
    return f"Preisach model: NRMSE {100 * error:.3g} % on every tenth curve left out"
