"""Linear least squares: a factored problem, and what is solved on it."""

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
