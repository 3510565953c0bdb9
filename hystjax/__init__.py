"""hystjax: small, readable laws for hysteresis in measured data."""

__version__ = "0.1.0"

from typing import TYPE_CHECKING

from . import _core as _core

# What is imported stays: to look through it for garbage, over and over as it grows,
# takes 5 to 10 % of the time.
with _core.uncollected():
    from . import (
        library as library,
        models as models,
        refinement as refinement,
        regression as regression,
        simulation as simulation,
    )
    from ._core.checks import (
        ComputationError as ComputationError,
        InputError as InputError,
    )
    from ._core.solution import RESULTS as RESULTS, Solution as Solution
    from .models import load as load, save as save
    from .recording import (
        LongRecording as LongRecording,
        Outliers as Outliers,
        Recording as Recording,
        bridged as bridged,
        datasets as datasets,
        doubts as doubts,
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

# What a law is not fitted or simulated by is imported when it is asked for. Matplotlib
# alone takes as long as all the rest.
_LATER = {
    "comparison": ("Comparison", "compare"),
    "compensation": ("Tracking", "control"),
    "discovery": (
        "Offer",
        "Suggestion",
        "complete",
        "discover",
        "inclusion",
        "search",
        "suggest_excitation",
    ),
    "export": (),
    "inversion": ("Inverse", "invert"),
    "loops": (),
    "plot": (),
    "report": (),
    "reproduce": (),
    "sweeping": ("sweep",),
}
_HOMES = {name: folder for folder, names in _LATER.items() for name in names}

if TYPE_CHECKING:
    from . import (
        comparison as comparison,
        compensation as compensation,
        discovery as discovery,
        export as export,
        inversion as inversion,
        loops as loops,
        plot as plot,
        report as report,
        reproduce as reproduce,
        sweeping as sweeping,
    )
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
    from .sweeping import sweep as sweep


def __dir__() -> list[str]:
    own = {name for name in globals() if name != "TYPE_CHECKING"}
    return sorted({*own, *_LATER, *_HOMES})


def __getattr__(name: str):
    import importlib

    if name in _LATER:
        return importlib.import_module(f".{name}", __name__)
    if name in _HOMES:
        folder = importlib.import_module(f".{_HOMES[name]}", __name__)
        return getattr(folder, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
