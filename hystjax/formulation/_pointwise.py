"""One equation a sample: the law at that time."""

from abc import abstractmethod
from typing import ClassVar

from jaxtyping import Array, Float

from ..differentiation import AbstractDifferentiation
from ..interpolation import AbstractInputPath
from ._base import AbstractFormulation


class AbstractPointwise(AbstractFormulation):
    """One equation a sample, of what is known there."""

    @abstractmethod
    def samples(
        self, path: AbstractInputPath, w: Float[Array, " n"]
    ) -> tuple[Float[Array, " n"], ...]:
        """Output, input and its derivative at the samples, and what the terms are to
        add up to there."""

    def equations(self, library, path, w):
        value, u, du, target = self.samples(path, w)
        # What terms remember of the input is exact.
        return library(value, u, du, library.signals(path)), target


class Pointwise(AbstractPointwise):
    """The derivative of the output, estimated at each sample, is the sum of the terms.

    Output and input pass through the same differentiation (and its smoothing), so that
    its bias is the same on both sides of the law.

    **Attributes:**

    - `differentiation`: the estimate.
    """

    differentiation: AbstractDifferentiation

    def samples(self, path, w):
        value, slope = self.differentiation.estimate(path.t, w)
        u, du = self.differentiation.estimate(path.t, path.samples()[0])
        return value, u, du, slope


class Direct(AbstractPointwise):
    """The output at each sample is the sum of the terms: laws w = f(u) of what the
    input decides, as Prandtl-Ishlinskii operators are. Nothing is differentiated.

    Terms that hold the output, or functions of one's own, which might, are refused.
    """

    target: ClassVar[str] = "value"

    def samples(self, path, w):
        return w, *path.samples(), w
