"""The input between samples: linear, cubic, band-limited, or an exact function."""

from ._exact import FunctionPath as FunctionPath
from ._interpolations import (
    AbstractInterpolation as AbstractInterpolation,
    BandLimited as BandLimited,
    Cubic as Cubic,
    Exact as Exact,
    Linear as Linear,
)
from ._path import AbstractInputPath as AbstractInputPath
from ._piecewise import PiecewisePolynomial as PiecewisePolynomial
from ._signals import Grid as Grid, Signals as Signals
