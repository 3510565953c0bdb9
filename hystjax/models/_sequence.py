"""The interface of models that are no differential equation."""

from abc import abstractmethod

import equinox as eqx
from jaxtyping import Array, Float


class AbstractSequenceModel(eqx.Module):
    """A device as a map from input samples to output samples, at one sampling interval.

    There is nothing to integrate: `simulate` asks for the response. Whatever the model
    remembers it keeps inside.

    **Attributes:**

    - `interval`: time between samples, s.
    - `names`: what the input and the output are; keyword only.
    - `units`: units of the input and of the output; keyword only.
    """

    interval: eqx.AbstractVar[Float[Array, ""]]
    names: tuple[str, str] = eqx.field(
        static=True, kw_only=True, default=("input", "output")
    )
    units: tuple[str, str] = eqx.field(static=True, kw_only=True, default=("", ""))

    @abstractmethod
    def response(self, u: Float[Array, " n"], w0: Float[Array, ""]) -> Array:
        """The output at the samples, shape (n,), of the input there and the output at
        the first."""

    @abstractmethod
    def __str__(self) -> str:
        """The model for people."""
