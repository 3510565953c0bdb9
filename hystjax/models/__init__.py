"""Laws of hysteresis: learned ones and classical ones, behind one interface."""

from ..library import AbstractMemory as AbstractMemory, NoMemory as NoMemory
from ..saving import register as register
from ._anhysteretic import (
    AbstractAnhysteretic as AbstractAnhysteretic,
    Langevin as Langevin,
    Uniaxial as Uniaxial,
)
from ._arguments import as_model as as_model
from ._base import (
    AbstractLaw as AbstractLaw,
    AbstractModel as AbstractModel,
    AbstractOperatorLaw as AbstractOperatorLaw,
)
from ._bouc_wen_family import (
    BoucWenBaberNoori as BoucWenBaberNoori,
    BoucWenForce as BoucWenForce,
)
from ._branches import ColemanHodgdon as ColemanHodgdon, Tellinen as Tellinen
from ._butterfly import Butterfly as Butterfly
from ._classical import BoucWen as BoucWen, Duhem as Duhem
from ._equations import equation as equation
from ._friction import Dahl as Dahl, LuGre as LuGre, MaxwellSlip as MaxwellSlip
from ._hybrid import Hybrid as Hybrid
from ._instrumented import Instrumented as Instrumented, comes_late as comes_late
from ._jiles_atherton import (
    InverseJilesAtherton as InverseJilesAtherton,
    JilesAtherton as JilesAtherton,
)
from ._named import field_parameters as field_parameters
from ._oscillator import (
    BoucWenOscillator as BoucWenOscillator,
    Oscillator as Oscillator,
)
from ._prandtl_ishlinskii import (
    Envelope as Envelope,
    PrandtlIshlinskii as PrandtlIshlinskii,
)
from ._preisach import Everett as Everett, Preisach as Preisach
from ._ramberg_osgood import RambergOsgood as RambergOsgood
from ._range import Beyond as Beyond, FittedRange as FittedRange
from ._sequence import AbstractSequenceModel as AbstractSequenceModel
from ._serialise import load as load, save as save
from ._sparse import SparseModel as SparseModel, compacted as compacted
from ._started import Started as Started

# The other names are for the folders that build on this one.
__all__ = [
    "AbstractAnhysteretic",
    "AbstractLaw",
    "AbstractMemory",
    "AbstractModel",
    "AbstractOperatorLaw",
    "AbstractSequenceModel",
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
