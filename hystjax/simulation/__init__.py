"""To simulate a model: ways to do so, the verb, and how good a model is."""

from ._simulate import (
    Judgement as Judgement,
    Trajectory as Trajectory,
    generate as generate,
    judge as judge,
    last_period as last_period,
    simulate as simulate,
)
from ._steps import (
    AbstractSimulation as AbstractSimulation,
    Adaptive as Adaptive,
    Automatic as Automatic,
    FixedStep as FixedStep,
    first_state as first_state,
    flow as flow,
    flows as flows,
    from_start as from_start,
    march as march,
    outputs as outputs,
    step as step,
    trajectory as trajectory,
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
