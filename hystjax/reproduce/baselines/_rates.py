"""What a baseline is, and those that learn the derivative: linear regression, an
evolutionary fit, and a network with its training."""

import sys
import time
from abc import abstractmethod
from collections.abc import Mapping
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optax
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, ArrayLike, Float, Int, PRNGKeyArray
from scipy.optimize import differential_evolution

from ..._core import checks
from ..._core.checks import InputError, described
from ..._core.show import on_terminal
from ..._core.solution import RESULTS, Solution, outcome
from ...library import Library, Polynomial, Term, Track
from ...models import AbstractLaw, AbstractModel, SparseModel
from ...recording import Recording, as_recording
from ...regression import Ridge, compress
from ...regression.differentiation import AbstractDifferentiation, FiniteDifference
from ...saving import register
from ...signals import Signals
from ...simulation import AbstractSimulation, FixedStep

Rows = Int[ArrayLike, " r"]


class AbstractBaseline(eqx.Module):
    """Another way from a recording to a model.

    Free run and errors are those of every model: `simulate` and `judge` take the
    `value` of what `fit` returns.
    """

    @abstractmethod
    def fit(self, recording: Recording, *, key: PRNGKeyArray | None = None) -> Solution:
        """Fit a model.

        **Arguments:**

        - `recording`: of n samples.
        - `key`: a `jax.random` key, for what starts at random.

        **Returns:** a `Solution` whose `value` is an `AbstractModel` or an
        `AbstractSequenceModel`.
        """


class AbstractRateBaseline(AbstractBaseline):
    """A baseline that learns the derivative of the output from given features of a
    sample.

    **Attributes:**

    - `library`: the k features.
    - `differentiation`: how derivatives are estimated, of output and input alike.
    """

    library: eqx.AbstractVar[Library]
    differentiation: eqx.AbstractVar[AbstractDifferentiation]

    @abstractmethod
    def fit(
        self,
        recording: Recording,
        *,
        key: PRNGKeyArray | None = None,
        rows: Rows | None = None,
    ) -> Solution:
        """As every baseline's, with `rows` for the numbers of the samples that are
        fitted, from 0 on, all by default."""

    def rows(
        self, recording: Recording, rows: Rows | None
    ) -> tuple[Float[Array, "r k"], Float[Array, " r"]]:
        """Features and derivative of some samples, or of all."""
        as_recording(recording, "fit(recording)")
        w, u, dw, du = _differentiated(recording, self.differentiation)
        chosen = _chosen(rows, len(recording))
        memory = self.library.signals(recording.path)
        return self.library(w, u, du, memory)[chosen], dw[chosen]


def _chosen(rows: Rows | None, n: int) -> Any:
    """Which of n samples are looked at.

    **Raises:** `InputError` for numbers of samples that are not there, of which JAX
    would take the nearest one that is.
    """
    if rows is None:
        return slice(None)
    if not checks.is_concrete(rows):
        return rows
    chosen = np.asarray(rows)
    if chosen.dtype.kind not in "iu" or chosen.ndim != 1 or not chosen.size:
        raise InputError(
            "`rows` must be a 1-D array of numbers of samples, such as "
            f"`np.arange(0, {n}, 2)`; got {described(rows)}."
        )
    if chosen.min() < 0 or chosen.max() >= n:
        raise InputError(
            f"`rows` must be numbers of samples, from 0 to {n - 1}; got some from "
            f"{chosen.min()} to {chosen.max()}."
        )
    return chosen


def _differentiated(
    recording: Recording, differentiation: AbstractDifferentiation
) -> tuple[Float[Array, " n"], ...]:
    """w, u, dw/dt and du/dt at the samples.

    Output and input pass through the same differentiation (and its smoothing), so that
    its bias is the same on both sides of a law.
    """
    w, dw = differentiation.estimate(recording.t, recording.w)
    u, du = differentiation.estimate(recording.t, recording.u)
    return w, u, dw, du


