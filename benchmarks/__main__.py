"""Run benchmarks: `python -m benchmarks [NAME ...] [--quick]`."""

import argparse
import sys
from collections.abc import Callable, Mapping, Sequence

import jax

import hystjax as hj

from . import (
    _results,
    bootstraps,
    comparison,
    controller,
    discover,
    long_record,
    loops,
    operators,
    population,
    precision,
    process,
    refine,
    refinements,
    regress,
    scaling,
    simulate,
    thresholds,
)
from ._agreement import Disagreement
from ._curves import Curves
from ._results import Table
from ._timing import FULL, QUICK, Effort

BENCHMARKS: Mapping[str, Callable[[Effort], Sequence[Table | Curves]]] = {
    "regress": regress.run,
    "thresholds": thresholds.run,
    "bootstraps": bootstraps.run,
    "simulate": simulate.run,
    "operators": operators.run,
    "loops": loops.run,
    "controller": controller.run,
    "refine": refine.run,
    "refinements": refinements.run,
    "discover": discover.run,
    "comparison": comparison.run,
    "population": population.run,
    "process": process.run,
    "long_record": long_record.run,
    "scaling": scaling.run,
    "precision": precision.run,
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run, print and, unless quick, write the results."""
    options = _parser().parse_args(arguments)
    jax.config.update("jax_enable_x64", True)
    results = {}
    try:
        for name in options.names or BENCHMARKS:
            print(f"{name} ...", file=sys.stderr)
            results[name] = BENCHMARKS[name](QUICK if options.quick else FULL)
            print(*(table.text() for table in results[name]), sep="\n\n", end="\n\n")
    except (hj.InputError, Disagreement) as error:
        print(f"benchmarks: error: {error}", file=sys.stderr)
        return 1
    if not options.quick:
        _results.write(results)
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks",
        description="Time hystjax beside PySINDy and SciPy, in one run, and write "
        "RESULTS.md and results.json. Needs the recording piezo_ayala, from the folder "
        "in HYSTJAX_DATA_DIR or by `hystjax data fetch piezo_ayala`.",
    )
    parser.add_argument(
        "names",
        metavar="NAME",
        nargs="*",
        type=_known,
        help=f"any of {', '.join(BENCHMARKS)} (default: all)",
    )
    parser.add_argument(
        "--quick", action="store_true", help="few repetitions; nothing is written"
    )
    return parser


def _known(name: str) -> str:
    if name not in BENCHMARKS:
        raise argparse.ArgumentTypeError(
            f"there is no benchmark {name!r}; choose from {', '.join(BENCHMARKS)}"
        )
    return name


if __name__ == "__main__":
    sys.exit(main())
