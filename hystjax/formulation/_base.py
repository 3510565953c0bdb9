"""What every formulation offers."""

from abc import abstractmethod
from typing import ClassVar

import equinox as eqx
from jaxtyping import Array, Float

from ..interpolation import AbstractInputPath
from ..library import Library


class AbstractFormulation(eqx.Module):
    """Makes linear equations for the k coefficients of a law.

    **Attributes:** `target`, what the law then gives: the `"rate"` w' or the `"value"`
    w.
    """

    target: ClassVar[str] = "rate"

    @abstractmethod
    def equations(
        self, library: Library, path: AbstractInputPath, w: Float[Array, " n"]
    ) -> tuple[Float[Array, "m k"], Float[Array, " m"]]:
        """Left sides, one column a term, and right sides.

        **Arguments:** the candidate terms; the input; and the output at its sample
        times.

        **Raises:** `InputError` when there are too few samples.
        """
