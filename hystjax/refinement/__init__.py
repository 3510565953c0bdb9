"""Refinement by trajectory matching: losses, shooting, certainty, fading."""

from ..recording._weights import Weights as Weights, weights_of as weights_of
from ._bootstrap import Bootstrap as Bootstrap, bootstrap as bootstrap
from ._certainty import (
    Certainty as Certainty,
    autocorrelation as autocorrelation,
    certainty as certainty,
    linearised as linearised,
    ljung_box as ljung_box,
    statements as statements,
)
from ._choices import (
    AbstractLoss as AbstractLoss,
    AbstractShooting as AbstractShooting,
    Cauchy as Cauchy,
    Huber as Huber,
    MultipleShooting as MultipleShooting,
    Nudging as Nudging,
    SingleShooting as SingleShooting,
    Squares as Squares,
)
from ._marquardt import LevenbergMarquardt as LevenbergMarquardt, watched as watched
from ._objective import (
    Fading as Fading,
    Objective as Objective,
    Run as Run,
    Unknowns as Unknowns,
    exponents as exponents,
    fading as fading,
    first_unknowns as first_unknowns,
)
from ._parameters import Parameters as Parameters, parameters as parameters
from ._refine import refine as refine
from ._samples import (
    Samples as Samples,
    samples as samples,
    signals as signals,
)
from ._solve import Minimum as Minimum, minimise as minimise

# The other names are for the folders that build on this one.
__all__ = [
    "AbstractLoss",
    "AbstractShooting",
    "Bootstrap",
    "Cauchy",
    "Certainty",
    "Fading",
    "Huber",
    "LevenbergMarquardt",
    "MultipleShooting",
    "Nudging",
    "SingleShooting",
    "Squares",
    "bootstrap",
    "refine",
    "statements",
]


def __dir__() -> list[str]:
    return __all__
