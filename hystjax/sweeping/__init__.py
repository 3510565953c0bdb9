"""Sweeps: what they go over, and how their lanes are run, kept and labelled."""

from ._space import (
    AbstractSpace as AbstractSpace,
    Axis as Axis,
    Grid as Grid,
    LogUniform as LogUniform,
    Samples as Samples,
    Uniform as Uniform,
)
from ._store import (
    AbstractStore as AbstractStore,
    Folder as Folder,
    Memory as Memory,
    begun as begun,
    kept_chunk as kept_chunk,
    opened as opened,
    tidied as tidied,
)
from ._sweep import (
    Lane as Lane,
    Program as Program,
    inputs as inputs,
    planned as planned,
    sweep as sweep,
)
from ._variables import Variable as Variable, dataset as dataset, variables as variables

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
