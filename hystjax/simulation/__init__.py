"""Ways to simulate a law."""

from ._adaptive import Adaptive as Adaptive
from ._base import AbstractSimulation as AbstractSimulation
from ._fixed_step import (
    FixedStep as FixedStep,
    Grid as Grid,
    advance as advance,
    march as march,
)
