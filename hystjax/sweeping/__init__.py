"""What a sweep goes over, and how its lanes are run, kept and labelled."""

from ._dataset import dataset as dataset
from ._inputs import inputs as inputs
from ._program import Lane as Lane, Program as Program, planned as planned
from ._ranges import LogUniform as LogUniform, Uniform as Uniform
from ._space import (
    AbstractSpace as AbstractSpace,
    Axis as Axis,
    Grid as Grid,
    Samples as Samples,
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
from ._variables import Variable as Variable, variables as variables
