"""Least squares over the unknowns, scaled so that units do not matter, and compressed:
as many residuals as there are unknowns, and one.

All that Gauss-Newton methods know of residuals r and their Jacobian J is
[J r]'[J r]. Its Cholesky factor has the same product: the last column takes the place
of r, the others that of J, and whatever a solver does with them no longer depends on
the number of samples. The condition number is squared, which does no harm to
coordinates in which the first Jacobian is orthogonal.
"""

import sys
from collections.abc import Callable
from dataclasses import replace
from typing import Any, TypeAlias, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import optimistix as optx
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float, Int, PyTree, Scalar

from .._core.checks import InputError
from .._core.compiling import jit, largest
from .._core.show import on_terminal
from .._core.solution import RESULTS
from ..least_squares import column_lengths, compress
from ..library import at
from ._choices import Parameters
from ._objective import Objective, Unknowns, fitted

Values = TypeVar("Values")


def value_and_columns(
    function: Callable[[Float[Array, " q"]], Values], x: Float[Array, " q"]
) -> tuple[Values, Values]:
    """f(x), and the q columns of its Jacobian along a first axis."""

    # Compiles faster than `jax.linearize` does, which splits the program in two.
    def along(direction):
        return jax.jvp(function, (x,), (direction,))

    return jax.vmap(along, out_axes=(None, 0))(jnp.eye(len(x), dtype=x.dtype))


class Problem(eqx.Module):
    """A fit as least squares over one vector x: unbounded values, and of where pieces
    start what is fitted.

    **Attributes:** the `objective`; the `given` unknowns, for all that is not fitted;
    and the `stage`, which are the further arguments of `Objective.residuals`.
    """

    objective: Objective
    given: Unknowns
    stage: tuple

    def unknowns(self, x: Float[Array, " q"]) -> Unknowns:
        """What is fitted, in natural units."""
        found: Unknowns = ravel_pytree(fitted(self.objective, self.given))[1](x)
        values = self.objective.parameters.bounded(found.values)
        found = eqx.tree_at(lambda u: u.values, found, values)
        return eqx.combine(found, self.given)

    def residuals(self, x: Float[Array, " q"]) -> Float[Array, " m"]:
        """What is squared and summed."""
        parts = self.objective.residuals(self.unknowns(x), *self.stage)
        return jnp.concatenate([part.ravel() for part in parts])


class Whitened(eqx.Module):
    """A problem in other coordinates z, where x = origin + spread z."""

    problem: Problem
    origin: Float[Array, " q"]
    spread: Float[Array, "q q"]

    def residuals(self, z: Float[Array, " q"]) -> Float[Array, " m"]:
        """The problem's residuals."""
        return self.problem.residuals(self.origin + self.spread @ z)


@eqx.filter_custom_jvp
def compressed(z: Float[Array, " q"], whitened: Whitened) -> Float[Array, " q+1"]:
    """q + 1 numbers with the sum of squares of the residuals at z, and the same
    products of their derivatives with them and with each other."""
    return factor(z, whitened)[:, -1]


@compressed.def_jvp
def _(primals, tangents):
    # A solver's derivatives, by z. The derivative of what it ends at is one of
    # J'r = triangle[:, :-1]' triangle[:, -1], and gets here with `factor` itself.
    z, whitened = primals
    triangle = factor(z, whitened)
    return triangle[:, -1], triangle[:, :-1] @ tangents[0]


# A program has several of these: this traces them once.
@jit
def factor(z: Float[Array, " q"], whitened: Whitened) -> Float[Array, "q+1 q+1"]:
    """The triangle with the product [J r]'[J r], where columns of J that are not finite
    count as zero."""
    value, columns = value_and_columns(whitened.residuals, z)
    rows = jnp.concatenate([columns, value[None]])
    usable = jnp.all(jnp.isfinite(rows), axis=1)
    rows = jnp.where(usable[:, None], rows, 0.0)
    # The product does not depend on what scales it: neither do its derivatives.
    lengths = column_lengths(jax.lax.stop_gradient(rows).T)
    scaled = rows / lengths[:, None]
    # Columns that depend on each other to rounding still have a factor.
    least = 10 * len(lengths) * jnp.finfo(z.dtype).eps
    product = scaled @ scaled.T + least * jnp.eye(len(lengths), dtype=z.dtype)
    return jnp.linalg.cholesky(product).T * lengths


