"""Training of networks, and one that learns the derivative."""

import sys
import time
from abc import abstractmethod
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import optax
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float, PRNGKeyArray

from ..._core import checks
from ..._core.checks import InputError
from ..._core.solution import RESULTS, Solution, outcome
from ...library import Library, Polynomial
from ...models import AbstractModel
from ...regression.differentiation import AbstractDifferentiation, FiniteDifference
from ...saving import register
from ._base import AbstractRateBaseline


class _State(NamedTuple):
    """State of the inner transformation, and the last pair that it remembers."""

    inner: Any
    step: optax.Params
    change: optax.Updates


def cautious_lbfgs(
    learning_rate: float, memory_size: int, least: float
) -> optax.GradientTransformation:
    """L-BFGS with steps of fixed length, which remembers a step s and the change y of
    the gradient along it only where s·y is more than `least`.

    With `least` 1e-10 this is the rule of PyTorch's `LBFGS`. It is absolute: a loss
    that has become small is no longer told from a flat one, and learning slows down.

    **Arguments:**

    - `learning_rate`: share of the quasi-Newton step that is taken.
    - `memory_size`: most pairs remembered.
    - `least`: see above; in units of the loss.

    **Source:** Liu and Nocedal (1989), doi 10.1007/BF01589116.
    """
    lbfgs = optax.scale_by_lbfgs(memory_size)

    def init(params):
        zero = optax.tree.zeros_like(params)
        return _State(lbfgs.init(params), zero, zero)

    def update(updates, state, params=None):
        inner, *old = state
        new = [
            optax.tree.sub(params, inner.params),
            optax.tree.sub(updates, inner.updates),
        ]
        curved = (jnp.asarray(optax.tree.vdot(*new)) > least) | (inner.count == 0)
        # A pair that is left out gives way to the last one remembered, in its place.
        step, change = jax.tree.map(lambda a, b: jnp.where(curved, a, b), new, old)
        before = inner._replace(
            count=jnp.where(curved, inner.count, inner.count - 1),
            params=optax.tree.sub(params, step),
            updates=optax.tree.sub(updates, change),
        )
        direction, after = lbfgs.update(updates, before, params)
        return direction, _State(after, step, change)

    return optax.chain(
        optax.GradientTransformation(init, update),
        optax.scale_by_learning_rate(learning_rate),
    )


_PORTION = 50  # epochs between reports of progress, and the most compiled for


class Trained(NamedTuple):
    """What comes of a training.

    **Attributes:**

    - `network`, `state`: after the last epoch.
    - `losses`: before each epoch.
    - `pace`: s an epoch, without the first 50 epochs, which compile, where there are
        more.
    """

    network: Any
    state: optax.OptState
    losses: Float[Array, " epochs"]
    pace: float


class AbstractObjective(eqx.Module):
    """What training makes small, with the data that it is about."""

    @abstractmethod
    def __call__(self, network: Any, key: PRNGKeyArray) -> Float[Array, ""]:
        """The loss of a network; `key` for what is drawn anew each epoch."""


def train(
    network: Any,
    state: optax.OptState,
    objective: AbstractObjective,
    optimiser: optax.GradientTransformation,
    epochs: int,
    *,
    key: PRNGKeyArray,
    progress: bool = False,
) -> Trained:
    """Take `epochs` steps of an optimiser; what is compiled serves any number."""
    losses, begun, skipped = [], time.perf_counter(), 0
    for first in range(0, epochs, _PORTION):
        count = min(_PORTION, epochs - first)
        key, now = jax.random.split(key)
        network, state, some = _portion(
            network, state, objective, optimiser, jnp.array(count), now
        )
        losses.append(jax.block_until_ready(some[:count]))
        if not first and epochs > _PORTION:
            begun, skipped = time.perf_counter(), _PORTION
        if progress and sys.stderr.isatty():
            print(f"loss {float(losses[-1][-1]):.6g} ", end="\r", file=sys.stderr)
    pace = (time.perf_counter() - begun) / (epochs - skipped)
    return Trained(network, state, jnp.concatenate(losses), pace)


def started(network: Any, optimiser: optax.GradientTransformation) -> optax.OptState:
    """The state of an optimiser before the first epoch."""
    return optimiser.init(eqx.filter(network, eqx.is_inexact_array))


def size(network: Any) -> int:
    """Number of weights and biases."""
    arrays = eqx.filter(network, eqx.is_inexact_array)
    return sum(leaf.size for leaf in jax.tree.leaves(arrays))


def check_key(key: PRNGKeyArray | None) -> PRNGKeyArray:
    """The key, or `InputError` without one."""
    if key is None:
        raise InputError("a network needs a `key`, such as `jax.random.key(0)`.")
    return key


@eqx.filter_jit
def _portion(network, state, objective, optimiser, count, key):
    weights, rest = eqx.partition(network, eqx.is_inexact_array)

    def loss(weights, key):
        return objective(eqx.combine(weights, rest), key)

    def epoch(number, carry):
        weights, state, losses = carry
        now = jax.random.fold_in(key, number)
        value, slope = jax.value_and_grad(loss)(weights, now)
        change, state = optimiser.update(slope, state, weights)
        weights = optax.apply_updates(weights, change)
        return weights, state, losses.at[number].set(value)

    dtype = jax.eval_shape(loss, weights, key).dtype
    start = (weights, state, jnp.zeros(_PORTION, dtype))
    weights, state, losses = jax.lax.fori_loop(0, count, epoch, start)
    return eqx.combine(weights, rest), state, losses


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
            checks.positive(name, getattr(self, name))

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
