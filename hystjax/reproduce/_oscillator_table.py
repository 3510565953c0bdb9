"""What the study of the Bouc-Wen benchmark found, as tables."""

from dataclasses import dataclass

import numpy as np

from ..models import BoucWenOscillator
from ..report import plain_table

NOISE = 7.4e-6  # m rms, on every sample of the record
_SYMBOLS = ("m", "c", "k", "alpha", "beta", "gamma", "n")


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
class OscillatorTable:
    """Starts `off` by so much, relative, with the exponent n known and with n free."""

    known: Identified
    free: Identified
    off: float

    def text(self) -> str:
        """The tables for a terminal."""
        return "\n".join(
            [
                "Bouc-Wen benchmark: the oscillator from random starts up to "
                f"{100 * self.off:.0f} % off in every parameter",
                "",
                "n = 1 known",
                plain_table(_cells(self.known)),
                "",
                "n free",
                plain_table(_cells(self.free)),
                "",
                "m to n: errors of the parameters, %. Root mean squares in 1e-6 m: "
                "free run minus",
                "measured output on the three periods fitted and on the fourth, noise "
                f"{1e6 * NOISE:.1f}; and free run",
                "minus that of the true oscillator, without noise, on the multisine "
                "and on a sine sweep.",
            ]
        )


def _cells(run: Identified) -> list[list[str]]:
    head = ["start", *_SYMBOLS, "fitted", "unseen", "multisine", "sweep", ""]
    rows = [head]
    for i, good in enumerate(run.converged):
        errors = [f"{100 * error[i]:.2f}" for error in run.errors.values()]
        distances = (run.fitted, run.unseen, run.multisine, run.sweep)
        sizes = [f"{1e6 * distance[i]:.3g}" for distance in distances]
        said = "converged" if good else "did not converge"
        rows.append([str(i + 1), *errors, *sizes, said])
    return rows
