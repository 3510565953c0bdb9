"""`hystjax reproduce`: the source paper's experiments, and further studies."""

from .._errors import InputError
from . import _arguments

_DETAILS = """\
For an experiment (1 to 8) prints the paper's figures, those of a rerun of its
scripts, and ours with the paper's settings, side by side, and then what we get
beyond them. `tables` is experiments 3 and 4, which train networks: a minute each.

Studies of what the paper does not do, some minutes each:
  boucwen     the hidden-state oscillator of a benchmark, from random starts
  certainty   refinement under noise, against the Cramer-Rao bound
  measured    a refined law for each measured device, judged on unseen rows
  outliers    laws from records in which one sample in twenty is grossly wrong
  properties  rate independence, return-point memory and the like, law by law

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
        help="number of an experiment, `tables`, `all` of them (default), or a study",
    )
    parser.add_argument(
        "--out", metavar="DIR", help="also write experiment_N.json and experiment_N.md"
    )


def run(options) -> int:
    """Print one table an experiment."""
    from ..reproduce import EXPERIMENTS, STUDIES, TABLES, Comparison, reproduce, write

    groups = {"all": tuple(EXPERIMENTS), "tables": TABLES}
    chosen = groups.get(options.experiment, (options.experiment,))
    if options.out is not None and options.experiment in STUDIES:
        raise InputError(
            f"--out is for experiments, and {options.experiment!r} is a study; leave "
            "it out, or redirect what is printed to a file."
        )
    for number in chosen:
        result = reproduce(number)
        print(result.text(), end="\n\n")
        if isinstance(result, Comparison) and options.out is not None:
            write(options.out, number, result)
    return 0
