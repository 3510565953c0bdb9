"""`hystjax identify`: from a file to a law and its report."""

from .. import _identify, report
from .._errors import ComputationError, InputError
from .._progress import say
from .._refine import refine
from ..differentiation import FiniteDifference, SavitzkyGolay
from ..library import VARIABLES, Polynomial
from ..regression import STLSQ, aliases
from . import _arguments
from ._free_run import judged

_DETAILS = """\
The law is fitted on some rows and judged by free run on others. Rows are counted from
0, without a header line, the last one not included. Without --rows the first 70 % are
fitted; without --test the rows after the fitted ones (or before, if none are left) are
unseen.

Thresholds apply to the coefficients in physical units, as in the source paper; with
--normalise to the share of the derivative that a term carries, which does not depend
on units. The defaults are the paper's for its measured actuator.

example:
  hystjax identify piezo.csv --time 1 --input 3 --output 2 --units V,µm \\
      --rows 35001:45001 --test 17500:35000 --out report
"""


def add(commands) -> None:
    """Add the command."""
    parser = _arguments.command(
        commands, "identify", run, "find a law in a recording", _DETAILS
    )
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
    add("--threshold", type=float, default=0.01, help="STLSQ threshold (default: 0.01)")
    add("--ridge", type=float, default=0.05, help="STLSQ ridge (default: 0.05)")
    add("--normalise", action="store_true", help="threshold on normalised columns")
    add(
        "--smooth",
        metavar="SAMPLES",
        type=int,
        help="differentiate by Savitzky-Golay over an odd number of samples",
    )
    add(
        "--refine",
        action="store_true",
        help="match trajectories afterwards: accurate under noise; standard errors",
    )
    add("--out", metavar="DIR", default="hystjax-report", help="report folder")


def run(options) -> int:
    """Fit, judge, print and write the report."""
    record = _arguments.recording(options)
    fitted_rows, unseen_rows = _choose_rows(options, len(record))
    fitted = record.window(*fitted_rows)
    library = Polynomial(options.degree, options.variables.split(","))
    regression = STLSQ(options.threshold, options.ridge, options.normalise)
    smooth = options.smooth
    differentiation = FiniteDifference() if smooth is None else SavitzkyGolay(smooth)
    found = _identify.identify(
        fitted, library, regression, differentiation=differentiation
    )
    law = found.value
    refined = None
    if options.refine:
        say("refining ...")
        refined = (law, refine(law, fitted, progress=True))
        law = refined[1].value
    judgements = {"fitted": judged(law, fitted)}
    if unseen_rows is not None:
        judgements["unseen"] = judged(law, record.window(*unseen_rows))
    ambiguous = aliases(found.stats["problem"], library.names)
    path = report.write(
        options.out,
        law,
        judgements,
        aliases=ambiguous,
        refined=refined,
        settings=_settings(options, fitted_rows, unseen_rows),
    )
    print(law)
    print(report.plain_table(report.error_table(judgements)))
    print(f"report: {path}")
    _require_finite(judgements)
    return 0


def _choose_rows(options, n: int):
    fitted = options.rows or (0, round(0.7 * n))
    if options.test:
        _check_apart(fitted, options.test)
        return fitted, options.test
    after, before = (fitted[1], n), (0, fitted[0])
    for unseen in (after, before):
        if unseen[1] - unseen[0] >= 3:
            return fitted, unseen
    return fitted, None


def _check_apart(fitted, unseen) -> None:
    if max(fitted[0], unseen[0]) < min(fitted[1], unseen[1]):
        raise InputError(
            "--test {}:{} shares rows with the fitted ones, {}:{}; errors on rows that "
            "the law was fitted on flatter it.".format(*unseen, *fitted)
        )


def _settings(options, fitted, unseen) -> dict[str, str]:
    return {
        "file": options.file,
        "fitted rows": "{}:{}".format(*fitted),
        "unseen rows": "{}:{}".format(*unseen) if unseen else "none left",
        "library": f"polynomial of degree {options.degree} in {options.variables}",
        "regression": f"STLSQ, threshold {options.threshold:g}, ridge "
        f"{options.ridge:g}, {'normalised' if options.normalise else 'physical'} units",
        "differentiation": "second-order finite differences"
        if options.smooth is None
        else f"Savitzky-Golay over {options.smooth} samples",
        "refinement": "trajectory matching" if options.refine else "none",
        "input between samples": options.interpolation,
    }


def _require_finite(judgements) -> None:
    lost = [name for name, j in judgements.items() if not bool(j.succeeded)]
    if lost:
        raise ComputationError(
            f"the law diverges on the {' and '.join(lost)} rows; the report says "
            "where. Try a higher --threshold, fewer --variables, or --smooth."
        )
