"""Ways to simulate a model."""

from ._adaptive import Adaptive as Adaptive
from ._base import AbstractSimulation as AbstractSimulation
from ._fixed_step import (
    FixedStep as FixedStep,
    flow as flow,
    from_start as from_start,
    march as march,
    outputs as outputs,
    step as step,
)
