"""What the commands that find laws share: rows to fit, unseen ones, and the report."""

from typing import NamedTuple

from .. import report
from .._core.errors import ComputationError
from ..library import VARIABLES, Library, Polynomial
from ..models import AbstractLaw
from ..recording import Recording
from ..simulation import judge
from . import _arguments

ROWS = """\
The law is fitted on some rows and judged by free run on others. Rows are counted from
0, without a header line, the last one not included. Without --rows the first 70 % are
fitted; without --test the rows after the fitted ones (or before, if none are left) are
unseen.
"""


class Split(NamedTuple):
    """The rows that are fitted, and unseen ones if any are left; and what they are."""

    fitted: Recording
    unseen: Recording | None
    settings: dict[str, str]


def add(parser) -> None:
    """Arguments that say what is fitted by which terms, and where the report goes."""
    _arguments.add_recording(parser, output_required=True)
    add = parser.add_argument
    add("--rows", metavar="A:B", type=_arguments.rows, help="rows to fit")
    add("--test", metavar="A:B", type=_arguments.rows, help="unseen rows to judge on")
    add("--degree", type=int, default=2, help="of the polynomial library (default: 2)")
    add(
        "--variables",
        metavar="NAMES",
        default=",".join(VARIABLES),
        help="any of w,u,du,|du|,|w| (default: all)",
    )
    add("--out", metavar="DIR", default="hystjax-report", help="report folder")


def library(options) -> Library:
    """The candidate terms."""
    return Polynomial(options.degree, options.variables.split(","))


def split(options) -> Split:
    """Read the file and divide its rows."""
    record = _arguments.recording(options)
    for name, chosen in (("--rows", options.rows), ("--test", options.test)):
        _arguments.check_rows(name, chosen, record)
    fitted, unseen = _chosen_rows(options, len(record))
    settings = {
        "file": options.file,
        "fitted rows": "{}:{}".format(*fitted),
        "unseen rows": "{}:{}".format(*unseen) if unseen else "none left",
        "library": f"polynomial of degree {options.degree} in {options.variables}",
        "input between samples": options.interpolation,
    }
    window = None if unseen is None else record.window(*unseen)
    return Split(record.window(*fitted), window, settings)


def conclude(
    options, law: AbstractLaw, rows: Split, advice: str, settings, **more
) -> int:
    """Judge a law, write its report and print both; `advice` for one that diverges."""
    judgements = {"fitted": judge(law, rows.fitted)}
    if rows.unseen is not None:
        judgements["unseen"] = judge(law, rows.unseen)
    path = report.write(
        options.out, law, judgements, settings=rows.settings | settings, **more
    )
    print(law)
    print(law.kind)
    print(report.plain_table(report.error_table(judgements)))
    print(f"report: {path}")
    _require_finite(judgements, advice)
    return 0


def _chosen_rows(options, n: int):
    fitted = options.rows or (0, round(0.7 * n))
    if options.test:
        _arguments.check_apart(fitted, options.test)
        return fitted, options.test
    after, before = (fitted[1], n), (0, fitted[0])
    for unseen in (after, before):
        if unseen[1] - unseen[0] >= 3:
            return fitted, unseen
    return fitted, None


def _require_finite(judgements, advice: str) -> None:
    lost = [name for name, j in judgements.items() if not bool(j.succeeded)]
    if lost:
        raise ComputationError(
            f"the law diverges on the {' and '.join(lost)} rows; the report says "
            f"where. {advice}"
        )
