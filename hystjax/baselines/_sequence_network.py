"""A sequence model whose response is a network's."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..models import AbstractSequenceModel
from ._training import size

PRECISION = jnp.float32
"""Of weights and arithmetic: far below the noise of a record, and twice as fast."""


class Standard(eqx.Module):
    """Numbers made of mean 0 and standard deviation 1.

    **Attributes:**

    - `mean`, `deviation`: shape (k,), or () for one quantity.
    """

    mean: Float[Array, "*k"]
    deviation: Float[Array, "*k"]

    @classmethod
    def of(cls, values: Float[Array, "n *k"]) -> "Standard":
        """The one that makes some values standard."""
        deviation = jnp.std(values, axis=0)
        return cls(jnp.mean(values, axis=0), jnp.where(deviation > 0, deviation, 1.0))

    def __call__(self, values: Float[Array, "*n"]) -> Float[Array, "*n"]:
        """Standard numbers, in the precision of networks."""
        return ((values - self.mean) / self.deviation).astype(PRECISION)

    def inverse(self, values: Float[Array, "*n"]) -> Float[Array, "*n"]:
        """Numbers with their units again."""
        return self.mean + self.deviation * values


class SequenceNetwork(AbstractSequenceModel):
    """A network that gets the input and its slope.

    The slope is that since the sample before, so that no output depends on a later
    input; for the first sample it is that up to the second.

    **Attributes:**

    - `network`: from the standard input and slope, shape (n, 2), and the standard
        output at the first sample, to standard outputs, shape (n,).
    - `interval`: time between samples, s.
    - `inputs`, `output`: how units are taken off.
    - `names`, `units`: of input and output; keyword only.
    """

    network: Any
    interval: Float[Array, ""]
    inputs: Standard
    output: Standard

    @property
    def size(self) -> int:
        """Number of weights and biases."""
        return size(self.network)

    def response(self, u, w0):
        inputs = self.inputs(input_and_slope(u, self.interval))
        w = self.network(inputs, self.output(w0))
        return self.output.inverse(w.astype(u.dtype))

    def __str__(self) -> str:
        kind, every = type(self.network).__name__.lower(), float(self.interval)
        return f"w = a {kind} network of u, u', {self.size} weights, every {every:g} s"


def input_and_slope(
    u: Float[Array, " n"], interval: Float[Array, ""]
) -> Float[Array, "n 2"]:
    """What the network gets, with units."""
    slope = jnp.diff(u) / interval
    return jnp.stack([u, jnp.append(slope[:1], slope)], axis=1)
