"""A law whose right side is a network."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.flatten_util import ravel_pytree

from ..library import Library, Polynomial
from ..models import AbstractModel, register
from ._training import size


def _blank(features: int, width: int, depth: int) -> "NeuralLaw":
    network = eqx.nn.MLP(
        features, "scalar", width, depth, jnp.tanh, key=jax.random.key(0)
    )
    return NeuralLaw(Polynomial(1), network)


@register(like=_blank)
class NeuralLaw(AbstractModel):
    """The law w' = network(features of w, u, u').

    **Attributes:**

    - `library`: the k features.
    - `network`: from k numbers to one.
    - `names`, `units`: of input and output; keyword only.
    """

    library: Library
    network: eqx.nn.MLP

    @property
    def hidden(self):
        return False

    @property
    def features(self) -> int:
        """How many there are."""
        return len(self.library)

    @property
    def width(self) -> int:
        """Of the hidden layers."""
        return self.network.width_size

    @property
    def depth(self) -> int:
        """Number of hidden layers."""
        return self.network.depth

    @property
    def size(self) -> int:
        """Number of weights and biases."""
        return size(self.network)

    @property
    def memory(self):
        return self.library.memory

    def rate(self, x, m, now):
        signals = self.memory.values(m, now)
        return self.network(self.library(x, now.u, now.du, signals))

    def output(self, x, m, now):
        return x

    def parameters(self):
        flat, _ = ravel_pytree(self._arrays())
        return {f"p{i}": value for i, value in enumerate(flat)}

    def with_parameters(self, values):
        flat, shaped = ravel_pytree(self._arrays())
        places = jnp.array([int(name.removeprefix("p")) for name in values], int)
        changed = flat.at[places].set(jnp.array(list(values.values()), flat.dtype))
        network = eqx.combine(shaped(changed), self.network)
        return eqx.tree_at(lambda law: law.network, self, network)

    def __str__(self) -> str:
        widths = [self.network.in_size]
        widths += [layer.weight.shape[0] for layer in self.network.layers]
        features = ", ".join(term.text for term in self.library.terms)
        return f"w' = a network {'-'.join(map(str, widths))} of {features}"

    def _arrays(self):
        return eqx.filter(self.network, eqx.is_inexact_array)
