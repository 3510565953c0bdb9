"""Candidate libraries: terms, the variables they are made of, and their memory."""

from ._joint import Operators as Operators, followed as followed
from ._library import (
    BoucWen as BoucWen,
    Custom as Custom,
    Duhem as Duhem,
    Fourier as Fourier,
    Lag as Lag,
    Library as Library,
    LogCreep as LogCreep,
    Play as Play,
    Polynomial as Polynomial,
    Stop as Stop,
    check_functions as check_functions,
    check_library as check_library,
    operators_of as operators_of,
    variables_of as variables_of,
)
from ._memory import (
    AbstractMemory as AbstractMemory,
    NoMemory as NoMemory,
    Track as Track,
    at as at,
    sampled as sampled,
)
from ._operators import (
    AbstractOperator as AbstractOperator,
    operator_named as operator_named,
    within as within,
)
from ._parallel import (
    Plays as Plays,
    Relays as Relays,
    Staircase as Staircase,
    Weighted as Weighted,
    check_initial as check_initial,
)
from ._term import Kind as Kind, Term as Term, kind as kind
from ._variable import (
    VARIABLES as VARIABLES,
    AbstractVariable as AbstractVariable,
    Values as Values,
)

# The other names are for the folders that build on this one.
__all__ = [
    "VARIABLES",
    "AbstractMemory",
    "AbstractOperator",
    "AbstractVariable",
    "BoucWen",
    "Custom",
    "Duhem",
    "Fourier",
    "Kind",
    "Lag",
    "Library",
    "LogCreep",
    "NoMemory",
    "Play",
    "Plays",
    "Polynomial",
    "Relays",
    "Staircase",
    "Stop",
    "Term",
    "Values",
]


def __dir__() -> list[str]:
    return __all__
