"""Sparse regression beside linear and ridge regression and a network, as in the tables
of the paper."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import jax
import optax

from .._recording import Recording
from ..baselines import MLP, Linear, cautious_lbfgs, rates
from ..library import Library
from ..models import AbstractModel
from ._comparison import Row
from ._published import copied, error_row, free_run_error, learned, squared_error
from ._records import fitted_and_held_out

Figure = float | str | None

# PyTorch's L-BFGS as the scripts call it: a step of a tenth an epoch, and no pairs of
# less curvature than 1e-10.
AS_PUBLISHED = cautious_lbfgs(0.1, memory_size=100, least=1e-10)

RIVALS = (
    "Linear and ridge regression and the network get the features of the table's law "
    "and a random three quarters of the rows; regressions fit an intercept, which the "
    "scripts then leave out.",
    "The paper's figure for the network is the error of the derivative on rows held "
    "out, while the others are errors of a free run. Here each has both.",
    "The network depends on its random start, here jax.random.key(0): other keys "
    "change its errors by a factor of up to two. PyTorch's L-BFGS, which the scripts "
    "use, does not remember steps with a curvature below 1e-10; where errors are small "
    "(Table I), the same network gets further without that rule.",
)


@dataclass(frozen=True)
class Entry:
    """An entry of a table of the paper.

    **Attributes:**

    - `paper`, `rerun`: squared error, %.
    - `terms`: what the script simulates with, coefficients by term.
    """

    paper: Figure
    rerun: Figure
    terms: Mapping[str, float]


def fits(record: Recording, given: Library) -> dict[str, AbstractModel]:
    """Laws by the methods of the tables, with the paper's settings."""
    rows, _ = fitted_and_held_out(len(record))
    return {
        "SINDy": learned(record),
        "linear regression": Linear(given).fit(record, rows=rows).value,
        "ridge, alpha = 1": Linear(given, ridge=1.0).fit(record, rows=rows).value,
    }


def regression_rows(
    label: str,
    record: Recording,
    given: Library,
    entries: Mapping[str, Entry],
    judged: Mapping[str, Recording],
) -> list[Row]:
    """Errors of each method on the record, and free runs on others that are `judged`,
    by name."""
    rows = []
    for method, law in fits(record, given).items():
        entry, name = entries[method], f"{label}{method}"
        error = free_run_error(copied(entry.terms, record), record)
        rows += [
            error_row(f"{name}, script's rounded law", error, entry.paper, entry.rerun),
            *_more(name, law, record, judged),
        ]
    return rows


def network_rows(
    name: str,
    optimiser: optax.GradientTransformation,
    record: Recording,
    given: Library,
    judged: Mapping[str, Recording],
    published: tuple[Figure, Figure] = (None, None),
    epochs: int | None = None,
) -> list[Row]:
    """Errors of the network, trained by an `optimiser` for at most so many `epochs`;
    paper's and rerun's figures are of the derivative."""
    rows, _ = fitted_and_held_out(len(record))
    network = MLP(given, optimiser=optimiser)
    if epochs is not None:
        network = replace(network, epochs=min(epochs, network.epochs))
    law = network.fit(record, rows=rows, key=jax.random.key(0), progress=True).value
    *free, derivative = _more(name, law, record, judged)
    return [replace(derivative, paper=published[0], rerun=published[1]), *free]


def _more(name: str, law, record, judged: Mapping[str, Recording]) -> Sequence[Row]:
    """Free runs, and last the derivative of the rows held out."""
    _, held_out = fitted_and_held_out(len(record))
    everywhere = {"free run": record, **judged}
    derivative = squared_error(*rates(law, record, rows=held_out))
    return [
        *(
            error_row(f"{name}, {where}", free_run_error(law, other))
            for where, other in everywhere.items()
        ),
        error_row(f"{name}, derivative of rows held out", derivative),
    ]
