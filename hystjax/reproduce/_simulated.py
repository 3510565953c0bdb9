"""Experiments 1 and 2: a law is found again from its simulated record."""

from ..library import VARIABLES
from ._comparison import Comparison
from ._published import MEASURES, ROUNDED, UNSEEN, coefficient_rows, law_rows, learned
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
    record = setup.record()
    law = learned(record, variables=variables)
    rows = (
        *coefficient_rows(law, published),
        *law_rows(record, law, terms, *figures, unseen=setup.unseen()),
    )
    return Comparison(title, rows, (str(law), MEASURES, ROUNDED, UNSEEN))