_SHORTEST = 1e-6  # smallest singular value that is divided by, relative
_PRIOR = 0.1  # residual, over the output's spread, that doubling a parameter is

Solver: TypeAlias = optx.AbstractLeastSquaresSolver | optx.AbstractMinimiser


class Minimum(eqx.Module):
    """Where a fit ended.

    **Attributes:** the `unknowns` there; the `loss`, half the squared residuals; the
    `result`; and how many steps it took.
    """

    unknowns: Unknowns
    loss: Float[Array, ""]
    result: RESULTS
    num_steps: Int[Array, ""]


def minimise(
    objective: Objective,
    first: Unknowns,
    solver: Solver,
    max_steps: int,
    horizon: Float[Array, ""] | float = 1.0,
    gap_weight: Float[Array, ""] | float = 0.0,
    gain: Float[Array, ""] | None = None,
) -> Minimum:
    """Fit the unknowns, from the first ones.

    Unbounded coordinates are whitened by the first Jacobian, so that neither units nor
    correlations matter to damping and tolerances.
    """
    parameters = objective.parameters
    values = parameters.unbounded(first.values)
    asked = eqx.tree_at(lambda u: u.values, fitted(objective, first), values)
    origin, _ = ravel_pytree(asked)
    free, _ = ravel_pytree(_free(objective, asked))
    firm = jnp.zeros_like(origin).at[: len(values)].set(_firmness(parameters, values))
    problem = Problem(objective, first, (horizon, gap_weight, gain))

    def descend(x, pin):
        pinned = x.at[: len(values)].set(parameters.pinned(x[: len(values)]))
        x = jnp.where(pin, pinned, x) if parameters.limited else x
        x, end = _descend(problem, x, free, firm, solver, max_steps)
        return x, (x, end)

    if parameters.limited:
        # Towards a bound the steps get ever shorter: on it, the rest is fitted fast.
        # One program for both.
        ends = jax.lax.scan(descend, origin, jnp.array([False, True]))[1]
        first, on_bounds = at(ends, 0), at(ends, 1)
        x, end = _better(on_bounds, first)
    else:
        x, end = descend(origin, False)[1]
    loss, result, num_steps = end
    return Minimum(problem.unknowns(x), loss, result, num_steps)


def _descend(problem: Problem, origin, free, firm, solver: Solver, max_steps: int):
    """Where least squares lead to from a point; the loss, result and steps."""
    arrays = jax.lax.stop_gradient(eqx.filter(problem, eqx.is_array))
    settled = eqx.combine(arrays, problem)
    begun = jax.lax.stop_gradient((origin, free, firm))
    x, spread, result, num_steps = _search(settled, *begun, solver, max_steps)
    # How the minimum moves with what the problem is made of, and with nothing else. It
    # is zero by way of x: of a bare zero JAX would not know, where derivatives are
    # taken of a batch, that it is one of each lane.
    moved, _ = optx.ImplicitAdjoint().apply(
        lambda inputs: (jnp.where(jnp.isnan(inputs[1]), 0.0, 0.0), None),
        lambda z, _, inputs: _slope(z, Whitened(*inputs[:3])),
        (problem, x, spread),
        frozenset(),
    )
    x = x + spread @ moved
    loss = jnp.sum(problem.residuals(x) ** 2) / 2
    return x, (loss, result, num_steps)


