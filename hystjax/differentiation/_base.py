"""What every differentiation method offers."""

from abc import abstractmethod

import equinox as eqx
from jaxtyping import Array, Float


class AbstractDifferentiation(eqx.Module):
    """Estimates a signal and its time derivative from samples."""

    @property
    def reach(self) -> int | None:
        """Samples on either side that an estimate looks at; None for all."""
        return None

    @abstractmethod
    def estimate(
        self, t: Float[Array, " n"], y: Float[Array, " n"]
    ) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
        """The signal with this method's smoothing, and its derivative.

        **Arguments:** times `t` in s, increasing strictly, evenly spaced or not; values
        `y` in any unit.

        **Returns:** both of shape (n,); the derivative in units of `y` a second.

        **Raises:** `InputError` when there are too few samples.
        """

    def __call__(
        self, t: Float[Array, " n"], y: Float[Array, " n"]
    ) -> Float[Array, " n"]:
        """The derivative alone."""
        return self.estimate(t, y)[1]
