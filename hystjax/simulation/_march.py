"""Many steps, one after the other, and a fast derivative of where they lead.

A loop differentiated as a whole is slow, forwards and far more so backwards: every
intermediate of every step is kept. But once the states are known, the derivatives of
the single steps need not wait for each other: they are found side by side, and only
passed on by a loop of one small product a step.
"""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float

Step = Callable[[Any, Any, Any], Any]


def march(advance: Step, model: Any, x: Any, rows: Any) -> Any:
    """States at the start and after each of m steps, a PyTree of arrays with leading
    axis m + 1.

    **Arguments:**

    - `advance`: the state after a step, of the model, the state before it, and the
        step's row.
    - `model`: any PyTree.
    - `x`: the state at the start, a PyTree of arrays.
    - `rows`: what else each step needs, a PyTree of arrays with leading axis m.
    """
    if not jax.tree.leaves(x):
        return x
    flat, structure = ravel_pytree(x)

    def flat_step(device, state, row):
        return ravel_pytree(advance(device[0], structure(state), row))[0]

    return jax.vmap(structure)(_marched((model,), flat, rows, step=flat_step))


@eqx.filter_custom_jvp
def _marched(device, start, rows, *, step) -> Float[Array, "n d"]:
    def next_state(state, row):
        state = step(device, state, row)
        return state, state

    return from_start(start, jax.lax.scan(next_state, start, rows)[1])


@_marched.def_jvp
def _(primals, tangents, *, step):
    device, start, rows = primals
    d_device, d_start, d_rows = tangents
    path = _marched(device, start, rows, step=step)
    before = path[:-1]

    def along(direction):
        change = jnp.broadcast_to(direction, before.shape)
        steps = lambda states: jax.vmap(step, (None, 0, 0))(device, states, rows)  # noqa: E731
        return jax.jvp(steps, (before,), (change,))[1]

    # Directions go outside and steps inside, for long loops over contiguous memory.
    onward = jax.vmap(along, out_axes=-1)(jnp.eye(len(start), dtype=path.dtype))

    both, changes = (device, rows), (d_device, d_rows)
    moving, still = parted(both, changes)
    added = jnp.zeros_like(before)
    if jax.tree.leaves(moving):

        def steps(moving):
            device, rows = eqx.combine(moving, still)
            return jax.vmap(step, (None, 0, 0))(device, before, rows)

        added = jax.jvp(steps, (moving,), (changes,))[1]
    first = jnp.zeros_like(start) if d_start is None else d_start
    return path, _passed_on(first, onward, added)


def _passed_on(
    first: Float[Array, " d"], onward: Float[Array, "m d d"], added: Float[Array, "m d"]
) -> Float[Array, "n d"]:
    """What becomes of a change over m steps, each of which passes it on and adds to
    it."""

    def chain(change, row):
        onward, added = row
        change = added + jnp.sum(onward * change, axis=-1)
        return change, change

    return from_start(first, jax.lax.scan(chain, first, (onward, added))[1])


def from_start(first: Any, later: Any) -> Any:
    """A first row, and those after it, on a leading axis."""
    return jax.tree.map(lambda a, b: jnp.concatenate([a[None], b]), first, later)


def parted(primals: Any, tangents: Any) -> tuple[Any, Any]:
    """What has a tangent, and what has `None` for one: two PyTrees to be combined."""
    none = lambda leaf: leaf is None  # noqa: E731
    moves = jax.tree.map(lambda leaf: leaf is not None, tangents, is_leaf=none)
    return eqx.partition(primals, moves)
