"""One equation a sample: the law at that time."""

from ..differentiation import AbstractDifferentiation
from ._base import AbstractFormulation


class Pointwise(AbstractFormulation):
    """The derivative of the output, estimated at each sample, is the sum of the terms.

    Output and input pass through the same differentiation (and its smoothing), so that
    its bias is the same on both sides of the law.

    **Attributes:**

    - `differentiation`: the estimate.
    """

    differentiation: AbstractDifferentiation

    def equations(self, library, path, w):
        value, slope = self.differentiation.estimate(path.t, w)
        u, du = self.differentiation.estimate(path.t, path.samples()[0])
        return library(value, u, du), slope


def formulation(
    chosen: AbstractDifferentiation | AbstractFormulation,
) -> AbstractFormulation:
    """A differentiation stands for its pointwise formulation."""
    if isinstance(chosen, AbstractFormulation):
        return chosen
    return Pointwise(chosen)
