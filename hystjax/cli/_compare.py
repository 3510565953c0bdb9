"""`hystjax compare`: every family that suits a file, judged alike."""

from pathlib import Path

from .. import plot, report
from .._core import files
from ..comparison import FAMILIES, compare
from ..models import save
from ..simulation import judge
from . import _arguments

_DETAILS = f"""\
Families: {", ".join(FAMILIES)}.

Each is fitted once without each of some blocks of the rows and judged by free run on
that block, and once to all. Without --time and --period the record is quasi-static: it
has no clock, and only families that do not depend on the rate are tried. The report
folder gets report.md with the table, comparison.png with the loops of the best three,
and the best as law.json, for `hystjax simulate`, `invert` and `export`.

example:
  hystjax compare piezo.csv --time t --input V --output x --units V,µm
"""


def add(commands) -> None:
    """Add the command."""
    parser = _arguments.command(
        commands, "compare", run, "try every family of laws and models", _DETAILS
    )
    _arguments.add_recording(parser, output_required=True)
    option = parser.add_argument
    _arguments.add_rows(parser)
    option(
        "--test", metavar="A:B", type=_arguments.rows, help="unseen rows to judge on"
    )
    option(
        "--families",
        metavar="A,B",
        default=",".join(FAMILIES),
        help="those to try (default: all)",
    )
    option("--out", metavar="DIR", default="hystjax-comparison", help="report folder")


def run(options) -> int:
    """Compare, judge the best, print the table, and write the report."""
    whole = _arguments.recording(options)
    record = _arguments.chosen_rows(options, whole)
    if options.test:
        _arguments.check_rows("--test", options.test, whole)
        _arguments.check_apart(options.rows or (0, len(whole)), options.test)
    families = [name.strip() for name in options.families.split(",")]
    found = compare(record, families=families, progress=True)
    judgements = {"fitted": judge(found.best.model, record)}
    if options.test:
        unseen = whole.window(*options.test)
        judgements["unseen"] = judge(found.best.model, unseen)
    errors = report.error_table(judgements)
    missing = [f"- {name}: {why}" for name, why in found.left_out.items()]
    sections = [
        f"# Families on {Path(options.file).name}",
        "Root mean square errors of free runs, in % of the output's range; on blocks "
        "left out their mean ± its standard error.\n\n"
        + report.markdown_table(found.table())
        + f"\n\nOf these the noise is {found.noise_in_words()}.",
        "![The best three beside the record](comparison.png)",
        f"## {found.best.family}\n\n`{found.best.model}`\n\n{found.best.note}".strip(),
        report.markdown_table(errors),
        "\n".join(["## Not fitted", "", *missing]) if missing else "",
    ]
    place = files.made_folder(options.out)
    plot.save(plot.comparison(found, record), place / "comparison.png")
    save(place / "law.json", found.best.model)
    text = "\n\n".join(section for section in sections if section) + "\n"
    files.write_text(place / "report.md", text)
    print(found)
    print(f"\nbest: {found.best.family}\n{found.best.model}")
    print(report.plain_table(errors))
    print(f"report: {place / 'report.md'}")
    return 0
