"""States of a model over a batch of segments, with a fast derivative.

A scan differentiated as a whole is slow: `jax.linearize` stores every intermediate of
every step. But once the states are known, the derivatives of the single steps need not
wait for each other: they are found side by side, and chained by a loop of one product a
step. The derivative is then a product with the Jacobian.
"""

import functools
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float

from .._jit import jit
from ..interpolation import Grid
from ..simulation import advance, march
from ._parameters import Parameters
from ._samples import Pulls


@eqx.filter_custom_jvp
def states(
    values: Float[Array, " p"],
    starts: Float[Array, "segments d"],
    parameters: Parameters,
    grid: Grid,
    pull: Pulls | None,
    *,
    substeps: int,
) -> Float[Array, "segments n d"]:
    """States at the sample times of a batch of segments.

    **Arguments:** values of the free parameters; states at the start of each segment,
    flattened to d numbers; how the values make a model; the grids of the segments,
    along their first axis; and what draws trajectories to the measured output, if
    anything does.
    """

    def run(start, driven):
        return _run(values, start, parameters, driven, substeps)

    return _each_segment(run, starts, (grid, pull))


@states.def_jvp
def _(primals, tangents, *, substeps):
    values, starts, parameters, *driven = primals
    d_values, d_starts, *d_others = tangents
    p = values.shape[0]

    # Starts that are not fitted cost no columns.
    columns = p if d_starts is None else p + starts.shape[1]

    shape = substeps, columns
    output, slopes = _linearised(values, starts, parameters, tuple(driven), shape)
    change = jnp.zeros_like(output)
    if d_values is not None:
        change += slopes[..., :p] @ d_values
    if d_starts is not None:
        change += jnp.einsum("sndq,sq->snd", slopes[..., p:], d_starts)
    if jax.tree.leaves(d_others):
        change += _change_with_others(primals, d_others, substeps)
    return output, change


# A program has several of these, at the first unknowns, in the loop and at the end:
# this traces them once.
@jit
def _linearised(values, starts, parameters: Parameters, driven, shape):
    """States and their Jacobian, of each segment."""

    def jacobian(start, driven):
        return _with_jacobian(values, start, parameters, driven, *shape)

    return _each_segment(jacobian, starts, driven)


def _run(values, start, parameters: Parameters, driven, substeps: int):
    """States at the samples, shape (n, d)."""
    return _path(values, start, parameters, driven)[::substeps]


def _path(values, start, parameters: Parameters, driven) -> Float[Array, "m d"]:
    """States at the start and after every step."""
    grid, pull = driven
    model = parameters.build(values)
    path = march(model, state_like(model, start), grid, _correction(model, pull), pull)
    return jnp.stack(jax.tree.leaves(path), axis=-1)


def _correction(model, pull):
    return None if pull is None else functools.partial(_drawn, model)


def _drawn(model, state, pull):
    """A state moved along the outputs that a start may have, towards a measured one; or
    a new start there, where the state has been lost."""
    gain, time, target = pull
    one_row = jax.tree.map(lambda leaf: leaf[None], state)
    output = model.observe(time[None], one_row)[0]
    zero = jnp.zeros_like(output)
    kept = jnp.all(jnp.isfinite(jnp.stack(jax.tree.leaves(state))))
    return jax.tree.map(
        lambda leaf, there, here: jnp.where(kept, leaf + gain * (there - here), there),
        state,
        model.start(target, zero),
        model.start(output, zero),
    )


def state_like(model, flat: Float[Array, " d"]) -> Any:
    """A flattened state in the model's own structure."""
    zero = jnp.zeros((), flat.dtype)
    _, unravel = ravel_pytree(model.start(zero, zero))
    return unravel(flat)


def _with_jacobian(values, start, parameters: Parameters, driven, substeps, columns):
    """States at the samples, and the first `columns` of their Jacobian with respect to
    the values and then the start, shape (n, d, columns)."""
    path = _path(values, start, parameters, driven)
    slopes = _step_slopes(values, path[:-1], parameters, driven)
    p, d = len(values), len(start)
    own = jnp.arange(columns) < p
    first = jnp.eye(d, columns, p, dtype=path.dtype)

    def chain(jacobian, slopes):
        added = jnp.where(own, slopes[:, :columns], 0.0)
        onward = slopes[:, p:, None]
        jacobian = added + jnp.sum(onward * jacobian, axis=1)
        return jacobian, jacobian

    _, later = jax.lax.scan(chain, first, slopes)
    jacobian = jnp.concatenate([first[None], later])
    return path[::substeps], jacobian[::substeps]


def _step_slopes(values, states, parameters: Parameters, driven):
    """The derivative of the state after each of m steps with respect to the values and
    to the state before it, shape (m, d, p + d)."""
    grid, pull = driven
    p, q = len(values), len(values) + states.shape[1]

    def steps(values, states):
        model = parameters.build(values)

        def step(flat, inputs, row):
            state = state_like(model, flat)
            state = advance(model, state, inputs, row, _correction(model, pull))
            return ravel_pytree(state)[0]

        return jax.vmap(step)(states, grid, pull)

    def along(direction):
        change = direction[:p], jnp.broadcast_to(direction[p:], states.shape)
        return jax.jvp(steps, (values, states), change)[1]

    # Directions go outside and steps inside, for long loops over contiguous memory.
    slopes = jax.vmap(along)(jnp.eye(q, dtype=states.dtype))
    return jnp.moveaxis(slopes, 0, -1)


def _change_with_others(primals, d_others, substeps):
    """The change with what is neither a value nor a start, by the scan's own rule."""
    values, starts, *others = primals
    perturbed = jax.tree.map(lambda d: d is not None, d_others, is_leaf=_is_none)
    moving, still = eqx.partition(others, perturbed)

    def run(moving):
        parameters, *driven = eqx.combine(moving, still)

        def one(start, driven):
            return _run(values, start, parameters, driven, substeps)

        return _each_segment(one, starts, tuple(driven))

    return jax.jvp(run, (moving,), (d_others,))[1]


def _each_segment(function: Callable, starts, driven):
    """`vmap`, but for a lone segment, whose loop over scalars is faster than one over
    arrays of length 1."""
    if starts.shape[0] > 1:
        return jax.vmap(function)(starts, driven)
    lone = jax.tree.map(lambda leaf: leaf[0], (starts, driven))
    return jax.tree.map(lambda leaf: leaf[None], function(*lone))


def _is_none(leaf) -> bool:
    return leaf is None
