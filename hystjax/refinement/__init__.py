"""Parts of refinement by trajectory matching: losses, shooting, certainty, fading."""

from ._certainty import (
    Certainty as Certainty,
    autocorrelation as autocorrelation,
    certainty as certainty,
    linearised as linearised,
    ljung_box as ljung_box,
)
from ._fading import (
    Fading as Fading,
    exponents as exponents,
    fading as fading,
)
from ._losses import (
    AbstractLoss as AbstractLoss,
    Cauchy as Cauchy,
    Huber as Huber,
    Squares as Squares,
)
from ._marquardt import LevenbergMarquardt as LevenbergMarquardt
from ._objective import (
    Objective as Objective,
    Run as Run,
    Unknowns as Unknowns,
    first_unknowns as first_unknowns,
)
from ._parameters import Parameters as Parameters, parameters as parameters
from ._progress import watched as watched
from ._samples import (
    Samples as Samples,
    samples as samples,
    signals as signals,
)
from ._shooting import (
    AbstractShooting as AbstractShooting,
    MultipleShooting as MultipleShooting,
    Nudging as Nudging,
    SingleShooting as SingleShooting,
)
from ._solve import Minimum as Minimum, minimise as minimise
from ._statements import statements as statements
