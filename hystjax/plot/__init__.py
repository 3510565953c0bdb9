"""Figures of recordings, laws and threshold paths, by Matplotlib.

Every function returns a `matplotlib.figure.Figure`. They are made without pyplot, so
that no display is needed and nothing global is touched; notebooks show them, `save`
writes them. Given axes are drawn into instead, and their figure is returned.
"""

from ._classical import friction as friction, magnetisation as magnetisation
from ._coefficient_path import coefficient_path as coefficient_path
from ._frontier import frontier as frontier
from ._heat_map import heat_map as heat_map
from ._inclusion import inclusion as inclusion
from ._overview import overview as overview
from ._refinement import refinement as refinement
from ._save import save as save
from ._signals import error as error, fit as fit, loop as loop, record as record
from ._stability import stability as stability
