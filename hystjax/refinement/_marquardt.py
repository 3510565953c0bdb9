"""Least squares in coordinates that are scaled already."""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import optimistix as optx
from jaxtyping import Array, Bool, Float, PyTree, Scalar

from ..regression import compress

_LEAST_GAIN = 1e-3  # of the reduction that was predicted, for a step to be kept
_LEAST_FACTOR = 0.1  # by which damping falls after a step as good as predicted
_LEAST_DAMPING = 1e-9


class _State(eqx.Module):
    """Where the search is.

    **Attributes:** the next point to look at, `trial`, and the reduction `predicted`
    there; at the best point so far, the residuals, their `jacobian` and the `loss`;
    the `damping`, and its `growth` should the trial fail; whether it is the `first`;
    and whether there is nothing left to gain, `done`.
    """

    trial: Float[Array, " q"]
    predicted: Scalar
    residuals: Float[Array, " m"]
    jacobian: Float[Array, "m q"]
    loss: Scalar
    damping: Scalar
    growth: Scalar
    first: Bool[Array, ""]
    done: Bool[Array, ""]


class LevenbergMarquardt(optx.AbstractLeastSquaresSolver):
    """Levenberg-Marquardt for vectors in whitened coordinates, as an Optimistix solver.

    It takes nearly whole Gauss-Newton steps at once, damps only as much as they fail,
    and ends when the model of the residuals promises no further reduction, which takes
    a third of the steps of `optimistix.LevenbergMarquardt` where starts are good.

    **Attributes:**

    - `rtol`, `atol`: half the sum of squares could still be reduced by `rtol` times
        itself, plus `atol`, where the search ends. Being quadratic about its minimum,
        it tells a distance from there by the root of that.
    - `damping`: of the first step.
    - `norm`: not used.

    **Source:** Nielsen (1999), Damping parameter in Marquardt's method, report
    IMM-REP-1999-05, Technical University of Denmark.
    """

    rtol: float = 1e-12
    atol: float = 1e-24
    damping: float = 1e-4
    norm: Callable[[PyTree], Scalar] = optx.max_norm

    def init(self, fn, y, args, options, f_struct, aux_struct, tags):
        m, q = f_struct.size, y.size
        number = jnp.zeros((), y.dtype)
        return _State(
            trial=y,
            predicted=number + 1.0,
            residuals=jnp.zeros(m, y.dtype),
            jacobian=jnp.zeros((m, q), y.dtype),
            loss=number + jnp.inf,
            damping=number + self.damping,
            growth=number + 2.0,
            first=jnp.array(True),
            done=jnp.array(False),
        )

    def step(self, fn, y, args, options, state, tags):
        residuals, push, aux = jax.linearize(
            lambda y: fn(y, args), state.trial, has_aux=True
        )
        jacobian = jax.vmap(push, out_axes=-1)(jnp.eye(y.size, dtype=y.dtype))
        loss = jnp.sum(residuals**2) / 2
        gain = jnp.where(state.first, 0.5, (state.loss - loss) / state.predicted)
        kept = gain > _LEAST_GAIN  # not where the loss is NaN
        seen = (state.trial, residuals, jacobian, loss)
        before = (y, state.residuals, state.jacobian, state.loss)
        y, residuals, jacobian, loss = jax.tree.map(
            lambda new, old: jnp.where(kept, new, old), seen, before
        )
        factor = jnp.maximum(_LEAST_FACTOR, 1 - (2 * gain - 1) ** 3)
        factor = jnp.where(kept, factor, state.growth)
        damping = jnp.maximum(state.damping * factor, _LEAST_DAMPING)
        change, predicted = _damped(jacobian, residuals, damping)
        state = _State(
            trial=y + change,
            predicted=predicted,
            residuals=residuals,
            jacobian=jacobian,
            loss=loss,
            damping=damping,
            growth=jnp.where(kept, 2.0, 2 * state.growth),
            first=jnp.array(False),
            done=predicted <= self.rtol * loss + self.atol,
        )
        return y, state, aux

    def terminate(self, fn, y, args, options, state, tags):
        lost = ~state.first & ~jnp.isfinite(state.loss)
        result = optx.RESULTS.where(
            lost, optx.RESULTS.nonlinear_divergence, optx.RESULTS.successful
        )
        return state.done | lost, result

    def postprocess(self, fn, y, aux, args, options, state, tags, result):
        # The last step is too short to be worth a look, but not to be taken.
        return jnp.where(state.done, state.trial, y), aux, {}


def _damped(jacobian, residuals, damping):
    """The step to the minimum of the damped linear model, and its reduction of it."""
    everything = jnp.ones(jacobian.shape[1], bool)
    change = compress(jacobian, -residuals).solve(everything, damping)
    slope = residuals @ jacobian
    return change, change @ (damping * change - slope) / 2
