"""hystjax: small, readable laws for hysteresis in measured data."""

__version__ = "0.1.0"

from . import (
    _core as _core,
    comparison as comparison,
    compensation as compensation,
    export as export,
    inversion as inversion,
    library as library,
    loops as loops,
    models as models,
    refinement as refinement,
    regression as regression,
    simulation as simulation,
    sweeping as sweeping,
)
from ._core.checks import ComputationError as ComputationError, InputError as InputError
from ._core.solution import RESULTS as RESULTS, Solution as Solution
from .comparison import Comparison as Comparison, compare as compare
from .compensation import Tracking as Tracking, control as control
from .discovery import (
    Offer as Offer,
    Suggestion as Suggestion,
    complete as complete,
    discover as discover,
    inclusion as inclusion,
    search as search,
    suggest_excitation as suggest_excitation,
)
from .inversion import Inverse as Inverse, invert as invert
from .models import load as load, save as save
from .recording import (
    LongRecording as LongRecording,
    Outliers as Outliers,
    Recording as Recording,
    bridged as bridged,
    datasets as datasets,
    outliers as outliers,
    steady as steady,
)
from .refinement import (
    Bootstrap as Bootstrap,
    bootstrap as bootstrap,
    refine as refine,
)
from .regression import (
    Alias as Alias,
    Stability as Stability,
    differentiation as differentiation,
    formulation as formulation,
    identify as identify,
    stability as stability,
    weighting as weighting,
)
from .regression._identify import aliases as aliases
from .signals import excitation as excitation, interpolation as interpolation
from .simulation import (
    Judgement as Judgement,
    Trajectory as Trajectory,
    generate as generate,
    judge as judge,
    metrics as metrics,
    properties as properties,
    simulate as simulate,
)
from .sweeping import sweep as sweep

# Matplotlib takes as long to import as the rest: only those who plot pay.
_LATER = ("plot", "report", "reproduce")


def __dir__() -> list[str]:
    return sorted({*globals(), *_LATER})


def __getattr__(name: str):
    if name in _LATER:
        import importlib

        return importlib.import_module(f".{name}", __name__)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
