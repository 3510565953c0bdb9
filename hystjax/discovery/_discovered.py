"""What a search for a law has found."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from jaxtyping import ArrayLike, Float

from .._core.solution import RESULTS, AbstractFindings, Solution
from ..models import AbstractModel
from ..refinement import Refined
from ..regression import Alias
from .search import Trial


class Discovered(AbstractFindings):
    """A law that was found, and what else was tried.

    **Attributes:** the law, or the model around it, the `value`; how its refinement
    ended, or that there is none, the `result`; all others are what `discover` tells in
    `stats`, by the same names; and how it was `refined`, told among them.
    """

    value: AbstractModel
    result: RESULTS
    candidates: tuple[Trial, ...]
    frontier: dict[int, Trial]
    alike: tuple[Trial, ...]
    apart: float
    noise_floor: float
    why: str
    weights: Sequence[Float[ArrayLike, " _n"]] | None
    aliases: tuple[Alias, ...]
    refined: Refined | None = None

    def stats(self) -> dict[str, Any]:
        """What is known of the search, and of the fit of the law."""
        known = super().stats()
        fit = known.pop("refined", None)
        return known if fit is None else fit.stats() | known

    @classmethod
    def of(cls, solution: Solution) -> "Discovered":
        """What such a `Solution` tells."""
        known = super().of(solution)
        if not Refined.told_by(solution):
            return known
        return replace(known, refined=Refined.of(solution))
