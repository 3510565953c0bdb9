"""Ways to simulate a model."""

from ._adaptive import Adaptive as Adaptive
from ._automatic import Automatic as Automatic
from ._base import AbstractSimulation as AbstractSimulation
from ._fixed_step import (
    FixedStep as FixedStep,
    flow as flow,
    outputs as outputs,
    step as step,
    stepped as stepped,
    trajectory as trajectory,
)
from ._march import from_start as from_start, march as march
