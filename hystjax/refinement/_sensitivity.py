"""States of a model over a batch of segments, with a fast derivative.

A scan differentiated as a whole is slow: `jax.linearize` stores every intermediate of
every step. Few parameters make forward sensitivities cheaper: all columns of the
Jacobian are integrated beside the states, some at a time, and the derivative is then a
product with that matrix.
"""

import functools
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float

from ..interpolation import Grid
from ..simulation import march
from ._parameters import Parameters
from ._samples import Pulls

_COLUMNS = 6  # of a Jacobian in one loop: measured, on CPUs with vectors of 4 numbers


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

    def jacobian(start, driven):
        if d_starts is None:  # starts that are not fitted cost no columns
            return _with_jacobian(
                lambda x: _run(x, start, parameters, driven, substeps), values
            )
        return _with_jacobian(
            lambda x: _run(x[:p], x[p:], parameters, driven, substeps),
            jnp.concatenate([values, start]),
        )

    output, slopes = _each_segment(jacobian, starts, tuple(driven))
    change = jnp.zeros_like(output)
    if d_values is not None:
        change += slopes[..., :p] @ d_values
    if d_starts is not None:
        change += jnp.einsum("sndq,sq->snd", slopes[..., p:], d_starts)
    if jax.tree.leaves(d_others):
        change += _change_with_others(primals, d_others, substeps)
    return output, change


def _run(values, start, parameters: Parameters, driven, substeps: int):
    grid, pull = driven
    model = parameters.build(values)
    correct = None if pull is None else functools.partial(_drawn, model)
    path = march(model, state_like(model, start), grid, correct, pull)
    return jnp.stack([leaf[::substeps] for leaf in jax.tree.leaves(path)], axis=-1)


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


def _with_jacobian(function: Callable, x: Float[Array, " q"]):
    """A function's value and its Jacobian, with the columns as last axis."""
    basis = jnp.eye(x.shape[0], dtype=x.dtype)
    push = jax.vmap(
        lambda direction: jax.jvp(function, (x,), (direction,)), out_axes=(None, -1)
    )
    blocks = [push(basis[i : i + _COLUMNS]) for i in range(0, len(x), _COLUMNS)]
    value, _ = blocks[0]
    return value, jnp.concatenate([block for _, block in blocks], axis=-1)


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
