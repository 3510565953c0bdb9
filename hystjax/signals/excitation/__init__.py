"""Exact excitations: inputs known as functions of time, smooth or piecewise linear."""

from ._waves import (
    AbstractExcitation as AbstractExcitation,
    AbstractPiecewiseLinear as AbstractPiecewiseLinear,
    AbstractSmooth as AbstractSmooth,
    Chirp as Chirp,
    DecayingSine as DecayingSine,
    FirstOrderReversalCurves as FirstOrderReversalCurves,
    GrowingSine as GrowingSine,
    ModulatedSine as ModulatedSine,
    Multisine as Multisine,
    Sine as Sine,
    Triangle as Triangle,
)
