"""Derivatives of sampled signals."""

from ._base import AbstractDifferentiation as AbstractDifferentiation
from ._finite_difference import FiniteDifference as FiniteDifference
from ._savitzky_golay import SavitzkyGolay as SavitzkyGolay
from ._smoothing_spline import SmoothingSpline as SmoothingSpline
from ._total_variation import TotalVariation as TotalVariation
