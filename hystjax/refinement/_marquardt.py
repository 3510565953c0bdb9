"""Least squares in coordinates that are scaled already, and its steps for people who
wait."""

import sys
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import optimistix as optx
from jaxtyping import Array, Float, Int, PyTree, Scalar

from .._core.errors import InputError
from ..regression import compress

_LEAST_GAIN = 1e-3  # of the reduction that was predicted, for a step to be kept
_LEAST_FACTOR = 0.1  # by which damping falls after a step as good as predicted
_LEAST_DAMPING = 1e-9


class _State(eqx.Module):
    """Where the search is.

    **Attributes:** at the best point so far, the `residuals` and their `jacobian`; the
    `damping`, and its `growth` should the next step fail; this step, the `change`, and
    the reduction of the loss that is `predicted` for it; and how many steps there were.
    """

    residuals: Float[Array, " m"]
    jacobian: Float[Array, "m q"]
    damping: Scalar
    growth: Scalar
    change: Float[Array, " q"]
    predicted: Scalar
    num_steps: Int[Array, ""]

    @property
    def loss(self) -> Scalar:
        """Half the sum of squares."""
        return _loss(self.residuals)


def _silent(**_) -> None:
    """Nothing is shown."""


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
    - `verbose`: called at each step with `num_steps` and `loss_this_step`, each a pair
        of a name and a value, as solvers of Optimistix do.
    - `norm`: not used.

    **Source:** Nielsen (1999), Damping parameter in Marquardt's method, report
    IMM-REP-1999-05, Technical University of Denmark.
    """

    rtol: float = 1e-12
    atol: float = 1e-24
    damping: float = 1e-6
    verbose: Callable[..., None] = _silent
    norm: Callable[[PyTree], Scalar] = optx.max_norm

    def init(self, fn, y, args, options, f_struct, aux_struct, tags):
        if "jacobian" in options:
            residuals, jacobian = options["residuals"], options["jacobian"]
        else:
            residuals, jacobian, _ = _linearised(fn, y, args)
        damping, growth = (jnp.asarray(x, y.dtype) for x in (self.damping, 2.0))
        ahead = _damped(residuals, jacobian, damping)
        return _State(residuals, jacobian, damping, growth, *ahead, jnp.array(0))

    def step(self, fn, y, args, options, state, tags):
        residuals, jacobian, aux = _linearised(fn, y + state.change, args)
        loss, num_steps = _loss(residuals), state.num_steps + 1
        self.verbose(num_steps=("Step", num_steps), loss_this_step=("Loss", loss))
        gain = (state.loss - loss) / state.predicted
        kept = gain > _LEAST_GAIN  # not where the loss is NaN
        y, residuals, jacobian = jax.tree.map(
            lambda new, old: jnp.where(kept, new, old),
            (y + state.change, residuals, jacobian),
            (y, state.residuals, state.jacobian),
        )
        easier = jnp.maximum(_LEAST_FACTOR, 1 - (2 * gain - 1) ** 3)
        damping = state.damping * jnp.where(kept, easier, state.growth)
        damping = jnp.maximum(damping, _LEAST_DAMPING)
        growth = jnp.where(kept, 2.0, 2 * state.growth)
        ahead = _damped(residuals, jacobian, damping)
        state = _State(residuals, jacobian, damping, growth, *ahead, num_steps)
        return y, state, aux

    def terminate(self, fn, y, args, options, state, tags):
        done = state.predicted <= self.rtol * state.loss + self.atol
        return done, optx.RESULTS.successful

    def postprocess(self, fn, y, aux, args, options, state, tags, result):
        # The last step is too short to be looked at, but not to be taken.
        done = result == optx.RESULTS.successful
        return jnp.where(done, y + state.change, y), aux, {}


def _loss(residuals):
    return jnp.sum(residuals**2) / 2


def _linearised(fn, y, args):
    residuals, push, aux = jax.linearize(lambda y: fn(y, args), y, has_aux=True)
    identity = jnp.eye(y.size, dtype=y.dtype)
    return residuals, jax.vmap(push, out_axes=-1)(identity), aux


def _damped(residuals, jacobian, damping):
    """The step to the minimum of the damped linear model, and its reduction of it."""
    everything = jnp.ones(jacobian.shape[1], bool)
    change = compress(jacobian, -residuals).solve(everything, damping)
    slope = residuals @ jacobian
    return change, change @ (damping * change - slope) / 2


def watched(solver: Any) -> Any:
    """An Optimistix solver that prints its step and loss on one line of standard error,
    where that is a terminal.

    **Raises:** `InputError` for a solver without steps to watch.
    """
    if not sys.stderr.isatty():
        return solver
    if not hasattr(solver, "verbose"):
        raise InputError(
            f"`progress` needs a solver with steps to show, and {type(solver).__name__}"
            " has none; leave it out."
        )
    return eqx.tree_at(lambda each: each.verbose, solver, _show)


def _show(*, num_steps, loss_this_step, **_) -> None:
    jax.debug.callback(_print, num_steps[1], loss_this_step[1])


def _print(step, loss) -> None:
    # Back to the start of the line: the next step overwrites this one.
    print(f"step {int(step)}: loss {float(loss):.6g} ", end="\r", file=sys.stderr)
