"""How much each equation of a regression counts."""

from ._base import AbstractWeighting as AbstractWeighting, Even as Even
from ._bisquare import Bisquare as Bisquare
