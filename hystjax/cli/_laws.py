"""Commands that find a law in a file, and write a report of it. `hystjax identify`: by
regression. `hystjax discover`: the terms of a law under noise; with `--oscillator` from
the force on a mass and where it went the law of a spring that nobody measured. Of what
suits the file `hystjax compare` tries every family, and judges all alike."""

import argparse
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp

from .._core import files
from .._core.checks import ComputationError, InputError
from .._core.compiling import changed, run_once
from .._core.show import escaped, markdown_page, markdown_table, plain_table, say
from .._core.solution import RESULTS, Solution, ended, ended_in_words
from ..comparison import FAMILIES, compare
from ..discovery import _discover, inclusion, suggest_excitation
from ..models import AbstractLaw, Oscillator, SparseModel, save
from ..recording import Recording, steady
from ..refinement import refine, statements
from ..refinement._certainty import HELD
from ..regression import STLSQ, Alias, _identify, aliases
from ..regression.differentiation import FiniteDifference, SavitzkyGolay
from ..simulation import Judgement, judge
from . import _arguments

_DEFAULT = STLSQ()

_ABOUT_IDENTIFY = f"""\
{_arguments.ROWS}
Thresholds apply to the share of the derivative that a term carries, which does not
depend on units; with --no-normalise to the coefficients in physical units, as in the
source paper. The defaults are those of hystjax.regression.STLSQ.

example, with the paper's settings for its measured actuator:
  hystjax identify piezo.csv --time 1 --input 3 --output 2 --units V,µm \\
      --rows 35001:45001 --test 17500:35000 --out report \\
      --threshold 0.01 --ridge 0.05 --no-normalise
"""


def add_identify(commands) -> None:
    """Add the command."""
    parser = _arguments.command(
        commands, "identify", run_identify, "find a law in a recording", _ABOUT_IDENTIFY
    )
    _arguments.add(parser)
    add = parser.add_argument
    for name in ("threshold", "ridge"):
        value = getattr(_DEFAULT, name)
        about = f"STLSQ {name} (default: {value:g})"
        add(f"--{name}", type=_arguments.number, default=value, help=about)
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


def run_identify(options) -> int:
    """Fit, judge, print and write the report."""
    rows, library = _arguments.split(options)
    regression = STLSQ(options.threshold, options.ridge, options.normalise)
    smooth = options.smooth
    differentiation = FiniteDifference() if smooth is None else SavitzkyGolay(smooth)
    with run_once(len(rows.fitted)):
        found = _identify.identify(
            rows.fitted, library, regression, differentiation=differentiation
        )
    law = found.value
    judged, refined, failed = rows.judged(law), None, ""
    if options.refine:
        say("refining ...")
        fit = refine(law, rows.fitted, progress=True, throw=False)
        closer = rows.judged(fit.value)
        if not ended(fit.result, RESULTS.successful):
            failed = ended_in_words(fit.result)
        elif not _error(closer) <= max(_error(judged), _MUCH):
            failed = "its free run misses the fitted rows by more"
        else:
            refined, law, judged = (law, fit), fit.value, closer
    known = aliases(found.stats["problem"], library.names)
    code = _arguments.conclude(
        options,
        law,
        judged,
        rows.settings | _settings(options, failed),
        _ADVICE,
        "\n".join([str(law.kind), *_hints(law, judged, known)]),
        aliases=known,
        refined=refined,
    )
    if failed:
        raise ComputationError(
            f"the refinement ended without a law ({failed}); the one above, which the "
            f"report keeps, is that of the regression. {_ADVICE} Or look for other "
            "terms with `hystjax discover`."
        )
    return code


def _error(judged: Mapping[str, Judgement]) -> float:
    """Of the free run along the fitted rows, NaN where it diverged."""
    return float(judged["fitted"].errors["nrmse"])


