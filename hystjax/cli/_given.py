"""Commands that need no file of one's own. `hystjax data`: the measured recordings
hystjax knows. `hystjax demo`: the main job on a simulated and, where there is one, a
measured recording. `hystjax reproduce`: the source paper's experiments, and further
studies."""

import time
from pathlib import Path

import jax

from .._core import files
from .._core.checks import InputError, nearest
from .._core.show import plain_table, say
from ..library import Polynomial
from ..recording import Recording, datasets
from ..regression import aliases, identify
from ..simulation import judge
from . import _arguments

_ABOUT_DATA = """\
Recordings are read from the folder in HYSTJAX_DATA_DIR, else from the cache, else
downloaded from their source; files are checked by SHA-256.

examples:
  hystjax data list
  hystjax data fetch piezo_ayala
  hystjax data path piezo_ayala
"""


def add_data(commands) -> None:
    """Add the command and its actions."""
    parser = _arguments.command(
        commands, "data", None, "list, fetch or locate measured recordings", _ABOUT_DATA
    )
    actions = parser.add_subparsers(title="actions", required=True, metavar="ACTION")
    _arguments.command(
        actions, "list", _list, "show what each recording is, its licence and source"
    )
    fetch = _arguments.command(
        actions, "fetch", _fetch, "download one recording, or all, and say where it is"
    )
    fetch.add_argument("name", metavar="NAME", nargs="?", help="default: all")
    path = _arguments.command(
        actions, "path", _path, "say where a recording is, without a download"
    )
    path.add_argument("name", metavar="NAME")


def _list(options) -> int:
    print(datasets.listing())
    return 0


def _fetch(options) -> int:
    for name in [options.name] if options.name else datasets.names():
        print(*datasets.fetch(name), sep="\n")
    return 0


def _path(options) -> int:
    print(datasets.path(options.name))
    return 0


_REPEATS = 5

_ABOUT_DEMO = """\
For each recording: the law, its errors by free run on the rows it was fitted on and on
rows it has not seen, and how long it took. A report folder with figures each.
"""


def add_demo(commands) -> None:
    """Add the command."""
    parser = _arguments.command(
        commands,
        "demo",
        run_demo,
        "run the main job on built-in recordings",
        _ABOUT_DEMO,
    )
    _arguments.add_out(parser, "hystjax-report-demo")


def run_demo(options) -> int:
    """Run both recordings."""
    from ..reproduce import duhem_growing_sine

    place = files.made_folder(options.out)
    say("integrating a Duhem law under a growing sine ...")
    simulated = duhem_growing_sine()
    fitted, unseen = simulated.split(0.7)
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
    from .. import report  # and with it Matplotlib
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
    for line in plain_table(report.error_table(judgements)).splitlines():
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


_ABOUT_REPRODUCE = """\
For an experiment (1 to 8) prints the paper's figures, those of a rerun of its
scripts, and ours with the paper's settings, side by side, and then what we get
beyond them.

`tables` is the paper's tables: experiments 3 and 4, which train networks, a minute
each, and `table3`, the measured piezo by sparse laws, an evolutionary fit and four
networks, in seven minutes.

Studies of what the paper does not do, most of some minutes:
  boucwen       the hidden-state oscillator of a benchmark, from random starts
  butterflies   the law of a hidden polarisation, from input and strain alone
  certainty     refinement under noise, against the Cramer-Rao bound
  choice        laws that `discover` chooses on part of each device's records, judged on
                the rest; an hour
  classical     classical models, guessed and refined on their own noisy records
  control       twins of devices led along references, by another family's inverse
  families      which family `compare` puts first on halves of devices, judged on the
                other half; half an hour
  hidden        laws of springs inside of a mass on a spring, under noise; two hours
  hybrid        laws of measured devices, and networks for what they miss
  measured      a refined law for each measured device, judged on unseen rows
  memory        plays, stops and lags in laws of a friction damper and a piezo
  outliers      laws from records in which one sample in twenty is grossly wrong
  properties    rate independence, return-point memory and the like, law by law
  sizes         laws of a measured piezo by their number of terms
  steel_models  classical models of an electrical steel, judged on a loop left out
  voltages      the voltage that inverses ask for, beside the one that was applied

Chandra et al. (2023), doi 10.1063/5.0146134
"""


def add_reproduce(commands) -> None:
    """Add the command."""
    parser = _arguments.command(
        commands,
        "reproduce",
        run_reproduce,
        "rerun the source paper's experiments",
        _ABOUT_REPRODUCE,
    )
    parser.add_argument(
        "experiment",
        nargs="?",
        default="all",
        help="number of an experiment, `tables`, `table3`, `all` of these (default), "
        "or a study",
    )
    parser.add_argument(
        "--out",
        metavar="DIR",
        help="also write what is printed as JSON and Markdown, and an experiment's "
        "figure as PNG",
    )


def run_reproduce(options) -> int:
    """Print one table an experiment."""
    from ..reproduce import EXPERIMENTS, STUDIES, TABLES, reproduce, write

    groups = {"all": tuple({**EXPERIMENTS, **TABLES}), "tables": tuple(TABLES)}
    known = {**EXPERIMENTS, **groups, **TABLES, **STUDIES}
    if options.experiment not in known:
        raise InputError(
            f"there is no experiment {options.experiment!r} to reproduce. "
            f"{nearest(options.experiment, known)}Choose from {', '.join(known)}."
        )
    if options.out is not None:
        files.made_folder(options.out)  # or said that it cannot, before the work
    for name in groups.get(options.experiment, (options.experiment,)):
        result = reproduce(name)
        print(result.text(), end="\n\n")
        if options.out is not None:
            write(options.out, name, result)
    return 0
