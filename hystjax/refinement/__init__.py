"""Refinement by trajectory matching: losses, shooting, certainty, fading."""

from ..recording._as_measured import Weights as Weights, weights_of as weights_of
from ._certainty import (
    Certainty as Certainty,
    Refined as Refined,
    autocorrelation as autocorrelation,
    certainty as certainty,
    deviations as deviations,
    known_covariance as known_covariance,
    known_to as known_to,
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
    Parameters as Parameters,
    SingleShooting as SingleShooting,
    Squares as Squares,
    parameters as parameters,
)
from ._objective import (
    Fading as Fading,
    Objective as Objective,
    Run as Run,
    Samples as Samples,
    Unknowns as Unknowns,
    exponents as exponents,
    fading as fading,
    first_unknowns as first_unknowns,
    free_of as free_of,
    samples as samples,
    signals as signals,
)
from ._refine import Bootstrap as Bootstrap, bootstrap as bootstrap, refine as refine
from ._solve import (
    LevenbergMarquardt as LevenbergMarquardt,
    Minimum as Minimum,
    minimise as minimise,
    watched as watched,
)

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
