"""What a baseline is; linear regression of the derivative, and an evolutionary fit."""

from abc import abstractmethod
from collections.abc import Mapping

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float, Int, PRNGKeyArray
from scipy.optimize import differential_evolution

from ..._core import checks
from ..._core.checks import InputError
from ..._core.solution import RESULTS, Solution, outcome
from ...library import Library, Term, Track
from ...models import AbstractModel, SparseModel
from ...recording import Recording
from ...regression import Ridge, compress
from ...regression.differentiation import AbstractDifferentiation, FiniteDifference
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
        fitted, all by default."""

    def rows(
        self, recording: Recording, rows: Rows | None
    ) -> tuple[Float[Array, "r k"], Float[Array, " r"]]:
        """Features and derivative of some samples, or of all."""
        w, u, dw, du = _differentiated(recording, self.differentiation)
        chosen = slice(None) if rows is None else rows
        memory = self.library.signals(recording.path)
        return self.library(w, u, du, memory)[chosen], dw[chosen]


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

    - `model`: one whose output is its state.
    - `recording`: of n samples.
    - `rows`: numbers of the samples to look at, all by default.
    - `differentiation`: how derivatives are estimated.

    **Raises:** `InputError` for a model with hidden states.
    """
    if model.hidden:  # of which the flow is none of the output
        raise InputError(
            f"`model` must be a law, whose output is its state; the states of a "
            f"{type(model).__name__} are hidden. Judge it by free run instead."
        )
    w, u, dw, du = _differentiated(recording, differentiation)
    chosen = slice(None) if rows is None else rows
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
        for name in ("generations", "population", "tolerance"):
            checks.positive(name, getattr(self, name))
        known = self.model.parameters()
        for name, (low, high) in self.bounds.items():
            if name not in known or not -np.inf < low < high < np.inf:
                raise InputError(
                    "`bounds` must be a finite lower and a higher upper one for "
                    f"parameters of the model ({', '.join(known)}); got {name!r}: "
                    f"({low:g}, {high:g})."
                )

    def fit(self, recording, *, key=None):
        """As every baseline's.

        **Returns:** a `Solution` whose `value` is a model like the one given, whose
        `result` tells whether the search ended before its last generation, and whose
        `stats` hold `loss`, the mean squared error over the output's variance;
        `num_steps`, the generations; and `simulations`, the free runs.

        **Raises:** `InputError` without `key`.
        """
        if key is None:
            raise InputError("evolution needs a `key`, such as `jax.random.key(0)`.")
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
