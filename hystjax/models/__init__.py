"""Laws of hysteresis: learned ones and classical ones, behind one interface."""

from ..library import AbstractMemory as AbstractMemory, NoMemory as NoMemory
from ..saving import register as register
from ._around import (
    Behind as Behind,
    Butterfly as Butterfly,
    Instrumented as Instrumented,
    Started as Started,
    comes_late as comes_late,
    sees as sees,
)
from ._base import (
    AbstractLaw as AbstractLaw,
    AbstractModel as AbstractModel,
    AbstractOperatorLaw as AbstractOperatorLaw,
    AbstractSum as AbstractSum,
    Beyond as Beyond,
    FittedRange as FittedRange,
    Leg as Leg,
    check_answers as check_answers,
    equation as equation,
)
from ._classical import (
    BoucWen as BoucWen,
    ColemanHodgdon as ColemanHodgdon,
    Duhem as Duhem,
    Tellinen as Tellinen,
)
from ._forces import (
    BoucWenBaberNoori as BoucWenBaberNoori,
    BoucWenForce as BoucWenForce,
    Dahl as Dahl,
    LuGre as LuGre,
    MaxwellSlip as MaxwellSlip,
    RambergOsgood as RambergOsgood,
)
from ._hybrid import Hybrid as Hybrid
from ._jiles_atherton import (
    AbstractAnhysteretic as AbstractAnhysteretic,
    InverseJilesAtherton as InverseJilesAtherton,
    JilesAtherton as JilesAtherton,
    Langevin as Langevin,
    Uniaxial as Uniaxial,
)
from ._numbers import field_parameters as field_parameters
from ._oscillator import (
    AbstractMachine as AbstractMachine,
    BoucWenOscillator as BoucWenOscillator,
    Oscillator as Oscillator,
)
from ._preisach import (
    Envelope as Envelope,
    Everett as Everett,
    PrandtlIshlinskii as PrandtlIshlinskii,
    Preisach as Preisach,
)
from ._sequence import (
    AbstractSequenceModel as AbstractSequenceModel,
    as_model as as_model,
)
from ._serialise import load as load, save as save
from ._sparse import SparseModel as SparseModel, compacted as compacted

# The other names are for the folders that build on this one.
__all__ = [
    "AbstractAnhysteretic",
    "AbstractLaw",
    "AbstractMachine",
    "AbstractMemory",
    "AbstractModel",
    "AbstractOperatorLaw",
    "AbstractSequenceModel",
    "Behind",
    "BoucWen",
    "BoucWenBaberNoori",
    "BoucWenForce",
    "BoucWenOscillator",
    "Butterfly",
    "ColemanHodgdon",
    "Dahl",
    "Duhem",
    "Envelope",
    "Everett",
    "Hybrid",
    "Instrumented",
    "InverseJilesAtherton",
    "JilesAtherton",
    "Langevin",
    "LuGre",
    "MaxwellSlip",
    "NoMemory",
    "Oscillator",
    "PrandtlIshlinskii",
    "Preisach",
    "RambergOsgood",
    "SparseModel",
    "Started",
    "Tellinen",
    "Uniaxial",
    "load",
    "register",
    "save",
]


def __dir__() -> list[str]:
    return __all__
