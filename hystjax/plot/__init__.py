"""Figures of recordings, laws and threshold paths, by Matplotlib.

Every function returns a `matplotlib.figure.Figure`. They are made without pyplot, so
that no display is needed and nothing global is touched; notebooks show them, `save`
writes them. Given axes are drawn into instead, and their figure is returned.
"""

from ._canvas import save as save
from ._models import (
    densities as densities,
    friction as friction,
    hidden as hidden,
    magnetisation as magnetisation,
    preisach as preisach,
)
from ._records import (
    backbone as backbone,
    comparison as comparison,
    cycles as cycles,
    energy as energy,
    error as error,
    fit as fit,
    forc as forc,
    loop as loop,
    overview as overview,
    record as record,
    refinement as refinement,
    tracking as tracking,
)
from ._terms import (
    coefficient_path as coefficient_path,
    frontier as frontier,
    heat_map as heat_map,
    inclusion as inclusion,
    stability as stability,
)
