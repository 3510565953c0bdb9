"""L-BFGS that does not learn from steps without curvature."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import optax


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
