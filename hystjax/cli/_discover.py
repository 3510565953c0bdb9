"""`hystjax discover`: from a noisy file to the terms of a law, and its report; with
`--oscillator` from the force on a mass and where it went to the law of a spring that
nobody measured."""

import argparse
from collections.abc import Mapping
from typing import Any

import jax
import jax.numpy as jnp

from .. import report
from .._core.checks import InputError
from .._core.compiling import changed
from .._core.show import say
from .._core.solution import Solution
from ..discovery import _discover, inclusion, suggest_excitation
from ..models import AbstractLaw, Oscillator
from ..recording import Recording, steady
from ..refinement import statements
from ..simulation import judge
from . import _arguments

_DETAILS = f"""\
{_arguments.ROWS}
Laws of up to --largest terms are refined by trajectory matching. Where they leave white
noise, an information criterion decides; else free runs do, on blocks that each law was
refined without. Of laws hardly told from the best the plainest is chosen. The report
says why this one, which others there were, whether there is hysteresis in the law, and
how often each term would be chosen if the record were made again.

example:
  hystjax discover piezo.csv --time 1 --input 3 --output 2 --units V,µm \\
      --rows 35000:45000 --test 17500:35000 --out report

and of a mass on a spring that nobody measured, three cycles of 8192 rows fitted:
  hystjax discover mass.csv --period 0.00133 --input force --output position \
      --interpolation cubic --rows 0:24576 --oscillator --cycle 8192 --out report
"""


def add(commands) -> None:
    """Add the command."""
    parser = _arguments.command(
        commands, "discover", run, "find the terms of a law under noise", _DETAILS
    )
    _arguments.add(parser, "all; of an --oscillator all but u")
    add = parser.add_argument
    add("--largest", type=int, default=6, help="most terms of a law (default: 6)")
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
        default=0,
        help="of the resampled records (default: 0)",
    )
    add(
        "--seconds",
        type=_arguments.positive,
        default=float("inf"),
        help="time after which no further laws are tried; those begun are finished",
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


def run(options) -> int:
    """Search, judge, print and write the report."""
    if options.oscillator:
        return _run_oscillator(options)
    if options.cycle is not None:
        raise InputError("--cycle is of an --oscillator; leave it out.")
    rows, library = _arguments.split(options)
    memory: dict[str, Any] = {"fading": False} if options.any_memory else {}
    found = _discover.discover(
        rows.fitted,
        library,
        largest=options.largest,
        width=options.width,
        seconds=options.seconds,
        rate_independent=options.rate_independent,
        odd=options.odd,
        signs=dict(options.sign) or None,
        known=dict(options.known) or None,
        guard=not options.any_reach,
        progress=True,
        **memory,
    )
    found = _in_its_own_words(found)
    say("drawing the residuals again ...")
    shares = inclusion(
        found, rows.fitted, key=jax.random.key(options.seed), largest=options.largest
    )
    settings = {
        "search": f"up to {options.largest} terms, "
        f"{len(found.stats['candidates'])} laws refined",
        "resampled records": f"200, seed {options.seed}",
    }
    return _arguments.conclude(
        options,
        found.value,
        rows.judged(found.value),
        rows.settings | settings,
        "Try fewer --variables, or a smaller --largest.",
        f"{found.value.kind}\n{found.stats['why']}",
        aliases=found.stats["aliases"],
        suggestions=suggest_excitation(found.value, rows.fitted, library),
        discovered=found,
        inclusion=shares,
    )


def _in_its_own_words(found: Solution) -> Solution:
    """With options of the command line where `why` names those of `discover`."""
    why = _arguments.as_options(found.stats["why"])
    return changed(found, stats=found.stats | {"why": why})


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
        return term, float(number)
    except ValueError:
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
    judgements = {
        name: judge(found.value, run, lead_in=lead_in)
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
    model, errors = found.value, found.stats["standard_errors"]
    units = model.number_units()
    numbers = [
        [name, f"{value:.5g}", f"± {float(errors[name]):.2g}", units.get(name, "")]
        for name, value in model.numbers().items()
        if name in errors
    ]
    table = report.plain_table([["", "value", "standard error", ""], *numbers])
    said = "\n".join(statements(found))
    why = found.stats["why"]
    return f"{table}\nspring: {model.spring.kind}\n{why}\n{said}\n{_KNOWN}"
