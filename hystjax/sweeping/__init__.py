"""Sweeps: what they go over, and how their lanes are run, kept and labelled."""

from ._lanes import (
    AbstractSpace as AbstractSpace,
    Axis as Axis,
    Grid as Grid,
    LogUniform as LogUniform,
    Samples as Samples,
    Uniform as Uniform,
    Variable as Variable,
    dataset as dataset,
    variables as variables,
)
from ._sweep import (
    AbstractStore as AbstractStore,
    Folder as Folder,
    Lane as Lane,
    Memory as Memory,
    Program as Program,
    begun as begun,
    inputs as inputs,
    kept_chunk as kept_chunk,
    opened as opened,
    planned as planned,
    sweep as sweep,
    tidied as tidied,
)

# The other names are for the folders that build on this one.
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
