"""States of a model over a batch of segments, with a fast derivative.

A scan differentiated as a whole is slow: `jax.linearize` stores every intermediate of
every step. But once the states are known, the derivatives of the single steps need not
wait for each other: they are found side by side, and chained by a loop of one product a
step. The derivative is then a product with the Jacobian.

What the memory holds at each step is data here. Where its own numbers are fitted, its
change with them, found before, forces the same chain.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float

from .._jit import jit
from ..interpolation import Grid, Signals
from ..models import AbstractModel
from ..simulation import flow, from_start
from ._parameters import Parameters


class Pull(NamedTuple):
    """What draws trajectories to the measured output before each of m steps: by which
    share of the distance, and to where."""

    gain: Float[Array, "*batch m"]
    target: Float[Array, "*batch m"]


class Drive(NamedTuple):
    """What m steps need to know besides the state: the input, the pull if there is one,
    and the memory at the start, the middle and the end of each."""

    grid: Grid
    pull: Pull | None
    memory: tuple[Any, Any, Any]


@eqx.filter_custom_jvp
def states(
    values: Float[Array, " p"],
    starts: Float[Array, "segments d"],
    parameters: Parameters,
    drive: Drive,
    *,
    substeps: int,
) -> Float[Array, "segments n d"]:
    """Flowing states at the sample times of a batch of segments.

    **Arguments:** values of the free parameters; states at the start of each segment,
    flattened to d numbers; how the values make a model; and what drives the segments,
    along the first axis of its arrays.
    """

    def run(start, drive):
        return _path(values, start, parameters, drive)[::substeps]

    return _each_segment(run, starts, drive)


@states.def_jvp
def _(primals, tangents, *, substeps):
    values, starts, parameters, drive = primals
    d_values, d_starts, d_parameters, d_drive = tangents
    p = values.shape[0]

    # Starts that are not fitted cost no columns.
    columns = p if d_starts is None else p + starts.shape[1]

    found = _linearised(values, starts, parameters, drive, columns)
    output, slopes = (leaf[:, ::substeps] for leaf in found[:2])
    change = jnp.zeros_like(output)
    if d_values is not None:
        change += slopes[..., :p] @ d_values
    if d_starts is not None:
        change += jnp.einsum("sndq,sq->snd", slopes[..., p:], d_starts)
    if _moves(d_drive.memory):
        forced = _change_with_memory(primals, found, d_drive.memory)
        change += forced[:, ::substeps]
    d_others = d_parameters, d_drive._replace(memory=_still(d_drive.memory))
    if _moves(d_others):
        change += _change_with_others(primals, d_others, substeps)
    return output, change


def _path(values, start, parameters: Parameters, drive: Drive) -> Float[Array, "m d"]:
    """States at the start and after every step."""
    model = parameters.build(values)
    x = state_like(model, start)

    def advance(x, row):
        x = _step(model, x, row)
        return x, x

    path = from_start(x, jax.lax.scan(advance, x, drive)[1])
    return jax.vmap(flat)(path)


def _step(model: AbstractModel, x: Any, row: Drive) -> Any:
    """The state after a step, drawn to the measured output before it."""
    if row.pull is not None:
        x = _drawn(model, x, row.pull, row.memory[0], row.grid.start)
    return flow(model, x, row.memory, row.grid)


def _drawn(model: AbstractModel, x: Any, pull: Pull, m: Any, now: Signals) -> Any:
    """A state moved along the outputs that a start may have, towards a measured one; or
    a new start there, where the state has been lost."""
    kept = jnp.all(jnp.isfinite(flat(x)))
    return jax.tree.map(
        lambda leaf, there, here: jnp.where(
            kept, leaf + pull.gain * (there - here), there
        ),
        x,
        model.start(m, now, pull.target),
        model.start(m, now, model.output(x, m, now)),
    )


def flat(x: Any) -> Float[Array, " d"]:
    """A state as d numbers."""
    return ravel_pytree(x)[0]


def state_like(model: AbstractModel, row: Float[Array, " d"]) -> Any:
    """A flattened state in the model's own structure."""
    zero = jnp.zeros((), row.dtype)
    now = Signals(zero, zero, zero)
    return ravel_pytree(model.start(model.memory.start(now), now, zero))[1](row)


