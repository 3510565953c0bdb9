"""What laws are tried on, the same for all that one search tries."""

import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from .._core.checks import InputError
from ..library import Library
from ..models import AbstractModel, SparseModel
from ..recording import Recording
from ..refinement import free_of
from . import search
from ._layout import Layout
from .search import Around


class Setting(NamedTuple):
    """What laws are tried on: recordings, also laid out; the candidate terms; the most
    terms of a law; how many laws of each size are tried at first; how much of a
    difference a law may keep, 0 for any; how far its output may get outside of what was
    recorded, over half of the recorded range; the model `around` a law, with which its
    output is compared; which share of residuals must be worth independent ones for
    them to be noise; which signs coefficients are to have; those of a known part, whose
    terms come first in the library; and the terms that a program has room for, where
    laws of more are tried later: one compiled program then serves both."""

    group: tuple[Recording, ...]
    layout: Layout
    library: Library
    largest: int
    width: int
    fading: float
    reach: float = math.inf
    around: Around = search.itself
    noise: float = 1.0
    signs: Mapping[str, float] = MappingProxyType({})
    known: Mapping[str, float] = MappingProxyType({})
    room: int = 0

    @property
    def places(self) -> int:
        """Places that a program has for terms."""
        return max(self.room, self.largest)

    @property
    def numbers(self) -> int:
        """Places for numbers in the terms, such as radii, that are fitted too."""
        return min(self.places, len(self.library.numbers))

    def own(self) -> dict[str, float]:
        """The numbers of the model around a law, by name, as `around` gives them.

        **Raises:** `InputError` where it gives no model with a law's parameters.
        """
        return own(self.around, self.library)

    def others(self) -> int:
        """How many numbers are fitted besides the coefficients of a law."""
        free = free_of(self.around(nothing(self.library)))
        # Of first outputs without weight nothing is fitted.
        first = np.sum(np.asarray(self.layout.samples.weight[:, 0]) > 0)
        starts = {"state": len(self.group), "output": int(first), "nothing": 0}
        return len(self.own()) + starts[free]


def own(around: Around, library: Library) -> dict[str, float]:
    """The numbers of the model around a law, by name, as `around` gives them.

    **Raises:** `InputError` where it gives no model with a law's parameters.
    """
    law = nothing(library)
    model = around(law)
    if not isinstance(model, AbstractModel):
        raise InputError(
            "`around` must make a model of a law, such as `models.Butterfly`; it "
            f"made {model!r}."
        )
    inside, every = law.parameters(), model.parameters()
    lost = [name for name in inside if name not in every]
    if lost:
        raise InputError(
            f"the model that `around` makes has no parameter {lost[0]!r}, though "
            "its law has: let its `parameters` and `with_parameters` pass on those "
            "of the law, by the same names, as `models.Butterfly` does."
        )
    return {name: float(x) for name, x in every.items() if name not in inside}


def nothing(library: Library) -> SparseModel:
    """The law w' = 0."""
    return SparseModel(library, jnp.zeros(len(library)), np.ones(len(library), bool))
