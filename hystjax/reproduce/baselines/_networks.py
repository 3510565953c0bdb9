"""Networks that map input samples to output samples, convolutional and recurrent,
and the model they make."""

from abc import abstractmethod
from collections.abc import Sequence
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
from ...recording import as_recording
from ._rates import AbstractBaseline, AbstractObjective, check_key, size, started, train

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
            checks.count(name, getattr(self, name))


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

    def __check_init__(self):
        given, several = self.stages, isinstance(self.stages, Sequence)
        if not several or not given or not all(isinstance(x, Stage) for x in given):
            raise InputError(
                "`stages` must be one `Stage` or more in a tuple, such as "
                f"`(baselines.Stage(1000, 1500),)`; got {given!r}."
            )
        checks.positive("rate", self.rate)

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
        key = check_key("a network", key)
        self._check(recording)
        first, *keys = jax.random.split(key, len(self.stages) + 1)
        model = _untrained(recording, self.network(first))
        optimiser = _adam(float(self.rate), sum(stage.epochs for stage in self.stages))
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
        as_recording(recording, "fit(recording, key=key)")
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


class Taps(eqx.Module):
    """A convolution without padding: its output begins where all samples that it needs
    are there.

    As one product of matrices it is several times faster on a CPU than a convolution.

    **Attributes:**

    - `weights`: from the `kernel` samples, side by side, to the output.
    - `kernel`: number of samples.
    - `dilation`: distance between them.
    """

    weights: eqx.nn.Linear
    kernel: int = eqx.field(static=True)
    dilation: int = eqx.field(static=True)

    def __init__(
        self, size: int, width: int, kernel: int, dilation: int, key: PRNGKeyArray
    ):
        self.kernel, self.dilation = kernel, dilation
        self.weights = eqx.nn.Linear(size * kernel, width, dtype=PRECISION, key=key)

    @property
    def reach(self) -> int:
        """Samples before the present one that are needed."""
        return (self.kernel - 1) * self.dilation

    def __call__(self, x: Float[Array, "n k"]) -> Float[Array, "m l"]:
        """The last m = n - reach samples."""
        m = len(x) - self.reach
        shifts = range(0, self.reach + 1, self.dilation)
        beside = jnp.concatenate([x[shift : shift + m] for shift in shifts], axis=1)
        return jax.vmap(self.weights)(beside)


class Residual(eqx.Module):
    """Two convolutions of one dilation, and a way around them.

    **Attributes:**

    - `first`, `second`: the convolutions.
    - `around`: fits the width of what goes around, where it differs.
    """

    first: Taps
    second: Taps
    around: eqx.nn.Linear | None

    def __init__(
        self, size: int, width: int, kernel: int, dilation: int, key: PRNGKeyArray
    ):
        one, two, three = jax.random.split(key, 3)
        self.first = Taps(size, width, kernel, dilation, one)
        self.second = Taps(width, width, kernel, dilation, two)
        same = size == width
        self.around = (
            None if same else eqx.nn.Linear(size, width, dtype=PRECISION, key=three)
        )

    @property
    def reach(self) -> int:
        """Samples before the present one that are needed."""
        return self.first.reach + self.second.reach

    def __call__(self, x: Float[Array, "n k"]) -> Float[Array, "m l"]:
        """The last m = n - reach samples."""
        through = jax.nn.relu(self.second(jax.nn.relu(self.first(x))))
        past = x[self.reach :]
        past = past if self.around is None else jax.vmap(self.around)(past)
        return through + past


class Convolutional(eqx.Module):
    """Layers of convolutions over the present and earlier samples, and a linear map.

    A convolution has no state, so that the output at the first sample does not enter.
    Before the first sample, input and slope are taken to have been what they are there.

    **Attributes:**

    - `layers`: one after the other.
    - `readout`: from the last layer to the output.
    """

    layers: tuple[Taps | Residual, ...]
    readout: eqx.nn.Linear

    @property
    def reach(self) -> int:
        """Samples before the present one that an output depends on."""
        return sum(layer.reach for layer in self.layers)

    def __call__(
        self, inputs: Float[Array, "n 2"], w0: Float[Array, ""]
    ) -> Float[Array, " n"]:
        """Outputs of standard inputs and slopes."""
        x = jnp.concatenate([jnp.tile(inputs[0], (self.reach, 1)), inputs])
        for layer in self.layers:
            x = jax.nn.relu(layer(x))
        return jax.vmap(self.readout)(x)


class TCN(AbstractSequenceBaseline):
    """A temporal convolutional network: residual blocks whose dilation doubles from one
    to the next; without weight normalisation and dropout.

    **Attributes:**

    - `width`: channels.
    - `depth`: blocks.
    - `kernel`: samples of a convolution.
    - `stages`, `rate`: of the training; see `AbstractSequenceBaseline`.

    **Source:** Bai, Kolter and Koltun (2018), arXiv 1803.01271.
    """

    width: int = 16
    depth: int = 5
    kernel: int = 5
    stages: tuple[Stage, ...] = (Stage(1000, 1500),)
    rate: float = 5e-3

    def __check_init__(self):
        for name in ("width", "depth", "kernel"):
            checks.count(name, getattr(self, name))

    def network(self, key):
        """Blocks of dilation 1, 2, 4, ..., and the map to the output."""
        last, *keys = jax.random.split(key, self.depth + 1)
        sizes = (2, *[self.width] * (self.depth - 1))
        blocks = tuple(
            Residual(size, self.width, self.kernel, 2**level, k)
            for level, (size, k) in enumerate(zip(sizes, keys, strict=True))
        )
        readout = eqx.nn.Linear(self.width, "scalar", dtype=PRECISION, key=last)
        return Convolutional(blocks, readout)


class FCN(AbstractSequenceBaseline):
    """A fully convolutional network: three convolutions over 8, 5 and 3 samples, so
    over 14 in all, of one, two and one times the width; without batch normalisation,
    and with a map to the output at every sample where the source pools over all.

    **Attributes:**

    - `width`: channels of the first and the last layer.
    - `stages`, `rate`: of the training; see `AbstractSequenceBaseline`.

    **Source:** Wang, Yan and Oates (2017), doi 10.1109/IJCNN.2017.7966039.
    """

    width: int = 32
    stages: tuple[Stage, ...] = (Stage(1000, 3000),)
    rate: float = 2e-3

    def __check_init__(self):
        checks.count("width", self.width)

    def network(self, key):
        """The three layers, and the map to the output."""
        last, *keys = jax.random.split(key, 4)
        widths = (2, self.width, 2 * self.width, self.width)
        layers = tuple(
            Taps(size, width, kernel, 1, k)
            for size, width, kernel, k in zip(
                widths[:-1], widths[1:], (8, 5, 3), keys, strict=True
            )
        )
        readout = eqx.nn.Linear(self.width, "scalar", dtype=PRECISION, key=last)
        return Convolutional(layers, readout)


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
        checks.count("width", self.width)

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
