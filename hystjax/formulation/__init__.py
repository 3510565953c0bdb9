"""From samples to equations that are linear in the coefficients of a law."""

from ._base import AbstractFormulation as AbstractFormulation
from ._pointwise import Direct as Direct, Pointwise as Pointwise
from ._weak_form import WeakForm as WeakForm
