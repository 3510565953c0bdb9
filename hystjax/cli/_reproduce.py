"""`hystjax reproduce`: the source paper's experiments, and further studies."""

from . import _arguments

_DETAILS = """\
For an experiment (1, 2, 6) prints the paper's figures, those of a rerun of its
scripts, and ours with the paper's settings, side by side.

Studies of what the paper does not do, some minutes each:
  boucwen     the hidden-state oscillator of a benchmark, from random starts
  certainty   refinement under noise, against the Cramer-Rao bound
  measured    a refined law for each measured device, judged on unseen rows

Chandra et al. (2023), doi 10.1063/5.0146134
"""


def add(commands) -> None:
    """Add the command."""
    parser = _arguments.command(
        commands, "reproduce", run, "rerun the source paper's experiments", _DETAILS
    )
    parser.add_argument(
        "experiment",
        nargs="?",
        default="all",
        help="number of an experiment, all of them (default), or a study",
    )


def run(options) -> int:
    """Print one table an experiment."""
    from ..reproduce import EXPERIMENTS, reproduce

    chosen = EXPERIMENTS if options.experiment == "all" else [options.experiment]
    for number in chosen:
        print(reproduce(number).text(), end="\n\n")
    return 0
