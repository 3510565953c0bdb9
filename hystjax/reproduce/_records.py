"""The simulated records of the paper, integrated by hystjax, and its random choices."""

from dataclasses import dataclass

import equinox as eqx
import jax
import numpy as np

from .._generate import generate
from .._recording import Recording
from ..excitation import AbstractExcitation, GrowingSine, Sine
from ..models import AbstractModel, BoucWen, Duhem

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


def bouc_wen_sine() -> Recording:
    """Experiment 2: w' = 5 u' - 0.25 |u'| w - 0.5 u' |w|, u = sin t, 1000 samples to
    10 pi s, w(0) = 0."""
    return EXPERIMENT_2.record()


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
