"""Where several fits of one model start."""

from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._core import checks
from .._core.checks import InputError
from ._choices import Parameters
from ._objective import FAR, Objective, first_unknowns

_HALVINGS = 4  # of the way to a start from which the record is lost


def check_starts(starts: int, key) -> None:
    """Raise `InputError` for no starts, and for several without a key."""
    if checks.whole("starts", starts) < 1:
        raise InputError(f"`starts` must be at least 1, got {starts}.")
    if starts > 1 and key is None:
        raise InputError("several `starts` need a `key`, such as `jax.random.key(0)`.")
    if starts > 1:
        checks.key("key", key)


def first_values(
    parameters: Parameters, starts: int, spread: float, key
) -> Float[Array, "s p"]:
    """Where each of the fits starts: the model's own values first."""
    values = parameters.values()
    if starts == 1:
        return values[None]
    shape = (starts - 1, len(values))
    changes = jax.random.uniform(key, shape, values.dtype, -spread, spread)
    return jnp.concatenate([values[None], values * (1 + changes)])


def within_reach(
    objective: Objective, first: Float[Array, "s p"]
) -> Float[Array, "s p"]:
    """Where fits start, half as far from the first of them, and again, where the model
    loses the record: few lead back from there, and all others would wait for it."""
    single = replace(objective, pieces=1)
    change = first - first[0]

    def lost(values):
        model = single.parameters.build(values)
        there = eqx.tree_at(lambda o: o.parameters.model, single, model)
        unknowns = first_unknowns(there)
        return there.cost(unknowns, there.run(unknowns)) > FAR**2 / 2

    def halve(_, share):
        far = jax.vmap(lost)(first[0] + share[:, None] * change)
        return jnp.where(far, share / 2, share)

    share = jax.lax.fori_loop(0, _HALVINGS, halve, jnp.ones_like(first[:, 0]))
    return first[0] + share[:, None] * change
