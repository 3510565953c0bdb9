"""Exact excitations: inputs known as functions of time, smooth or piecewise linear."""

from ._excitation import (
    AbstractExcitation as AbstractExcitation,
    AbstractPiecewiseLinear as AbstractPiecewiseLinear,
    AbstractSmooth as AbstractSmooth,
)
from ._piecewise import (
    FirstOrderReversalCurves as FirstOrderReversalCurves,
    Triangle as Triangle,
)
from ._sines import (
    DecayingSine as DecayingSine,
    GrowingSine as GrowingSine,
    ModulatedSine as ModulatedSine,
    Sine as Sine,
)
from ._sweeps import Chirp as Chirp, Multisine as Multisine