def _hints(
    law: SparseModel, judged: Mapping[str, Judgement], known: Sequence[Alias]
) -> Iterator[str]:
    """What a newcomer does not know to try."""
    terms = len(law.terms())
    for alias in known:
        if alias.term in law.terms() and alias.combination.keys() & law.terms().keys():
            yield f"{alias}: their coefficients may be any, so leave one out"
    if not _error(judged) <= _MUCH:
        yield (
            "a free run misses the rows it was fitted on by more than "
            f"{100 * _MUCH:g} % of their range: `hystjax discover` looks for better "
            "terms"
        )
    if terms > _MANY:
        yield (
            f"{terms} terms are many: raise --threshold, or try `hystjax discover`; so "
            "many are found too where --input and --output are exchanged"
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


_ABOUT_DISCOVER = f"""\
{_arguments.ROWS}
Laws of up to --largest terms are refined by trajectory matching. Where they leave white
noise, an information criterion decides; else free runs do, on blocks that each law was
refined without. Of laws hardly told from the best the plainest is chosen; where blocks
decide, of three and more that no plainer one with more evidence excludes, the one that
goes least its own way under larger, faster and slower inputs. The report says why this
one, which others there were, whether there is hysteresis in the law, and how often each
term would be chosen if the record were made again.

example:
  hystjax discover piezo.csv --time 1 --input 3 --output 2 --units V,µm \\
      --rows 35000:45000 --test 17500:35000 --out report

and of a mass on a spring that nobody measured, three cycles of 8192 rows fitted:
  hystjax discover mass.csv --period 0.00133 --input force --output position \\
      --interpolation cubic --rows 0:24576 --oscillator --cycle 8192 --out report
"""


def add_discover(commands) -> None:
    """Add the command."""
    parser = _arguments.command(
        commands,
        "discover",
        run_discover,
        "find the terms of a law under noise",
        _ABOUT_DISCOVER,
    )
    _arguments.add(parser, "all; of an --oscillator all but u")
    add = parser.add_argument
    add(
        "--largest",
        type=int,
        default=6,
        help="most terms of a law (default: 6; of an --oscillator four at most)",
    )
    add(
        "--width",
        type=int,
        default=6,
        help="laws of each size that are refined at first (default: 6)",
    )
    add(
        "--any-memory",
        action="store_true",
        help="allow laws that do not forget their initial value",
    )
    add(
        "--any-reach",
        action="store_true",
        help="allow laws that run away under larger, faster or slower inputs",
    )
    _add_known(parser)
    _add_oscillator(parser)
    add(
        "--seed",
        type=_arguments.seed,
        help="of the resampled records (default: 0)",
    )
    add(
        "--seconds",
        type=_arguments.positive,
        default=float("inf"),
        help="time after which no further laws are tried; to finish those begun, and "
        "the one that is chosen, may take as long again",
    )


def _add_known(parser) -> None:
    """Arguments that say what is known of the device."""
    add = parser.add_argument
    add(
        "--rate-independent",
        action="store_true",
        help="try only terms whose loop is the same however fast",
    )
    add(
        "--odd",
        action="store_true",
        help="try only terms of loops that are symmetric about zero",
    )
    add(
        "--sign",
        metavar="TERM=SIGN",
        action="append",
        type=_sign,
        default=[],
        help="sign of a coefficient, + or -, such as 'w*|du|=-'; for several, again",
    )
    add(
        "--known",
        metavar="TERM=X",
        action="append",
        type=_coefficient,
        default=[],
        help="a known coefficient, such as 'w=-2.5', which every law then has",
    )


def run_discover(options) -> int:
    """Search, judge, print and write the report."""
    if options.oscillator:
        return _run_oscillator(options)
    if options.cycle is not None:
        raise InputError("--cycle is of an --oscillator; leave it out.")
    rows, library = _arguments.split(options)
    seed = 0 if options.seed is None else options.seed
    memory: dict[str, Any] = {"fading": False} if options.any_memory else {}
    found = _discover.discover(
        rows.fitted,
        library,
        largest=options.largest,
        width=options.width,
        seconds=options.seconds,
        rate_independent=options.rate_independent,
        odd=options.odd,
        signs=_by_term("--sign", options.sign),
        known=_by_term("--known", options.known),
        guard=not options.any_reach,
        progress=True,
        **memory,
    )
    found = _in_its_own_words(found)
    judged = rows.judged(found.value)
    say("drawing the residuals again ...")
    shares = inclusion(
        found, rows.fitted, key=jax.random.key(seed), largest=options.largest
    )
    settings = {
        "search": f"up to {options.largest} terms, "
        f"{len(found.stats['candidates'])} laws refined",
        "resampled records": f"200, seed {seed}",
    }
    return _arguments.conclude(
        options,
        found.value,
        judged,
        rows.settings | settings,
        "Try fewer --variables, or a smaller --largest.",
        "\n".join(
            [str(found.value.kind), found.stats["why"], *_cautions(found, judged)]
        ),
        aliases=found.stats["aliases"],
        suggestions=suggest_excitation(found.value, rows.fitted, library),
        discovered=found,
        inclusion=shares,
    )


def _cautions(found: Solution, judged: Mapping[str, Judgement]) -> Iterator[str]:
    """What to know of a law before it is used, and what else there is to try."""
    yield from (each for each in statements(found) if each.startswith(HELD))
    if not _error(judged) <= _MUCH:
        yield (
            "its free run misses the rows it was fitted on by more than "
            f"{100 * _MUCH:g} % of their range: `hystjax compare` tries other models "
            "beside laws"
        )


def _in_its_own_words(found: Solution) -> Solution:
    """With options of the command line where `why` names those of `discover`."""
    why = _arguments.as_options(found.stats["why"])
    return changed(found, stats=found.stats | {"why": why})


def _by_term(option: str, given: Sequence[tuple[str, Any]]) -> dict[str, Any] | None:
    """What was said of each term, or `None` where nothing was."""
    names = [name for name, _ in given]
    if repeated := [name for name in names if names.count(name) > 1]:
        raise InputError(f"{option} is given more than once for {repeated[0]!r}.")
    return dict(given) or None


def _sign(text: str) -> tuple[str, int]:
    """Parse `TERM=+` or `TERM=-`."""
    term, _, sign = text.rpartition("=")
    if not term or sign not in ("+", "-"):
        raise argparse.ArgumentTypeError(f"{text!r} is not a sign such as 'w*|du|=-'")
    return term, 1 if sign == "+" else -1


def _coefficient(text: str) -> tuple[str, float]:
    """Parse `TERM=NUMBER`."""
    term, _, number = text.rpartition("=")
    try:
        return term, _arguments.number(number)
    except argparse.ArgumentTypeError:
        raise argparse.ArgumentTypeError(
            f"{text!r} is not a coefficient such as 'w=-2.5'"
        ) from None


_VARIABLES = ("w", "du", "|du|", "|w|")
_KNOWN = (
    "what cannot be known: a force in proportion to the position is one with the "
    "stiffness, and counted there where equations do not tell them apart. The scale of "
    "z is known, for z is a force that adds to the others."
)


def _add_oscillator(parser) -> None:
    """Arguments of hidden springs."""
    parser.add_argument(
        "--oscillator",
        action="store_true",
        help="the input is the force on a mass, the output its position: find mass, "
        "damping, stiffness, and the law of a hysteretic spring beside them (w its "
        "force, u the position), which was not measured",
    )
    parser.add_argument(
        "--cycle",
        metavar="ROWS",
        type=int,
        help="rows after which the input of an --oscillator repeats itself; whole "
        "cycles of the fitted rows are averaged, and it need not begin at rest",
    )


def _run_oscillator(options) -> int:
    """Search, judge, print and write the report."""
    _refuse_others(options)
    rows, library = _arguments.split(options, _VARIABLES)
    record, weight = rows.fitted, None
    if options.cycle is not None:
        record, weight = steady(record, options.cycle)
    runs = _runs(rows, record, 0 if weight is None else int(jnp.sum(weight == 0)))
    found = _discover.discover(
        record,
        library,
        around=_around(record),
        weights=None if weight is None else [weight],
        largest=options.largest,
        width=options.width,
        seconds=options.seconds,
        rate_independent=options.rate_independent,
        odd=options.odd,
        progress=True,
    )
    found = _in_its_own_words(found)
    # Runs that begin with the rows that were fitted begin as the fit did: the first
    # position is as noisy as every other, and a mass would ring from there.
    judgements = {
        name: judge(
            found.value,
            run,
            w0=found.stats["w0"] if run.t[0] == record.t[0] else None,
            lead_in=lead_in,
        )
        for name, (run, lead_in) in runs.items()
    }
    settings = {
        "model": "a mass on a spring and a damper, with a law of its position beside",
        "cycle": "none" if options.cycle is None else f"{options.cycle} rows, averaged",
        "search": f"{len(found.stats['candidates'])} laws refined",
    }
    return _arguments.conclude(
        options,
        found.value,
        judgements,
        rows.settings | settings,
        "Try fewer --variables, or a smaller --largest.",
        _told(found),
        aliases=found.stats["aliases"],
        discovered=found,
    )


def _refuse_others(options) -> None:
    """Raise `InputError` for options that say nothing of a spring nobody measured."""
    given = {
        "--sign": options.sign,
        "--known": options.known,
        "--any-memory": options.any_memory,
        "--any-reach": options.any_reach,
        "--seed": options.seed is not None,
        "--average": options.average != 1,
    }
    for name, value in given.items():
        if value:
            raise InputError(
                f"{name} is of laws whose output was measured; leave it out with "
                "--oscillator."
            )


def _around(record: Recording):
    """What makes an oscillator of a law; its numbers are found from any."""

    def oscillator(law: AbstractLaw) -> Oscillator:
        named: dict[str, Any] = {"names": record.names, "units": record.units}
        return Oscillator(1.0, 1.0, 1.0, law, **named)

    return oscillator


def _runs(
    rows: _arguments.Split, record: Recording, unweighed: int
) -> Mapping[str, tuple[Recording, int]]:
    """What is judged, each with the lead-in that is not: what is fitted; and from there
    on through the unseen rows, since the position at a first row does not tell how fast
    the mass was.

    **Raises:** `InputError` where no unseen row is left once it has settled.
    """
    runs = {"fitted": (record, unweighed)}
    if rows.unseen_rows is None:
        return runs
    first, end = rows.unseen_rows
    begin = min(first, rows.fitted_rows[0])
    lead_in = max(first - begin, unweighed)
    if end - begin - lead_in < 3:
        raise InputError(
            f"the unseen rows {first}:{end} are too few: a free run settles in the "
            f"first {lead_in} rows. Choose others with --test."
        )
    return runs | {"unseen": (rows.record.window(begin, end), lead_in)}


def _told(found: Solution) -> str:
    """Numbers with their standard errors, the kind of law, and what is not known."""
    model = found.value
    numbers = [
        [name, f"{value:.5g}", f"± {error:.2g}", unit]
        for name, value, unit, error in model.listed(found.stats["standard_errors"])
        if error is not None
    ]
    table = plain_table([["", "value", "standard error", ""], *numbers])
    said = "\n".join(statements(found))
    why = found.stats["why"]
    return f"{table}\nspring: {model.spring.kind}\n{why}\n{said}\n{_KNOWN}"


_ABOUT_COMPARE = f"""\
Families: {", ".join(FAMILIES)}.

Each is fitted once without each of some blocks of the rows and judged by free run on
that block, and once to all. "own" is the error on all of these rows, "beyond" how far
outputs get from the middle of the recorded ones, over half of their range, under inputs
that go farther and faster: much more than 2 is a model that runs away there. Without
--time and --period the record is quasi-static: it has no clock, and only families that
do not depend on the rate are tried. The report folder gets report.md with the table,
comparison.png with the loops of the best three, and the best as law.json, for `hystjax
simulate`, `invert` and `export`.

example:
  hystjax compare piezo.csv --time t --input V --output x --units V,µm
"""


def add_compare(commands) -> None:
    """Add the command."""
    parser = _arguments.command(
        commands,
        "compare",
        run_compare,
        "try every family of laws and models",
        _ABOUT_COMPARE,
    )
    _arguments.add_recording(parser, output_required=True)
    option = parser.add_argument
    _arguments.add_rows(parser)
    _arguments.add_average(parser)
    option(
        "--test", metavar="A:B", type=_arguments.rows, help="unseen rows to judge on"
    )
    option(
        "--families",
        metavar="A,B",
        default=",".join(FAMILIES),
        help="those to try (default: all)",
    )
    _arguments.add_out(parser, "hystjax-comparison")


def _check_kept_back(options, whole: Recording) -> None:
    """Raise `InputError` for rows to judge on that are compared on."""
    if options.rows is None:
        raise InputError(
            "--test is of rows that are not compared on, and without --rows all are. "
            "Give --rows too."
        )
    _arguments.check_rows("--test", options.test, whole)
    _arguments.check_apart(options.rows, options.test)


_ERRORS = (
    "Root mean square errors of free runs, in % of the output's range; on blocks left "
    "out their geometric mean ± its standard error. Runs of models that were refined "
    "begin at a first output that was fitted too; further down they begin at the "
    "recorded one."
)


def run_compare(options) -> int:
    """Compare, judge the best, print the table, and write the report."""
    from .. import plot, report  # and with it Matplotlib

    whole = _arguments.recording(options)
    record = _arguments.chosen_rows(options, whole).averaged(options.average)
    if options.test:
        _check_kept_back(options, whole)
    files.check_folder(options.out)
    families = [name.strip() for name in options.families.split(",")]
    found = compare(record, families=families, progress=True)
    judgements = {"fitted": judge(found.best.model, record)}
    if options.test:
        unseen = whole.window(*options.test).averaged(options.average)
        judgements["unseen"] = judge(found.best.model, unseen)
    errors = report.error_table(judgements)
    notes = [f"- {_arguments.as_options(note)}" for note in found.notes()]
    left_out = found.left_out.items()
    missing = [f"- {name}: {_arguments.as_options(why)}" for name, why in left_out]
    sections = [
        f"# Families on {escaped(Path(options.file).name)}",
        f"{_ERRORS}\n\n"
        + markdown_table(found.table())
        + f"\n\nOf these the noise is {found.noise_in_words()}.",
        "![The best three beside the record](comparison.png)",
        f"## {found.best.family}\n\n`{found.best.model}`",
        markdown_table(errors),
        "\n".join(["## Notes", "", *notes]) if notes else "",
        "\n".join(["## Not fitted", "", *missing]) if missing else "",
    ]
    place = files.made_folder(options.out)
    picture, best = place / "comparison.png", found.best
    old = report.figures_of_another(place) - {picture}
    plot.save(plot.comparison(found, record), picture)
    save(place / "law.json", best.model)
    told = report.metrics_text(best.model, judgements, {"family": best.family})
    files.write_text(place / "metrics.json", told)
    files.write_text(place / "report.md", markdown_page(sections))
    for figure in old:
        figure.unlink(missing_ok=True)
    print(_arguments.as_options(str(found)))
    print(f"\nbest: {found.best.family}\n{found.best.model}")
    print(plain_table(errors))
    print(f"report: {place / 'report.md'}")
    _arguments.require_finite(judgements, "Leave its family out of --families.")
    return 0
