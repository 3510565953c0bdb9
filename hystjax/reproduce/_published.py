"""What the paper's experiments share: settings, measures, rows of a table.

Chandra et al. (2023), doi 10.1063/5.0146134. Rerun figures were measured with PySINDy
2.1.0, SciPy 1.17 and PyTorch 2.13.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from .. import metrics
from .._identify import identify
from .._judge import judge
from .._recording import Recording
from .._refine import refine
from ..library import VARIABLES, Library, Polynomial, Term
from ..models import AbstractLaw, AbstractModel, SparseModel
from ..regression import STLSQ
from ._comparison import Row

MEASURES = (
    "Errors are squared ones, mean((w* - w)^2) / mean(w^2), as in the paper's tables; "
    "the last column has their roots, by the formula that the paper prints."
)
ROUNDED = (
    "The paper's scripts simulate with coefficients copied by hand, most to three "
    "decimals; rows that say so do the same."
)
UNSEEN = (
    "Unseen records are of the same device under 0.7 times the amplitude and the "
    "frequency: nothing in them is beyond the range of the fitted one."
)
ROUNDED_LAW, UNROUNDED_LAW, REFINED_LAW = (
    "script's rounded law",
    "unrounded law",
    "refined law",
)


def published_settings(threshold: float = 0.1) -> STLSQ:
    """The regression of the paper's scripts: thresholds in physical units."""
    return STLSQ(threshold=threshold, ridge=0.05, normalise=False)


def learned(
    record: Recording, threshold: float = 0.1, variables=VARIABLES
) -> SparseModel:
    """The law that the paper's settings give, over its own terms."""
    library = Polynomial(2, variables)
    return identify(record, library, published_settings(threshold)).value.compact()


def copied(terms: Mapping[str, float], record: Recording) -> SparseModel:
    """A law that a script simulates. Its terms are in the order of the library, as in
    the learned one: what is compiled for the one serves the other."""
    order = [name for name in Polynomial(2, VARIABLES).names if name in terms]
    ordered = {name: terms[name] for name in order}
    return SparseModel.from_terms(ordered, names=record.names, units=record.units)


def refined(law: AbstractModel, record: Recording, **how: Any) -> Any:
    """The law whose free run follows the record from its first output, which simulated
    records know; `how` says otherwise, as for `refine`."""
    settings: dict[str, Any] = {"free_start": False, "throw": False} | how
    return refine(law, record, **settings).value


def features(*names: str) -> Library:
    """A library of some terms."""
    return Library(tuple(Term.parse(name) for name in names))


def coefficient_rows(
    law: AbstractLaw, published: Mapping[str, tuple[float | None, float]]
) -> tuple[Row, ...]:
    """A row a term that either side has; `published` gives paper and rerun by term."""
    ours = law.terms()
    rows = []
    for name in dict.fromkeys([*published, *ours]):
        paper, rerun = published.get(name, ("absent", "absent"))
        rows.append(
            Row(f"coefficient of {name}", paper, rerun, ours.get(name, "absent"))
        )
    return tuple(rows)


def error_row(
    quantity: str,
    squared: float,
    paper: float | str | None = None,
    rerun: float | str | None = None,
) -> Row:
    """A row of a squared error, given as a ratio; in the table it is per cent."""
    relative = 100 * float(np.sqrt(squared))
    return Row(quantity, paper, rerun, 100 * float(squared), relative)


def free_run_error(model: AbstractModel, record: Recording) -> float:
    """Squared error of a free run, as a ratio."""
    return percent(judge(model, record), "relative_squared_error") / 100


def squared_error(w, w_hat) -> float:
    """Squared error of two outputs, as a ratio."""
    return float(metrics.relative_squared_error(w, w_hat))


def three_laws(
    law: SparseModel, terms: Mapping[str, float], record: Recording, **how: Any
) -> dict[str, AbstractModel]:
    """By name: what the script simulates with, its `terms`; the `law` that was learned;
    and what refinement on the record makes of that, `how` as for `refined`."""
    return {
        ROUNDED_LAW: copied(terms, record),
        UNROUNDED_LAW: law,
        REFINED_LAW: refined(law, record, **how),
    }


def percent(judgement, name: str) -> float:
    """An error of a judgement, %."""
    return 100 * float(judgement.errors[name])
