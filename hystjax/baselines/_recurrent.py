"""Recurrent networks."""

from abc import abstractmethod
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from .. import _checks
from ._sequence import AbstractSequenceBaseline, Stage
from ._sequence_network import PRECISION

_STAGES = (Stage(100, 10000), Stage(1000, 1500), Stage(5000, 300))


class Recurrent(eqx.Module):
    """A cell that is driven through the samples, and a linear map of what it shows.

    The state before the first sample is a tanh layer of that sample and of the output
    there.

    **Attributes:**

    - `start`: the map to the first state.
    - `cell`: from a sample and a state to the next state.
    - `readout`: from what the cell shows to the output.
    """

    start: eqx.nn.Linear
    cell: eqx.nn.LSTMCell | eqx.nn.GRUCell
    readout: eqx.nn.Linear

    def __init__(self, cell: Any, key: PRNGKeyArray):
        first, last = jax.random.split(key)
        states = 2 if isinstance(cell, eqx.nn.LSTMCell) else 1
        self.cell = cell
        self.start = eqx.nn.Linear(
            3, states * cell.hidden_size, dtype=PRECISION, key=first
        )
        self.readout = eqx.nn.Linear(
            cell.hidden_size, "scalar", dtype=PRECISION, key=last
        )

    def __call__(
        self, inputs: Float[Array, "n 2"], w0: Float[Array, ""]
    ) -> Float[Array, " n"]:
        """Outputs of standard inputs and slopes."""
        flat = jnp.tanh(self.start(jnp.append(inputs[0], w0)))
        if isinstance(self.cell, eqx.nn.LSTMCell):
            state = tuple(jnp.split(flat, 2))
        else:
            state = flat

        def step(state, sample):
            state = self.cell(sample, state)
            return state, state[0] if isinstance(state, tuple) else state

        _, shown = jax.lax.scan(step, state, inputs)
        return jax.vmap(self.readout)(shown)


class AbstractRecurrentBaseline(AbstractSequenceBaseline):
    """A recurrent network.

    **Attributes:**

    - `width`: units of the cell.
    - `stages`, `rate`: of the training; see `AbstractSequenceBaseline`.
    """

    width: int = 16
    stages: tuple[Stage, ...] = _STAGES
    rate: float = 1e-2

    def __check_init__(self):
        _checks.positive("width", self.width)

    @abstractmethod
    def cell(self, key: PRNGKeyArray) -> Any:
        """The cell before training."""

    def network(self, key):
        """A cell, with the map to its first state and the one to the output."""
        first, last = jax.random.split(key)
        return Recurrent(self.cell(first), last)


class LSTM(AbstractRecurrentBaseline):
    """A long short-term memory.

    **Source:** Hochreiter and Schmidhuber (1997), doi 10.1162/neco.1997.9.8.1735.
    """

    def cell(self, key):
        return eqx.nn.LSTMCell(2, self.width, dtype=PRECISION, key=key)


class GRU(AbstractRecurrentBaseline):
    """Gated recurrent units.

    **Source:** Cho et al. (2014), doi 10.3115/v1/D14-1179.
    """

    def cell(self, key):
        return eqx.nn.GRUCell(2, self.width, dtype=PRECISION, key=key)
