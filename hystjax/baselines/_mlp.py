"""A network that learns the derivative."""

import equinox as eqx
import jax
import jax.numpy as jnp
import optax
from jaxtyping import Array, Float, PRNGKeyArray

from .. import _checks
from .._solution import RESULTS, Solution, outcome
from ..differentiation import AbstractDifferentiation, FiniteDifference
from ..library import Library
from ._base import AbstractRateBaseline
from ._neural_law import NeuralLaw
from ._training import AbstractObjective, check_key, started, train

LBFGS = optax.lbfgs(0.1, memory_size=100, linesearch=None)
"""L-BFGS with a tenth of the quasi-Newton step, on all rows at once."""


class MLP(AbstractRateBaseline):
    """A multilayer perceptron with tanh units, trained on all rows at once to the least
    mean squared error of the derivative.

    By default the network of Chandra et al. (2023), doi 10.1063/5.0146134.

    **Attributes:**

    - `library`: the k features that it gets.
    - `width`: units of a hidden layer.
    - `depth`: hidden layers.
    - `epochs`: steps of the optimiser.
    - `optimiser`: an Optax transformation that needs no more than the gradient.
    - `differentiation`: how derivatives are estimated.
    """

    library: Library
    width: int = 20
    depth: int = 5
    epochs: int = 1000
    optimiser: optax.GradientTransformation = eqx.field(static=True, default=LBFGS)
    differentiation: AbstractDifferentiation = FiniteDifference()

    def __check_init__(self):
        for name in ("width", "depth", "epochs"):
            _checks.positive(name, getattr(self, name))

    def network(self, key: PRNGKeyArray) -> eqx.nn.MLP:
        """A network before training: weights uniform at random, biases zero.

        **Source:** Glorot and Bengio (2010), with the gain 5/3 usual for tanh.
        """
        shape_key, *keys = jax.random.split(key, self.depth + 2)
        size = len(self.library)
        network = eqx.nn.MLP(
            size, "scalar", self.width, self.depth, jnp.tanh, key=shape_key
        )
        draw = jax.nn.initializers.variance_scaling(25 / 9, "fan_avg", "uniform")
        weights = [
            draw(k, x.weight.shape) for k, x in zip(keys, network.layers, strict=True)
        ]
        biases = [jnp.zeros(weight.shape[0]) for weight in weights]
        return eqx.tree_at(
            lambda n: [*(x.weight for x in n.layers), *(x.bias for x in n.layers)],
            network,
            [*weights, *biases],
        )

    def fit(self, recording, *, rows=None, key=None, progress=False):
        """As every baseline's, with `progress` for whether to show the loss on standard
        error, where that is a terminal.

        **Returns:** a `Solution` whose `value` is a `NeuralLaw` and whose `stats` hold
        `losses`, the mean squared error before each epoch.

        **Raises:** `InputError` without `key`.
        """
        key = check_key(key)
        network = self.network(key)
        trained = train(
            network,
            started(network, self.optimiser),
            _Misfit(*self.rows(recording, rows)),
            self.optimiser,
            self.epochs,
            key=key,
            progress=progress,
        )
        law = NeuralLaw(
            self.library, trained.network, names=recording.names, units=recording.units
        )
        result = outcome(jnp.isfinite(trained.losses[-1]), RESULTS.diverged)
        return Solution(law, result, {"losses": trained.losses})


class _Misfit(AbstractObjective):
    """Mean squared error of the derivative."""

    features: Float[Array, "r k"]
    rate: Float[Array, " r"]

    def __call__(self, network, key):
        return jnp.mean((jax.vmap(network)(self.features) - self.rate) ** 2)
