"""`hystjax identify`: from a file to a law and its report, by regression."""

import argparse

from .._core.errors import ComputationError
from .._core.progress import say
from .._core.solution import RESULTS, ended, ended_in_words
from ..refinement import refine
from ..regression import STLSQ, _identify, aliases
from ..regression.differentiation import FiniteDifference, SavitzkyGolay
from . import _arguments, _fitting

_DEFAULT = STLSQ()

_DETAILS = f"""\
{_fitting.ROWS}
Thresholds apply to the share of the derivative that a term carries, which does not
depend on units; with --no-normalise to the coefficients in physical units, as in the
source paper. The defaults are those of hystjax.regression.STLSQ.

example, with the paper's settings for its measured actuator:
  hystjax identify piezo.csv --time 1 --input 3 --output 2 --units V,µm \\
      --rows 35001:45001 --test 17500:35000 --out report \\
      --threshold 0.01 --ridge 0.05 --no-normalise
"""


def add(commands) -> None:
    """Add the command."""
    parser = _arguments.command(
        commands, "identify", run, "find a law in a recording", _DETAILS
    )
    _fitting.add(parser)
    add = parser.add_argument
    for name in ("threshold", "ridge"):
        value = getattr(_DEFAULT, name)
        about = f"STLSQ {name} (default: {value:g})"
        add(f"--{name}", type=float, default=value, help=about)
    add(
        "--normalise",
        action=argparse.BooleanOptionalAction,
        default=_DEFAULT.normalise,
        help="threshold and ridge on normalised columns (default) or physical ones",
    )
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


def run(options) -> int:
    """Fit, judge, print and write the report."""
    rows, library = _fitting.split(options)
    regression = STLSQ(options.threshold, options.ridge, options.normalise)
    smooth = options.smooth
    differentiation = FiniteDifference() if smooth is None else SavitzkyGolay(smooth)
    found = _identify.identify(
        rows.fitted, library, regression, differentiation=differentiation
    )
    law = found.value
    refined, failed = None, ""
    if options.refine:
        say("refining ...")
        fit = refine(law, rows.fitted, progress=True, throw=False)
        if ended(fit.result, RESULTS.successful):
            refined, law = (law, fit), fit.value
        else:
            failed = ended_in_words(fit.result)
    code = _fitting.conclude(
        options,
        law,
        rows.judged(law),
        rows.settings | _settings(options, failed),
        _ADVICE,
        str(law.kind),
        aliases=aliases(found.stats["problem"], library.names),
        refined=refined,
    )
    if failed:
        raise ComputationError(
            f"the refinement ended without a law ({failed}); the one above, which the "
            f"report keeps, is that of the regression. {_ADVICE} Or look for other "
            "terms with `hystjax discover`."
        )
    return code


_ADVICE = "Try a higher --threshold, fewer --variables, or --smooth."


def _settings(options, failed: str) -> dict[str, str]:
    refinement = "trajectory matching" if options.refine else "none"
    return {
        "regression": f"STLSQ, threshold {options.threshold:g}, ridge "
        f"{options.ridge:g}, {'normalised' if options.normalise else 'physical'} units",
        "differentiation": "second-order finite differences"
        if options.smooth is None
        else f"Savitzky-Golay over {options.smooth} samples",
        "refinement": f"failed ({failed})" if failed else refinement,
    }
