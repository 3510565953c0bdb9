"""Laws of hysteresis: learned ones and classical ones, behind one interface."""

from ..library import AbstractMemory as AbstractMemory, NoMemory as NoMemory
from ..saving import register as register
from ._base import (
    AbstractLaw as AbstractLaw,
    AbstractModel as AbstractModel,
    equation as equation,
    field_parameters as field_parameters,
)
from ._butterfly import Butterfly as Butterfly
from ._classical import BoucWen as BoucWen, Duhem as Duhem
from ._instrumented import Instrumented as Instrumented
from ._oscillator import BoucWenOscillator as BoucWenOscillator
from ._prandtl_ishlinskii import (
    Envelope as Envelope,
    PrandtlIshlinskii as PrandtlIshlinskii,
)
from ._preisach import Everett as Everett, Preisach as Preisach
from ._sequence import AbstractSequenceModel as AbstractSequenceModel
from ._serialise import load as load, save as save
from ._sparse import SparseModel as SparseModel, compacted as compacted
from ._started import Started as Started
