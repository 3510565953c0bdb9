"""Regressions on a factored least-squares problem."""

from ._aliases import Alias as Alias, aliases as aliases
from ._non_negative import NonNegative as NonNegative
from ._novelty import novelty as novelty
from ._path import threshold_path as threshold_path
from ._problem import (
    LeastSquaresProblem as LeastSquaresProblem,
    compress as compress,
    merged as merged,
)
from ._regressions import (
    STLSQ as STLSQ,
    AbstractRegression as AbstractRegression,
    Fit as Fit,
    LeastSquares as LeastSquares,
    Ridge as Ridge,
)
