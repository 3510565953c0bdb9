"""What the paper's experiments share: simulated records, settings, measures, rows of a
table, and rival methods.

Chandra et al. (2023), doi 10.1063/5.0146134. Rerun figures were measured with PySINDy
2.1.0, SciPy 1.17 and PyTorch 2.13.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import equinox as eqx
import jax
import numpy as np
import optax

from ..library import VARIABLES, Library, Polynomial, Term
from ..models import AbstractLaw, AbstractModel, BoucWen, Duhem, SparseModel
from ..recording import Recording
from ..refinement import refine
from ..regression import STLSQ, identify
from ..signals.excitation import AbstractExcitation, GrowingSine, Sine
from ..simulation import generate, judge, metrics
from ._document import Row
from .baselines import MLP, Linear, cautious_lbfgs, rates

_ONE_RADIAN = 1 / (2 * np.pi)  # Hz: sin t
_UNITS = ("V", "µm")
_NAMES = ("voltage", "displacement")
_NAMED = {"names": _NAMES, "units": _UNITS}


@dataclass(frozen=True)
class Setup:
    """A simulated experiment, from w(0) = 0.

    **Attributes:** the `law`; the `excitation`; the `duration`, s, and the number of
    `samples`, at even distances from 0 s on.
    """

    law: AbstractModel
    excitation: AbstractExcitation
    duration: float
    samples: int = 1000

    def record(self) -> Recording:
        """The record without noise."""
        return generate(self.law, self.excitation, self._times())

    def unseen(self) -> Recording:
        """The same device under a smaller and slower input of the same kind: nothing in
        it is beyond the range of the record."""
        smaller = jax.tree.map(lambda number: 0.7 * number, self.excitation)
        return generate(self.law, smaller, self._times())

    def _times(self):
        return np.linspace(0, self.duration, self.samples)


EXPERIMENT_1 = Setup(
    Duhem(0.4, 0.5, 0.25, **_NAMED), GrowingSine(1.0, _ONE_RADIAN), 7 * np.pi
)
EXPERIMENT_2 = Setup(
    BoucWen(5.0, 0.25, 0.5, **_NAMED), Sine(1.0, _ONE_RADIAN), 10 * np.pi
)
EXPERIMENT_4 = Setup(
    Duhem(0.4, 0.5, 0.25, **_NAMED), Sine(1.0, _ONE_RADIAN), 20 * np.pi
)
EXPERIMENT_5 = Setup(
    Duhem(1.0, 0.25, 20.0, **_NAMED), GrowingSine(1.0, _ONE_RADIAN), 20 * np.pi
)
EXPERIMENT_7 = Setup(
    Duhem(0.4, 0.85, 0.2, **_NAMED), Sine(4.0, _ONE_RADIAN), 10 * np.pi
)
ASYMMETRIC = Setup(  # beside experiment 7
    Duhem((0.6, 0.4), 0.85, 0.2, **_NAMED), Sine(4.0, _ONE_RADIAN), 10 * np.pi
)


def experiment_3_setup(samples: int) -> Setup:
    """Experiment 3 with so many samples."""
    law = BoucWen(1.0, 0.5, 2.0, **_NAMED)
    return Setup(law, Sine(1.0, _ONE_RADIAN), 20 * np.pi, samples)


def duhem_growing_sine() -> Recording:
    """Experiment 1: w' = 0.4 |u'| u - 0.5 |u'| w + 0.25 u', u = t sin t, 1000 samples
    to 7 pi s, w(0) = 0."""
    return EXPERIMENT_1.record()


def with_output(record: Recording, w) -> Recording:
    """The record with another output under the same input."""
    return eqx.tree_at(lambda recording: recording.w, record, w)


def noisy_as_published(record: Recording, level: float) -> Recording:
    """The output times 1 + level e, e normal from NumPy's legacy generator seeded with
    29, as in the scripts of experiment 4."""
    errors = np.random.RandomState(29).randn(len(record))
    return with_output(record, record.w * (1 + level * errors))


def fitted_and_held_out(samples: int) -> tuple[np.ndarray, np.ndarray]:
    """Rows that the scripts fit linear regression and networks on, and the quarter that
    they hold out: at random, in the manner of scikit-learn with random state 42."""
    order = np.random.RandomState(42).permutation(samples)
    held_out = -(-samples // 4)
    return order[held_out:], order[:held_out]


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
_SUBSTEPS = 8  # of refinement: closer than the data of simulated records ask for


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
    settings: dict[str, Any] = {
        "free_start": False,
        "substeps": _SUBSTEPS,
        "throw": False,
    } | how
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
