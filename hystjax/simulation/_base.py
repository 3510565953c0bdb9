"""What every way to simulate a law offers."""

from abc import abstractmethod

import equinox as eqx
from jaxtyping import Array, Float

from .._core.solution import RESULTS
from ..models import AbstractModel
from ..signals import AbstractInputPath


class AbstractSimulation(eqx.Module):
    """Integrates a model along an input path."""

    @property
    def otherwise(self) -> "AbstractSimulation | None":
        """What to try where this way ends as `inaccurate` or `diverged`, if
        anything."""
        return None

    @abstractmethod
    def integrate(
        self,
        model: AbstractModel,
        path: AbstractInputPath,
        w0: Float[Array, ""],
        scale: Float[Array, ""],
    ) -> tuple[Float[Array, " n"], RESULTS, dict]:
        """The output at the path's sample times.

        **Arguments:** the law, the input, the output at the first sample time, and the
        output's order of magnitude (output units).

        **Returns:** w of shape (n,), how it ended, and statistics.
        """
