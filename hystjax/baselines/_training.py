"""Training of networks."""

import sys
import time
from abc import abstractmethod
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import optax
from jaxtyping import Array, Float, PRNGKeyArray

from .._errors import InputError

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
