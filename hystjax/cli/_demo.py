"""`hystjax demo`: the main job on a simulated and, where there is one, a measured
recording."""

import time
from pathlib import Path

import jax

from .. import report
from .._core.checks import InputError
from .._core.show import say
from ..library import Polynomial
from ..recording import Recording, datasets
from ..regression import aliases, identify
from ..simulation import judge
from . import _arguments

_REPEATS = 5

_DETAILS = """\
For each recording: the law, its errors by free run on the rows it was fitted on and on
rows it has not seen, and how long it took. A report folder with figures each.
"""


def add(commands) -> None:
    """Add the command."""
    parser = _arguments.command(
        commands, "demo", run, "run the main job on built-in recordings", _DETAILS
    )
    parser.add_argument(
        "--out", metavar="DIR", default="hystjax-report-demo", help="report folder"
    )


def run(options) -> int:
    """Run both recordings."""
    from ..reproduce import duhem_growing_sine

    say("integrating a Duhem law under a growing sine ...")
    simulated = duhem_growing_sine()
    fitted, unseen = simulated.split(0.7)
    place = Path(options.out)
    _show("simulated Duhem device", fitted, unseen, 0.1, place / "simulated")
    try:
        measured = datasets.load("piezo_ayala")
    except InputError as error:
        print(f"measured piezo actuator: left out, {error}")
        return 0
    fitted, unseen = measured.window(35001, 45001), measured.window(17500, 35000)
    _show("measured piezo actuator", fitted, unseen, 0.01, place / "piezo")
    return 0


def _show(
    title: str, fitted: Recording, unseen: Recording, threshold: float, place: Path
) -> None:
    from ..reproduce import published_settings

    library, regression = Polynomial(2), published_settings(threshold)

    def fit():
        return jax.block_until_ready(identify(fitted, library, regression))

    say(f"fitting the {title} ...")
    found, first = _timed(fit)
    law, problem = found.value, found.stats["problem"]
    warm = _best(fit)
    say("simulating ...")
    judgements = {"fitted": judge(law, fitted), "unseen": judge(law, unseen)}
    free_run = _best(lambda: jax.block_until_ready(judge(law, fitted)))
    settings = {"recording": title, "threshold": f"{threshold:g}"}
    path = report.write(
        place,
        law,
        judgements,
        aliases=aliases(problem, library.names),
        settings=settings,
    )
    print(f"{title}: {len(fitted)} rows fitted, {len(unseen)} unseen")
    print(f"  {law}")
    for line in report.plain_table(report.error_table(judgements)).splitlines():
        print(f"  {line}")
    print(
        f"  fit {first:.2f} s with compilation, {1e3 * warm:.2f} ms again; free run "
        f"{1e3 * free_run:.1f} ms (best of {_REPEATS})"
    )
    print(f"  report: {path}\n")


def _timed(function):
    start = time.perf_counter()
    value = function()
    return value, time.perf_counter() - start


def _best(function) -> float:
    """The shortest time of several, s: the others shared the processor."""
    return min(_timed(function)[1] for _ in range(_REPEATS))
