"""To simulate a model: ways to do so, the verb, and how good a model is."""

from ._adaptive import Adaptive as Adaptive, Automatic as Automatic
from ._fixed_step import (
    AbstractSimulation as AbstractSimulation,
    FixedStep as FixedStep,
    first_state as first_state,
    flow as flow,
    from_start as from_start,
    march as march,
    outputs as outputs,
    step as step,
    trajectory as trajectory,
)
from ._simulate import (
    Judgement as Judgement,
    Trajectory as Trajectory,
    generate as generate,
    judge as judge,
    simulate as simulate,
)

# The other names are for the folders that build on this one.
__all__ = [
    "AbstractSimulation",
    "Adaptive",
    "Automatic",
    "FixedStep",
    "Judgement",
    "Trajectory",
    "generate",
    "judge",
    "simulate",
    "step",
]


def __dir__() -> list[str]:
    return __all__
