"""Sweeps: what they go over, and how their lanes are run, kept and labelled."""

from ._lanes import (
    AbstractSpace as AbstractSpace,
    Axis as Axis,
    Grid as Grid,
    LogUniform as LogUniform,
    Samples as Samples,
    Uniform as Uniform,
)
from ._sweep import sweep as sweep

__all__ = [
    "AbstractSpace",
    "Axis",
    "Grid",
    "LogUniform",
    "Samples",
    "Uniform",
    "sweep",
]


def __dir__() -> list[str]:
    return __all__
