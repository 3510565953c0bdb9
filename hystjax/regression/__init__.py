"""Laws by regression: from recordings to a factored least-squares problem, and on."""

from ..least_squares import (
    STLSQ as STLSQ,
    AbstractRegression as AbstractRegression,
    Alias as Alias,
    Fit as Fit,
    LeastSquares as LeastSquares,
    LeastSquaresProblem as LeastSquaresProblem,
    NonNegative as NonNegative,
    Ridge as Ridge,
    aliases as aliases,
    compress as compress,
    merged as merged,
    novelty as novelty,
    threshold_path as threshold_path,
)
from ._identify import identify as identify
from ._stability import Stability as Stability, stability as stability

# The other names are for the folders that build on this one.
__all__ = [
    "STLSQ",
    "AbstractRegression",
    "Alias",
    "Fit",
    "LeastSquares",
    "LeastSquaresProblem",
    "NonNegative",
    "Ridge",
    "Stability",
    "aliases",
    "identify",
    "novelty",
    "stability",
    "threshold_path",
]


def __dir__() -> list[str]:
    return __all__
