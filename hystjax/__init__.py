"""hystjax: small, readable laws for hysteresis in measured data."""

__version__ = "0.1.0"

from . import (
    _threads as _threads,
    datasets as datasets,
    differentiation as differentiation,
    excitation as excitation,
    export as export,
    formulation as formulation,
    interpolation as interpolation,
    library as library,
    metrics as metrics,
    models as models,
    properties as properties,
    refinement as refinement,
    regression as regression,
    search as search,
    simulation as simulation,
    sweeping as sweeping,
    weighting as weighting,
)
from ._aliases import aliases as aliases
from ._bootstrap import Bootstrap as Bootstrap, bootstrap as bootstrap
from ._discover import discover as discover
from ._discover_hidden import discover_hidden as discover_hidden
from ._errors import ComputationError as ComputationError, InputError as InputError
from ._generate import generate as generate
from ._identify import identify as identify
from ._inclusion import inclusion as inclusion
from ._judge import Judgement as Judgement, judge as judge
from ._long_recording import LongRecording as LongRecording
from ._outliers import Outliers as Outliers, outliers as outliers
from ._recording import Recording as Recording
from ._refine import refine as refine
from ._serialise import load as load, save as save
from ._simulate import Trajectory as Trajectory, simulate as simulate
from ._solution import RESULTS as RESULTS, Solution as Solution
from ._stability import Stability as Stability, stability as stability
from ._suggest import (
    Suggestion as Suggestion,
    suggest_excitation as suggest_excitation,
)
from ._sweep import sweep as sweep
from .regression import Alias as Alias


def __getattr__(name: str):
    # Matplotlib takes as long to import as the rest: only those who plot pay.
    if name in ("plot", "report", "reproduce"):
        import importlib

        return importlib.import_module(f".{name}", __name__)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