def _slope(z: Float[Array, " q"], whitened: Whitened) -> Float[Array, " q"]:
    """The gradient of the loss, in these coordinates."""
    triangle = factor(z, whitened)
    return triangle[:, :-1].T @ triangle[:, -1]


def _search(problem: Problem, origin, free, firm, solver: Solver, max_steps: int):
    """Where a solver gets from a point; its coordinates, the result and the steps."""

    def whitening(jacobian):
        return free[:, None] * _whitening(jacobian, firm)

    nowhere, plain = jnp.zeros_like(origin), jnp.eye(len(origin), dtype=origin.dtype)
    ours = isinstance(solver, LevenbergMarquardt)
    if not ours:  # it looks at coordinates that are whitened before
        first = factor(nowhere, Whitened(problem, origin, plain))
        plain = whitening(first[:, :-1])
    solution = optx.least_squares(
        compressed,
        solver,
        nowhere,
        Whitened(problem, origin, plain),
        options={"whitening": whitening} if ours else None,
        max_steps=max_steps + ours,
        throw=False,
    )
    spread = solution.state.spread if ours else plain
    x = origin + spread @ solution.value
    steps = jnp.asarray(solution.stats["num_steps"]) - ours
    return x, spread, RESULTS.promote(solution.result), steps


def _better(later, before):
    """The end with the lesser loss, the later one if they are equal but for rounding;
    and the steps of both."""
    x, (loss, result, steps) = later
    old_x, (old_loss, old_result, old_steps) = before
    good = loss <= old_loss * (1 + 1e-9)
    result = RESULTS.where(good, result, old_result)  # pyright: ignore
    loss = jnp.where(good, loss, old_loss)
    return jnp.where(good, x, old_x), (loss, result, steps + old_steps)


def _free(objective: Objective, asked: Unknowns) -> Unknowns:
    """1 where an unknown may move, 0 where a recording starts and the model says so."""
    free = jax.tree.map(jnp.ones_like, asked)
    if asked.starts is None or objective.free == "state":
        return free
    return eqx.tree_at(lambda u: u.starts, free, free.starts.at[:, 0].set(0.0))


def _firmness(parameters: Parameters, values) -> Float[Array, " p"]:
    """What keeps a damped step from changing parameters many times over in directions
    that hardly matter where it starts."""
    limited = jnp.isfinite(parameters.lower) | jnp.isfinite(parameters.upper)
    size = jnp.where(limited, 1.0, jnp.abs(values))
    return jnp.where(size > 0, _PRIOR / jnp.where(size > 0, size, 1.0), 0.0)


def _whitening(triangle, firm) -> Float[Array, "q q"]:
    """Directions in which the residuals, with those of changing the unknowns, change by
    their whole size, independently of each other: the inverse of the Jacobian's
    triangle.

    In these coordinates a damped step is a shortened Gauss-Newton step, however
    correlated the unknowns are. Directions that hardly matter are left short.
    """
    jacobian = jnp.concatenate([triangle, jnp.diag(firm)])
    lengths = column_lengths(jacobian)
    _, sizes, directions = jnp.linalg.svd(jacobian / lengths, full_matrices=False)
    sizes = jnp.maximum(sizes, _SHORTEST * jnp.maximum(sizes[0], 1e-3))
    # The minimum does not depend on coordinates: neither do its derivatives.
    return jax.lax.stop_gradient(directions.T / sizes / lengths[:, None])


_LEAST_GAIN = 1e-3  # of the reduction that was predicted, for a step to be kept
_LEAST_FACTOR = 0.1  # by which damping falls after a step as good as predicted
_LEAST_DAMPING = 1e-9
_ROUNDED = 30  # roundings, of residuals that are near one, hide what is less


