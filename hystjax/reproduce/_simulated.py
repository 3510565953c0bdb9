"""Experiments 1 and 2: a law is found again from its simulated record."""

from functools import partial

from ..library import VARIABLES
from ._comparison import Comparison
from ._figures import Side, published_side, runs, side_by_side
from ._published import (
    MEASURES,
    ROUNDED,
    ROUNDED_LAW,
    UNSEEN,
    coefficient_rows,
    error_row,
    free_run_error,
    learned,
    three_laws,
)
from ._records import EXPERIMENT_1, EXPERIMENT_2, Setup

COPIED = {
    1: {"u*|du|": 0.4, "w*|du|": -0.5, "du": 0.251},
    2: {"du": 4.999, "w*|du|": -0.25, "du*|w|": -0.499},
}


def experiment_1() -> Comparison:
    """Duhem law under a growing sine."""
    return _found_again(
        "Experiment 1: Duhem law, u = t sin t",
        EXPERIMENT_1,
        VARIABLES[:4],
        {"u*|du|": (0.4, 0.400), "w*|du|": (-0.5, -0.500), "du": (0.251, 0.251)},
        COPIED[1],
        (5.8e-6, 5.81e-6),
    )


def experiment_2() -> Comparison:
    """Bouc-Wen law under a sine."""
    return _found_again(
        "Experiment 2: Bouc-Wen law, u = sin t",
        EXPERIMENT_2,
        VARIABLES,
        {"du": (4.99, 4.999), "w*|du|": (-0.25, -0.250), "du*|w|": (-0.49, -0.499)},
        COPIED[2],
        (4.6e-6, 4.63e-6),
    )


def _found_again(title, setup: Setup, variables, published, terms, figures):
    record, unseen = setup.record(), setup.unseen()
    law = learned(record, variables=variables)
    laws = three_laws(law, terms, record)
    own, new = ([free_run_error(x, r) for x in laws.values()] for r in (record, unseen))
    rows = (
        *coefficient_rows(law, published),
        error_row("squared error, %", own[1]),
        error_row("  with the script's rounded law", own[0], *figures),
        error_row("  with the refined law", own[2]),
        error_row("on an unseen record", new[1]),
        error_row("  with the refined law, unseen", new[2]),
    )
    drawing = partial(
        side_by_side,
        published_side({ROUNDED_LAW: laws[ROUNDED_LAW]}, record),
        Side("On an unseen record", unseen, runs(laws, unseen)),
    )
    return Comparison(title, rows, (str(law), MEASURES, ROUNDED, UNSEEN), drawing)
