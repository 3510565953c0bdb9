"""`hystjax reproduce`: the source paper's experiments, and further studies."""

from . import _arguments

_DETAILS = """\
For an experiment (1 to 8) prints the paper's figures, those of a rerun of its
scripts, and ours with the paper's settings, side by side, and then what we get
beyond them.

`tables` is the paper's tables: experiments 3 and 4, which train networks, a minute
each, and `table3`, the measured piezo by sparse laws, an evolutionary fit and four
networks, in seven minutes.

Studies of what the paper does not do, some minutes each:
  boucwen     the hidden-state oscillator of a benchmark, from random starts
  butterflies the law of a hidden polarisation, from input and strain alone
  certainty   refinement under noise, against the Cramer-Rao bound
  control     twins of devices led along references, by another family's inverse
  measured    a refined law for each measured device, judged on unseen rows
  outliers    laws from records in which one sample in twenty is grossly wrong
  properties  rate independence, return-point memory and the like, law by law
  sizes       laws of a measured piezo by their number of terms

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
        help="number of an experiment, `tables`, `table3`, `all` of these (default), "
        "or a study",
    )
    parser.add_argument(
        "--out",
        metavar="DIR",
        help="also write what is printed as JSON and Markdown, and an experiment's "
        "figure as PNG",
    )


def run(options) -> int:
    """Print one table an experiment."""
    from ..reproduce import EXPERIMENTS, TABLES, reproduce, write

    groups = {"all": tuple({**EXPERIMENTS, **TABLES}), "tables": tuple(TABLES)}
    chosen = groups.get(options.experiment, (options.experiment,))
    for name in chosen:
        result = reproduce(name)
        print(result.text(), end="\n\n")
        if options.out is not None:
            write(options.out, name, result)
    return 0