# A program has several of these, at the first unknowns, in the loop and at the end:
# this traces them once.
@jit
def _linearised(values, starts, parameters: Parameters, drive: Drive, columns: int):
    """Of each segment the states after every step, shape (m + 1, d); the first
    `columns` of their Jacobian with respect to the values and then the start, shape
    (m + 1, d, columns); and the steps' own with respect to the state before them, shape
    (m, d, d)."""
    p, d = len(values), starts.shape[1]
    own = jnp.arange(columns) < p

    def jacobian(start, drive):
        path = _path(values, start, parameters, drive)
        slopes = _step_slopes(values, path[:-1], parameters, drive)
        added, onward = jnp.where(own, slopes[..., :columns], 0.0), slopes[..., p:]
        first = jnp.eye(d, columns, p, dtype=path.dtype)
        return path, _chained(first, onward, added), onward

    return _each_segment(jacobian, starts, drive)


def _chained(
    first: Float[Array, "d q"],
    onward: Float[Array, "m d d"],
    added: Float[Array, "m d q"],
) -> Float[Array, "n d q"]:
    """What becomes of a change over m steps, each of which passes it on and adds to
    it."""

    def chain(change, step):
        onward, added = step
        change = added + jnp.sum(onward[:, :, None] * change, axis=1)
        return change, change

    return from_start(first, jax.lax.scan(chain, first, (onward, added))[1])


def _step_slopes(values, path, parameters: Parameters, drive: Drive):
    """The derivative of the state after each of m steps with respect to the values and
    to the state before it, shape (m, d, p + d)."""
    p, q = len(values), len(values) + path.shape[1]

    def along(direction):
        change = direction[:p], jnp.broadcast_to(direction[p:], path.shape)
        steps = lambda values, path: _steps(values, path, parameters, drive)  # noqa: E731
        return jax.jvp(steps, (values, path), change)[1]

    # Directions go outside and steps inside, for long loops over contiguous memory.
    slopes = jax.vmap(along)(jnp.eye(q, dtype=path.dtype))
    return jnp.moveaxis(slopes, 0, -1)


def _steps(values, path, parameters: Parameters, drive: Drive) -> Float[Array, "m d"]:
    """All steps side by side, each from a state on the path."""
    model = parameters.build(values)

    def step(row, drive):
        return flat(_step(model, state_like(model, row), drive))

    return jax.vmap(step)(path, drive)


def _change_with_memory(primals, found, d_memory) -> Float[Array, "segments n d"]:
    """The change of all states with that of the memory."""
    values, _, parameters, drive = primals
    path, _, onward = found
    moving, still = eqx.partition(drive.memory, _perturbed(d_memory))

    def forced(path, onward, drive, moving, still, tangent):
        def steps(moving):
            held = drive._replace(memory=eqx.combine(moving, still))
            return _steps(values, path[:-1], parameters, held)

        added = jax.jvp(steps, (moving,), (tangent,))[1]
        first = jnp.zeros((path.shape[1], 1), path.dtype)
        return _chained(first, onward, added[..., None])[..., 0]

    return jax.vmap(forced)(path, onward, drive, moving, still, d_memory)


def _change_with_others(primals, d_others, substeps) -> Float[Array, "segments n d"]:
    """The change with what is neither a value, a start nor memory, by the scan's own
    rule."""
    values, starts, *others = primals
    moving, still = eqx.partition(tuple(others), _perturbed(d_others))

    def run(moving):
        parameters, drive = eqx.combine(moving, still)

        def one(start, drive):
            return _path(values, start, parameters, drive)[::substeps]

        return _each_segment(one, starts, drive)

    return jax.jvp(run, (moving,), (d_others,))[1]


def _each_segment(function: Callable, starts, drive: Drive):
    """`vmap`, but for a lone segment, whose loop over scalars is faster than one over
    arrays of length 1."""
    if starts.shape[0] > 1:
        return jax.vmap(function)(starts, drive)
    lone = jax.tree.map(lambda leaf: leaf[0], (starts, drive))
    return jax.tree.map(lambda leaf: leaf[None], function(*lone))


def _perturbed(tangents: Any) -> Any:
    return jax.tree.map(_is_some, tangents, is_leaf=_is_none)


def _still(tangents: Any) -> Any:
    return jax.tree.map(lambda _: None, tangents, is_leaf=_is_none)


def _moves(tangents: Any) -> bool:
    return bool(jax.tree.leaves(tangents))


def _is_some(leaf) -> bool:
    return leaf is not None


def _is_none(leaf) -> bool:
    return leaf is None
