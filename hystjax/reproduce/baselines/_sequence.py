"""Networks that map input samples to output samples, and the model they make."""

from abc import abstractmethod
from functools import cache
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import optax
from jaxtyping import Array, Float, PRNGKeyArray

from ..._core import checks
from ..._core.checks import InputError
from ..._core.solution import RESULTS, Solution, outcome
from ...models import AbstractSequenceModel
from ._base import AbstractBaseline
from ._mlp import AbstractObjective, check_key, size, started, train

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


class Stage(eqx.Module):
    """A part of a training.

    **Attributes:**

    - `window`: samples of a window.
    - `epochs`: steps of the optimiser, each on as many windows, from random rows on, as
        fit into the record side by side.
    """

    window: int
    epochs: int

    def __check_init__(self):
        for name in ("window", "epochs"):
            checks.positive(name, getattr(self, name))


class AbstractSequenceBaseline(AbstractBaseline):
    """A network that is trained on free runs over windows of a record.

    The loss is the mean squared error of the output. Only the first measured output of
    a window enters. Training is by Adam, Kingma and Ba (2015), arXiv 1412.6980, whose
    rate falls to zero along a cosine, Loshchilov and Hutter (2017), arXiv 1608.03983,
    with gradients clipped to a norm of 1; in single precision.

    **Attributes:**

    - `stages`: parts of the training; windows that grow teach to run on.
    - `rate`: learning rate at the start.
    """

    stages: eqx.AbstractVar[tuple[Stage, ...]]
    rate: eqx.AbstractVar[float]

    @abstractmethod
    def network(self, key: PRNGKeyArray) -> Any:
        """A network before training: from standard input and slope, shape (n, 2), and
        the standard output at the first sample, to standard outputs, shape (n,)."""

    def fit(self, recording, *, key=None, progress=False):
        """As every baseline's, with `progress` for whether to show the loss on standard
        error, where that is a terminal.

        **Returns:** a `Solution` whose `value` is a `SequenceNetwork` and whose `stats`
        hold `losses`, the mean squared error over the output's variance before each
        epoch; and `pace`, s an epoch, of each stage, without the first 50 epochs, which
        compile, where there are more.

        **Raises:** `InputError` without `key`, for samples that are not evenly spaced,
        and for a window longer than the recording.
        """
        first, *keys = jax.random.split(check_key(key), len(self.stages) + 1)
        self._check(recording)
        model = _untrained(recording, self.network(first))
        optimiser = _adam(self.rate, sum(stage.epochs for stage in self.stages))
        network, losses, paces = model.network, [], []
        state = started(network, optimiser)
        for stage, now in zip(self.stages, keys, strict=True):
            misfit = _Misfit(
                model.inputs(input_and_slope(recording.u, model.interval)),
                model.output(recording.w),
                stage.window,
            )
            network, state, some, pace = train(
                network,
                state,
                misfit,
                optimiser,
                stage.epochs,
                key=now,
                progress=progress,
            )
            losses.append(some)
            paces.append(pace)
        losses = jnp.concatenate(losses)
        result = outcome(jnp.isfinite(losses[-1]), RESULTS.diverged)
        model = eqx.tree_at(lambda m: m.network, model, network)
        return Solution(model, result, {"losses": losses, "pace": jnp.array(paces)})

    def _check(self, recording):
        name = type(self).__name__
        checks.evenly_spaced(name, recording.t, "with `recording.resample`")
        longest = max(stage.window for stage in self.stages)
        if longest > len(recording):
            raise InputError(
                f"`stages` has a window of {longest} samples, and the recording has "
                f"{len(recording)}; use shorter windows."
            )


def _untrained(recording, network) -> SequenceNetwork:
    interval = jnp.mean(jnp.diff(recording.t))
    return SequenceNetwork(
        network,
        interval,
        Standard.of(input_and_slope(recording.u, interval)),
        Standard.of(recording.w),
        names=recording.names,
        units=recording.units,
    )


@cache  # What is compiled is found again by the optimiser's identity.
def _adam(rate: float, epochs: int) -> optax.GradientTransformation:
    return optax.chain(
        optax.clip_by_global_norm(1.0),
        optax.adam(optax.cosine_decay_schedule(rate, epochs)),
    )


class _Misfit(AbstractObjective):
    """Mean squared error of free runs over random windows."""

    inputs: Float[Array, "n 2"]
    output: Float[Array, " n"]
    window: int = eqx.field(static=True)

    def __call__(self, network, key):
        n = len(self.output)
        last = n - self.window
        starts = jax.random.randint(key, (n // self.window,), 0, last + 1)
        rows = starts[:, None] + jnp.arange(self.window)
        runs = jax.vmap(network)(self.inputs[rows], self.output[starts])
        return jnp.mean((runs - self.output[rows]) ** 2)
