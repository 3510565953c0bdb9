"""`hystjax identify`: from a file to a law and its report, by regression."""

import argparse
from collections.abc import Iterator

from .._core.checks import ComputationError
from .._core.show import say
from .._core.solution import RESULTS, ended, ended_in_words
from ..models import SparseModel
from ..refinement import refine
from ..regression import STLSQ, _identify, aliases
from ..regression.differentiation import FiniteDifference, SavitzkyGolay
from ..simulation import Judgement
from . import _arguments

_DEFAULT = STLSQ()

_DETAILS = f"""\
{_arguments.ROWS}
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
    _arguments.add(parser)
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
    rows, library = _arguments.split(options)
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
    judged = rows.judged(law)
    code = _arguments.conclude(
        options,
        law,
        judged,
        rows.settings | _settings(options, failed),
        _ADVICE,
        "\n".join([str(law.kind), *_hints(law, judged["fitted"])]),
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


def _hints(law: SparseModel, fitted: Judgement) -> Iterator[str]:
    """What a newcomer does not know to try."""
    missed, terms = float(fitted.errors["nrmse"]), len(law.terms())
    if not missed <= _MUCH:
        yield (
            "a free run misses the rows it was fitted on by more than "
            f"{100 * _MUCH:g} % of their range: `hystjax discover` looks for better "
            "terms"
        )
    if terms > _MANY:
        yield (
            f"{terms} terms are many: are --input and --output exchanged? Else raise "
            "--threshold, or try `hystjax discover`"
        )


_MUCH = 0.03  # of the output's range, more than a law that was found should miss
_MANY = 9  # terms, more than a law that is to be read should have
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
