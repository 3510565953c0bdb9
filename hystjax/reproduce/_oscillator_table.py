"""What the study of the Bouc-Wen benchmark found, as tables."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from ..models import BoucWenOscillator
from ._document import AbstractDocument, shown

NOISE = 7.4e-6  # m rms, on every sample of the record
_SYMBOLS = ("m", "c", "k", "alpha", "beta", "gamma", "n")
_DISTANCES = ("fitted", "unseen", "multisine", "sweep")
_HEADINGS = ("run", "start", *_SYMBOLS, *_DISTANCES, "")
_NOTE = (
    "m to n: errors of the parameters, %. Root mean squares in 1e-6 m: free run minus "
    "measured output on the three periods fitted and on the fourth, noise "
    f"{1e6 * NOISE:.1f}; and free run minus that of the true oscillator, without "
    "noise, on the multisine and on a sine sweep."
)


@dataclass(frozen=True)
class Identified:
    """Oscillators found from several starts, all arrays of shape (starts,).

    **Attributes:**

    - `model`: the oscillators, a batch.
    - `converged`: whether the fit said so.
    - `errors`: of the parameters, relative, by name.
    - `fitted`, `unseen`: root mean square of free run minus measured output on the
        periods fitted, and on the other one, m.
    - `multisine`, `sweep`: root mean square distance of free runs from those of the
        true oscillator, without noise, m.
    """

    model: BoucWenOscillator
    converged: np.ndarray
    errors: dict[str, np.ndarray]
    fitted: np.ndarray
    unseen: np.ndarray
    multisine: np.ndarray
    sweep: np.ndarray

    @property
    def worst(self) -> np.ndarray:
        """Largest error of a parameter."""
        return np.max(np.abs(list(self.errors.values())), axis=0)


@dataclass(frozen=True)
class Start:
    """One start: of which run, its number, and what came of it, as in `Identified`."""

    run: str
    start: int
    converged: bool
    errors: dict[str, float]
    fitted: float
    unseen: float
    multisine: float
    sweep: float


@dataclass(frozen=True)
class OscillatorTable(AbstractDocument):
    """A row a start, and the `runs`, by name, that they are of."""

    rows: tuple[Start, ...]
    runs: Mapping[str, Identified] = field(default_factory=dict)

    def cells(self):
        """Headings, and a line a start."""
        return [_HEADINGS, *map(_cells, self.rows)]


def tabled(runs: Mapping[str, Identified], off: float) -> OscillatorTable:
    """The runs as a table; their starts were `off` by so much, relative."""
    title = (
        "Bouc-Wen benchmark: the oscillator from random starts up to "
        f"{100 * off:.0f} % off in every parameter"
    )
    rows = (_start(name, run, i) for name, run in runs.items() for i in _starts(run))
    return OscillatorTable(title, tuple(rows), (_NOTE,), runs=runs)


def _starts(run: Identified) -> range:
    return range(len(run.converged))


def _start(name: str, run: Identified, i: int) -> Start:
    errors = {symbol: float(error[i]) for symbol, error in run.errors.items()}
    distances = (float(getattr(run, kind)[i]) for kind in _DISTANCES)
    return Start(name, i + 1, bool(run.converged[i]), errors, *distances)


def _cells(row: Start) -> list[str]:
    errors = [f"{100 * error:.2f}" for error in row.errors.values()]
    sizes = [shown(1e6 * getattr(row, kind), 3) for kind in _DISTANCES]
    said = "converged" if row.converged else "did not converge"
    return [row.run, str(row.start), *errors, *sizes, said]