class _State(eqx.Module):
    """Where the search is.

    **Attributes:** at the best point so far, the `residuals` and their `jacobian`; the
    `spread` of its coordinates; the `damping`, and its `growth` should the next step
    fail; this step, the `change`, and the reduction of the loss that is `predicted` for
    it; and how many steps there were, -1 where nothing has been looked at.
    """

    residuals: Float[Array, " m"]
    jacobian: Float[Array, "m q"]
    spread: Float[Array, "q q"]
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

    Its first step goes nowhere: it looks at where the search begins, as all others do
    at where they get, so that the residuals are compiled once. The option `whitening`
    gives, of their Jacobian there, the coordinates of all further steps.

    It takes nearly whole Gauss-Newton steps at once, damps only as much as they fail,
    and ends when the model of the residuals promises no further reduction, which takes
    a third of the steps of `optimistix.LevenbergMarquardt` where starts are good.

    **Attributes:**

    - `rtol`, `atol`: half the sum of squares could still be reduced by `rtol` times
        itself, plus `atol`, where the search ends. Being quadratic about its minimum,
        it tells a distance from there by the root of that: for residuals over the
        output's spread, by default a billionth, far below what steps are off by. In
        single precision rounding hides more: thirty times that it is there.
    - `damping`: of the first step.
    - `verbose`: called at each step with `num_steps` and `loss_this_step`, each a pair
        of a name and a value, as solvers of Optimistix do.
    - `norm`: not used.

    **Source:** Nielsen (1999), Damping parameter in Marquardt's method, report
    IMM-REP-1999-05, Technical University of Denmark.
    """

    rtol: float = 1e-12
    atol: float = 1e-18
    damping: float = 1e-6
    verbose: Callable[..., None] = _silent
    norm: Callable[[PyTree], Scalar] = optx.max_norm

    def init(self, fn, y, args, options, f_struct, aux_struct, tags):
        m, q = f_struct.size, y.size
        damping, growth = (jnp.asarray(x, y.dtype) for x in (self.damping, 2.0))
        return _State(
            jnp.zeros(m, y.dtype),
            jnp.zeros((m, q), y.dtype),
            jnp.eye(q, dtype=y.dtype),
            damping,
            growth,
            jnp.zeros_like(y),
            jnp.full((), jnp.inf, y.dtype),
            jnp.array(-1),
        )

    def step(self, fn, y, args, options, state, tags):
        begins, num_steps = state.num_steps < 0, state.num_steps + 1
        if "whitening" in options:
            args = replace(args, spread=state.spread)
        residuals, jacobian, aux = _linearised(fn, y + state.change, args)
        spread = state.spread
        if "whitening" in options:
            # Of a batch one answer: where no lane begins it is not computed.
            new = jax.lax.cond(
                largest(begins), options["whitening"], lambda _: spread, jacobian
            )
            spread = jnp.where(begins, new, spread)
            jacobian = jnp.where(begins, jacobian @ spread, jacobian)
        loss = _loss(residuals)
        self.verbose(num_steps=("Step", num_steps), loss_this_step=("Loss", loss))
        gain = (state.loss - loss) / state.predicted
        kept = begins | (gain > _LEAST_GAIN)  # not where the loss is NaN
        y, residuals, jacobian = jax.tree.map(
            lambda new, old: jnp.where(kept, new, old),
            (y + state.change, residuals, jacobian),
            (y, state.residuals, state.jacobian),
        )
        easier = jnp.maximum(_LEAST_FACTOR, 1 - (2 * gain - 1) ** 3)
        damping = state.damping * jnp.where(kept, easier, state.growth)
        damping = jnp.maximum(damping, _LEAST_DAMPING)
        damping = jnp.where(begins, state.damping, damping)
        growth = jnp.where(kept, 2.0, 2 * state.growth)
        ahead = _damped(residuals, jacobian, damping)
        state = _State(residuals, jacobian, spread, damping, growth, *ahead, num_steps)
        return y, state, aux

    def terminate(self, fn, y, args, options, state, tags):
        least = jnp.maximum(self.atol, (_ROUNDED * jnp.finfo(y.dtype).eps) ** 2)
        done = state.predicted <= self.rtol * state.loss + least
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
    if not on_terminal():
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
