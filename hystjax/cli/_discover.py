"""`hystjax discover`: from a noisy file to the terms of a law, and its report."""

import argparse
from typing import Any

import jax

from .._core.checks import InputError
from .._core.progress import say
from ..discovery import _discover, inclusion, suggest_excitation
from . import _arguments, _oscillator

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
    _oscillator.add(parser)
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
        return _oscillator.run(options)
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
