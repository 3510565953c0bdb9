"""`hystjax reproduce`: the source paper's experiments, and further studies."""

from . import _arguments

_DETAILS = """\
Prints the paper's figures, those of a rerun of its scripts, and ours with the paper's
settings, side by side. `certainty` refines noisy copies of the simulated records and
compares the scatter of the coefficients with the Cramer-Rao bound.

Chandra et al. (2023), doi 10.1063/5.0146134
"""


def add(commands) -> None:
    """Add the command."""
    parser = _arguments.command(
        commands, "reproduce", run, "rerun experiments of the source paper, and studies", _DETAILS
    )
    parser.add_argument(
        "experiment",
        nargs="?",
        default="all",
        help="number of an experiment, all of them (default), or certainty",
    )


def run(options) -> int:
    """Print one table an experiment."""
    from ..reproduce import EXPERIMENTS, reproduce

    chosen = EXPERIMENTS if options.experiment == "all" else [options.experiment]
    for number in chosen:
        print(reproduce(number).text(), end="\n\n")
    return 0
