"""Laws by regression: from recordings to a factored least-squares problem, and on."""

from ._identify import identify as identify
from ._non_negative import NonNegative as NonNegative
from ._problem import (
    Alias as Alias,
    LeastSquaresProblem as LeastSquaresProblem,
    aliases as aliases,
    compress as compress,
    merged as merged,
    novelty as novelty,
)
from ._regressions import (
    STLSQ as STLSQ,
    AbstractRegression as AbstractRegression,
    Fit as Fit,
    LeastSquares as LeastSquares,
    Ridge as Ridge,
    threshold_path as threshold_path,
)
from ._stability import Stability as Stability, stability as stability
