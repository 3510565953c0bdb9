"""An evolutionary fit."""

from collections.abc import Mapping

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from scipy.optimize import differential_evolution

from .. import _checks
from .._errors import InputError
from .._solution import RESULTS, Solution, outcome
from ..models import AbstractModel
from ..simulation import AbstractSimulation, FixedStep
from ._base import AbstractBaseline

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
            _checks.positive(name, getattr(self, name))
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
