"""What drives a device: the input between its samples, as a path, and exact inputs."""

from .interpolation import (
    AbstractInputPath as AbstractInputPath,
    AbstractInterpolation as AbstractInterpolation,
    BandLimited as BandLimited,
    Cubic as Cubic,
    Exact as Exact,
    FunctionPath as FunctionPath,
    Grid as Grid,
    Linear as Linear,
    PiecewisePolynomial as PiecewisePolynomial,
    Signals as Signals,
    StraightLines as StraightLines,
    check_within as check_within,
)
