"""Laws of plays, stops and lags on two measured devices, judged on what they were not
fitted on."""

from collections.abc import Sequence
from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np

from ..library import Lag, Library, Stop, Term
from ..models import SparseModel
from ..recording import Recording, datasets
from ..refinement import refine
from ..regression import LeastSquares, identify
from ..regression.formulation import Direct
from ..simulation import metrics, simulate
from ._document import AbstractDocument, shown

_RADII = (0.1, 0.17)  # in: to start from
_PLAYS = (0.02, 0.04, 0.07, 0.1, 0.15, 0.2, 0.27, 0.35, 0.42)  # over the input's range
_CREEP = (0.3, 5.0)  # s
_TIMES = (0.01, 0.03, 0.05, 0.1)  # s
_START_UP = 400  # rows, 2 s, in which the device settles from a past that is not known
_CONSTANT = Library((Term(),))
_NOTES = (
    "friction_damper: w = c + sum of a stop(u, r) + b stop(u, r)^3, two springs that "
    "slide, each with a static curve; seven numbers, the radii refined. The error is "
    "the mean of the recordings' NRMSE, % of the range of each.",
    "piezo_yan9a: a cubic of the input and nine plays, all behind one lag, and lags of "
    "0.3 and 5 s of the input beside them; one linear fit to the first half but for "
    "the start, in which the device settles. RMSE in µm.",
)


@dataclass(frozen=True)
class Remembered:
    """A law on one device.

    **Attributes:** the `device`; what was `fitted`; the number of `numbers`; the errors
    on what was fitted (`own`) and on the rest (`unseen`, `None` for no rest); and the
    `law`.
    """

    device: str
    fitted: str
    numbers: int
    own: float
    unseen: float | None
    law: str


@dataclass(frozen=True)
class MemoryTable(AbstractDocument):
    """Laws that remember."""

    rows: tuple[Remembered, ...]

    def cells(self):
        """Headings, and a line a law."""
        rows = [
            (r.device, r.fitted, str(r.numbers), shown(r.own, 3), shown(r.unseen, 3))
            for r in self.rows
        ]
        return [("device", "fitted on", "numbers", "own", "unseen"), *rows]


def memory() -> MemoryTable:
    """Laws of plays, stops and lags for the friction damper and a piezo."""
    title = "Signals with memory in laws of the value"
    return MemoryTable(title, (*_damper(), *_piezo()), _NOTES)


def _damper():
    name = "friction_damper"
    records = {each: datasets.load(name, each) for each in datasets.records(name)}
    small = [each for each in records if each.endswith("0.5in")]
    large = [each for each in records if each not in small]
    wholes = {"all four": list(records), "0.5 in": small, "1 in": large}
    for fitted, names in wholes.items():
        law = _sliding([records[each] for each in names])
        errors = {
            each: 100 * float(metrics.nrmse(record.w, simulate(law, record).w))
            for each, record in records.items()
        }
        own = float(np.mean([errors[each] for each in names]))
        rest = [error for each, error in errors.items() if each not in names]
        unseen = float(np.mean(rest)) if rest else None
        count = len(law.parameters())
        yield Remembered(name, fitted, count, own, unseen, str(law))


def _sliding(records: Sequence[Recording]) -> SparseModel:
    """Stops and their cubes, by regression and then with radii that are fitted."""
    library = _CONSTANT
    for radius in _RADII:
        stop = Stop([radius])
        library = library + stop + stop * stop * stop
    start = identify(records, library, LeastSquares(), formulation=Direct()).value
    # Each recording counts by its own range, as it is judged.
    weights = [
        jnp.full(len(each), 1 / (float(jnp.ptp(each.w)) ** 2 * len(each)))
        for each in records
    ]
    return refine(start, records, weights=weights).value


def _piezo():
    first, second = datasets.load("piezo_yan9a").split(0.5)
    first = first.window(_START_UP, len(first))
    span = float(jnp.ptp(first.u))
    for time in _TIMES:
        fast = Lag([time])
        library = _CONSTANT + fast + fast * fast + fast * fast * fast
        for share in _PLAYS:
            library = library + Lag([time], of=f"play(u,{span * share!r})")
        library = library + Lag(_CREEP)
        law = identify(first, library, LeastSquares(), formulation=Direct()).value
        own, unseen = (
            float(metrics.rmse(each.w, simulate(law, each).w))
            for each in (first, second)
        )
        fitted = f"2 s to 20 s, lag of {1000 * time:g} ms"
        yield Remembered("piezo_yan9a", fitted, len(library), own, unseen, str(law))
