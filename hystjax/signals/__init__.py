"""What drives a device: the input between its samples, as a path, and exact inputs."""

from ._path import (
    AbstractInputPath as AbstractInputPath,
    Grid as Grid,
    Signals as Signals,
)
from .interpolation import (
    AbstractInterpolation as AbstractInterpolation,
    BandLimited as BandLimited,
    Cubic as Cubic,
    Exact as Exact,
    FunctionPath as FunctionPath,
    Linear as Linear,
    PiecewisePolynomial as PiecewisePolynomial,
)