def rates(
    model: AbstractModel,
    recording: Recording,
    *,
    rows: Rows | None = None,
    differentiation: AbstractDifferentiation = FiniteDifference(),
) -> tuple[Float[Array, " r"], Float[Array, " r"]]:
    """Derivative of a recording's output, and as predicted from the same samples.

    An error of these is no error of a free run: the measured output enters at every
    sample, and nothing adds up.

    **Arguments:**

    - `model`: a law w' = f(w, u, u').
    - `recording`: of n samples.
    - `rows`: numbers of the samples to look at, from 0 on, all by default.
    - `differentiation`: how derivatives are estimated.

    **Raises:** `InputError` for another model, whose flow is not that of the output,
    and for samples that are not there.
    """
    if not isinstance(model, AbstractLaw) or model.target != "rate":
        raise InputError(
            "`model` must be a law w' = f(w, u, u'), whose output is its state; got "
            f"{described(model)}. Judge it by free run instead."
        )
    as_recording(recording, "rates(model, recording)")
    w, u, dw, du = _differentiated(recording, differentiation)
    chosen = _chosen(rows, len(recording))
    track = Track(model.memory, recording.path)
    now = Signals(recording.t, u, du)
    rate = jax.vmap(model.rate)(w, jax.vmap(track.at)(recording.t), now)
    return dw[chosen], rate[chosen]


_CONSTANT = Term()


class Linear(AbstractRateBaseline):
    """Linear or ridge regression of the derivative, with an intercept that is not
    penalised: what scikit-learn's `LinearRegression` and `Ridge` compute.

    The model that it fits is a `SparseModel` with all features and the constant.

    **Attributes:**

    - `library`: the k features, without the constant.
    - `ridge`: penalty of the squared coefficients, in their own units; 0 for least
        squares.
    - `differentiation`: how derivatives are estimated.

    **Source:** Hoerl and Kennard (1970), doi 10.1080/00401706.1970.10488634.
    """

    library: Library
    ridge: ArrayLike = 0.0
    differentiation: AbstractDifferentiation = FiniteDifference()

    def __check_init__(self):
        checks.kind("library", self.library, Library, "library.BoucWen()")
        checks.positive("ridge", self.ridge, zero=True)
        if _CONSTANT in self.library.terms:
            raise InputError(
                "`library` must not hold the constant 1: the intercept is one already, "
                "and not penalised."
            )

    def fit(self, recording, *, rows=None, key=None):
        """As every baseline's; nothing is random. `stats` holds `residual`, the misfit
        of the derivative relative to its deviation from the mean."""
        features, rate = self.rows(recording, rows)
        centre, mean = jnp.mean(features, axis=0), jnp.mean(rate)
        problem = compress(features - centre, rate - mean)
        slopes = Ridge(self.ridge, normalise=False).fit(problem).coefficients
        everything = jnp.append(mean - centre @ slopes, slopes)
        law = SparseModel(
            Library((_CONSTANT, *self.library.terms), self.library.numbers),
            everything,
            jnp.ones(len(everything), bool),
            names=recording.names,
            units=recording.units,
        )
        residual = problem.residual(slopes)
        result = outcome(jnp.isfinite(residual), RESULTS.diverged)
        return Solution(law, result, {"residual": residual})


_LOST = 1e6  # loss of a law that diverges: worse than any other, and finite


