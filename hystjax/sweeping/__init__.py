"""What a sweep goes over, and how its lanes are run, kept and labelled."""

from ._dataset import dataset as dataset
from ._inputs import inputs as inputs
from ._program import Lane as Lane, Program as Program, planned as planned
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
    kept_chunk as kept_chunk,
    opened as opened,
    tidied as tidied,
)
from ._variables import Variable as Variable, variables as variables
