"""What the commands that find laws share: rows to fit, unseen ones, and the report."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from .. import report
from .._core.errors import ComputationError
from ..library import VARIABLES, Library, Polynomial
from ..models import AbstractLaw, AbstractModel
from ..recording import Recording
from ..simulation import Judgement, judge
from . import _arguments

ROWS = """\
The law is fitted on some rows and judged by free run on others. Rows are counted from
0, without a header line, the last one not included. Without --rows the first 70 % are
fitted; without --test the rows after the fitted ones (or before, if none are left) are
unseen.
"""


class Split(NamedTuple):
    """A recording, the rows of it that are fitted, and unseen ones if any are left; and
    what they are, in words."""

    record: Recording
    fitted_rows: tuple[int, int]
    unseen_rows: tuple[int, int] | None
    settings: dict[str, str]

    @property
    def fitted(self) -> Recording:
        """The recording that is fitted."""
        return self.record.window(*self.fitted_rows)

    def judged(self, law: AbstractLaw) -> dict[str, Judgement]:
        """A law's free runs along both."""
        judgements = {"fitted": judge(law, self.fitted)}
        if self.unseen_rows is not None:
            judgements["unseen"] = judge(law, self.record.window(*self.unseen_rows))
        return judgements


def add(parser, default: str = "all") -> None:
    """Arguments that say what is fitted by which terms, those of the `default`
    variables, and where the report goes."""
    _arguments.add_recording(parser, output_required=True)
    add = parser.add_argument
    add("--rows", metavar="A:B", type=_arguments.rows, help="rows to fit")
    add("--test", metavar="A:B", type=_arguments.rows, help="unseen rows to judge on")
    add("--degree", type=int, default=2, help="of the polynomial library (default: 2)")
    add(
        "--variables",
        metavar="NAMES",
        help=f"any of {','.join(VARIABLES)} (default: {default})",
    )
    add("--out", metavar="DIR", default="hystjax-report", help="report folder")


def split(options, variables: Sequence[str] = VARIABLES) -> tuple[Split, Library]:
    """Read the file and divide its rows; and the candidate terms, of some variables
    where the arguments name none."""
    named = options.variables.split(",") if options.variables else variables
    library = Polynomial(options.degree, named)
    record = _arguments.recording(options)
    for name, chosen in (("--rows", options.rows), ("--test", options.test)):
        _arguments.check_rows(name, chosen, record)
    fitted, unseen = _chosen_rows(options, len(record))
    settings = {
        "file": options.file,
        "fitted rows": "{}:{}".format(*fitted),
        "unseen rows": "{}:{}".format(*unseen) if unseen else "none left",
        "library": f"polynomial of degree {options.degree} in {','.join(named)}",
        "input between samples": options.interpolation,
    }
    return Split(record, fitted, unseen, settings), library


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
    path = report.write(options.out, law, judgements, settings=settings, **more)
    print(law)
    print(told)
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
