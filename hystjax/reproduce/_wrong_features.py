"""Experiment 5: regressions that are given features of another law."""

from functools import partial

from ..library import BoucWen
from ._comparison import Comparison
from ._figures import Side, published_side, runs, side_by_side
from ._published import (
    MEASURES,
    REFINED_LAW,
    ROUNDED,
    UNSEEN,
    copied,
    error_row,
    free_run_error,
    refined,
)
from ._records import EXPERIMENT_5
from ._rivals import Entry, fits, regression_rows

ENTRIES = {
    "SINDy": Entry(None, 8.39e-4, {"du": 19.846, "w*|du|": -0.247, "u*|du|": 0.990}),
    "linear regression": Entry(
        "> 5", 6.41, {"du": 3.754, "w*|du|": -0.024, "du*|w|": 0.025}
    ),
    "ridge, alpha = 1": Entry(
        "> 5", 6.41, {"du": 3.7543, "w*|du|": -0.024, "du*|w|": 0.025}
    ),
}
# Ridge regression finds the law of linear regression, to three digits.
_DRAWN = ("SINDy", "linear regression")
_NOTE = (
    "Linear and ridge regression get the three features of the Bouc-Wen law, SINDy a "
    "library that holds those of the true one; with the true features they would find "
    "it too."
)


def experiment_5() -> Comparison:
    """Duhem law, with features of the Bouc-Wen law for linear and ridge regression."""
    record, unseen = EXPERIMENT_5.record(), EXPERIMENT_5.unseen()
    found = fits(record, BoucWen())
    better = refined(found["SINDy"], record)
    laws = {name: found[name] for name in _DRAWN} | {REFINED_LAW: better}
    drawing = partial(
        side_by_side,
        published_side({x: copied(ENTRIES[x].terms, record) for x in _DRAWN}, record),
        Side("On an unseen record", unseen, runs(laws, unseen)),
    )
    rows = (
        *regression_rows("", record, BoucWen(), ENTRIES, {"unseen record": unseen}),
        error_row("refined, free run", free_run_error(better, record)),
        error_row("refined, unseen record", free_run_error(better, unseen)),
    )
    title = "Experiment 5: features of another law, u = t sin t, squared errors in %"
    notes = (str(found["SINDy"]), MEASURES, ROUNDED, UNSEEN, _NOTE)
    return Comparison(title, rows, notes, drawing)
