"""The simulated records of the paper, integrated by hystjax."""

import numpy as np

from .._generate import generate
from .._recording import Recording
from ..excitation import GrowingSine, Sine
from ..models import BoucWen, Duhem

_ONE_RADIAN = 1 / (2 * np.pi)  # Hz: sin t
_UNITS = ("V", "µm")
_NAMES = ("voltage", "displacement")


def duhem_growing_sine() -> Recording:
    """Experiment 1: w' = 0.4 |u'| u - 0.5 |u'| w + 0.25 u', u = t sin t, 1000 samples
    to 7 pi s, w(0) = 0."""
    law = Duhem(0.4, 0.5, 0.25, names=_NAMES, units=_UNITS)
    t = np.linspace(0, 7 * np.pi, 1000)
    return generate(law, GrowingSine(1.0, _ONE_RADIAN), t)


def bouc_wen_sine() -> Recording:
    """Experiment 2: w' = 5 u' - 0.25 |u'| w - 0.5 u' |w|, u = sin t, 1000 samples to
    10 pi s, w(0) = 0."""
    law = BoucWen(5.0, 0.25, 0.5, names=_NAMES, units=_UNITS)
    t = np.linspace(0, 10 * np.pi, 1000)
    return generate(law, Sine(1.0, _ONE_RADIAN), t)