class DifferentialEvolution(AbstractBaseline):
    """Search for the parameters of a model whose free run has the least mean squared
    error, by SciPy's differential evolution. A generation is simulated in one call.

    **Attributes:**

    - `model`: whose parameters are sought.
    - `bounds`: lowest and highest value by parameter; others keep theirs.
    - `generations`: most of them.
    - `population`: members of a generation for each parameter.
    - `tolerance`: spread of the losses of a generation, over their mean, at which the
        search ends.
    - `method`: how free runs are integrated.

    **Source:** Storn and Price (1997), doi 10.1023/A:1008202821328.
    """

    model: AbstractModel
    bounds: Mapping[str, tuple[float, float]]
    generations: int = 1000
    population: int = 15
    tolerance: float = 0.01
    method: AbstractSimulation = FixedStep()

    def __check_init__(self):
        for name in ("generations", "population"):
            checks.count(name, getattr(self, name))
        checks.positive("tolerance", self.tolerance)
        checks.kind("model", self.model, AbstractModel, "models.Duhem(1.0, 1.0, 0.5)")
        known = self.model.parameters()
        if not isinstance(self.bounds, Mapping) or not self.bounds:
            raise InputError(
                "`bounds` must be a lower and an upper one for each parameter that is "
                f"sought, of {', '.join(known)}, such as {{{next(iter(known))!r}: "
                f"(0.0, 1.0)}}; got {self.bounds!r}."
            )
        for name, pair in self.bounds.items():
            if name not in known or not _is_interval(pair):
                raise InputError(
                    "`bounds` must be a finite lower and a higher upper one for "
                    f"parameters of the model ({', '.join(known)}); got {name!r}: "
                    f"{pair!r}."
                )

    def fit(self, recording, *, key=None):
        """As every baseline's.

        **Returns:** a `Solution` whose `value` is a model like the one given, whose
        `result` tells whether the search ended before its last generation, and whose
        `stats` hold `loss`, the mean squared error over the output's variance;
        `num_steps`, the generations; and `simulations`, the free runs.

        **Raises:** `InputError` without `key`.
        """
        as_recording(recording, "fit(recording)")
        key = check_key("evolution", key)
        names = tuple(self.bounds)

        def losses(values):
            return np.asarray(
                _losses(self.model, names, jnp.asarray(values), recording, self.method)
            )

        found = differential_evolution(
            losses,
            list(self.bounds.values()),
            maxiter=self.generations,
            popsize=self.population,
            tol=self.tolerance,
            rng=np.random.default_rng(np.asarray(jax.random.key_data(key))),
            polish=False,
            updating="deferred",
            vectorized=True,
        )
        value = _with(self.model, names, jnp.asarray(found.x))
        result = outcome(jnp.array(found.success), RESULTS.max_steps_reached)  # pyright: ignore
        result = RESULTS.where(jnp.array(found.fun < _LOST), result, RESULTS.diverged)  # pyright: ignore
        stats = {
            "loss": jnp.array(found.fun),
            "num_steps": jnp.array(found.nit),
            "simulations": jnp.array((found.nit + 1) * len(found.population)),
        }
        return Solution(value, result, stats)


def _is_interval(pair: Any) -> bool:
    try:
        low, high = map(float, pair)
    except (TypeError, ValueError):
        return False
    return -np.inf < low < high < np.inf


def _with(model, names, values):
    return model.with_parameters(dict(zip(names, values, strict=True)))


@eqx.filter_jit
def _losses(model, names, values, recording, method):
    """Mean squared errors of the models with some `values`, shape (p, members)."""
    path, w = recording.path, recording.w

    def loss(values):
        run, _, _ = method.integrate(
            _with(model, names, values), path, w[0], jnp.max(jnp.abs(w))
        )
        value = jnp.mean((run - w) ** 2) / jnp.var(w)
        return jnp.where(value < _LOST, value, _LOST)  # NaN too

    return jax.vmap(loss, in_axes=1)(values)


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
    progress: bool,
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
        if progress and on_terminal():
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


def check_key(what: str, key: PRNGKeyArray | None) -> PRNGKeyArray:
    """The key that `what` starts from; `InputError` without one, and for a seed."""
    if key is None:
        raise InputError(f"{what} needs a `key`, such as `jax.random.key(0)`.")
    checks.key("key", key)
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
class NeuralLaw(AbstractLaw):
    """The law w' = network(features of w, u, u').

    **Attributes:**

    - `library`: the k features.
    - `network`: from k numbers to one.
    - `names`, `units`: of input and output; keyword only.
    """

    library: Library
    network: eqx.nn.MLP

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

    def parameters(self):
        flat, _ = ravel_pytree(self._arrays())
        return {f"p{i}": value for i, value in enumerate(flat)}

    def with_parameters(self, values):
        flat, shaped = ravel_pytree(self._arrays())
        known = {f"p{i}": i for i in range(len(flat))}
        for name in values:
            if name not in known:
                raise InputError(
                    f"there is no parameter {name!r}. The parameters are p0 to "
                    f"p{len(flat) - 1}."
                )
        places = jnp.array([known[name] for name in values], int)
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
        checks.kind("library", self.library, Library, "library.BoucWen()")
        for name in ("width", "depth", "epochs"):
            checks.count(name, getattr(self, name))

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
        key = check_key("a network", key)
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
