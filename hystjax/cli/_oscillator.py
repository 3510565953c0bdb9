"""`hystjax discover --oscillator`: from the force on a mass and where it went to the
law of a spring that nobody measured."""

from collections.abc import Mapping
from typing import Any

import jax.numpy as jnp

from .. import report
from .._core.checks import InputError
from .._core.solution import Solution
from ..discovery import _discover
from ..models import AbstractLaw, Oscillator
from ..recording import Recording, steady
from ..refinement import statements
from ..simulation import judge
from . import _arguments

_VARIABLES = ("w", "du", "|du|", "|w|")
_KNOWN = (
    "what cannot be known: a force in proportion to the position is one with the "
    "stiffness, and counted there where equations do not tell them apart. The scale of "
    "z is known, for z is a force that adds to the others."
)


def add(parser) -> None:
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


def run(options) -> int:
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
