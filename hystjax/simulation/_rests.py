"""Where a law comes to rest while its input is held."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Bool, Float

from .._core import checks
from .._core.checks import InputError
from .._core.compiling import jit
from ..models import AbstractModel
from ..models._numbers import number
from ..signals import Signals

_NODES = 1000  # between which signs are compared
_MOST = 16  # rests that are told
_HALVINGS = 60  # of an interval between nodes, down to rounding


class Rests(NamedTuple):
    """Outputs at which a law stays while its input is held.

    **Attributes:**

    - `w`: those outputs, in ascending order, the first sixteen of them, shape (16,);
        NaN behind the last.
    - `stable`: whether the law returns there from nearby, shape (16,).
    """

    w: Float[Array, " k"]
    stable: Bool[Array, " k"]


def rests(model: AbstractModel, u: ArrayLike, low: ArrayLike, high: ArrayLike) -> Rests:
    """Where a law comes to rest under an input that is held, and what it leaves.

    A law with one stable rest forgets what it went through; with several it ends at one
    or the other, whichever the past led to; with none it runs away. Memory is that of
    an input which has always been `u`.

    **Arguments:**

    - `model`: a law whose state is one number that its output tells.
    - `u`: where the input is held, input units.
    - `low`, `high`: between which outputs are looked for, output units. Of two rests
        less than a thousandth of that apart neither is seen.

    **Returns:** `Rests`; none for a law whose output stands still wherever it is, as
    that of a rate-independent law does.

    **Raises:** `InputError` when `low` does not lie below `high`, or the state of the
    model is not one number.

    **Source:** Strogatz (2015), Nonlinear Dynamics and Chaos, chapter 2, ISBN
    978-0-8133-4910-7: fixed points on the line.
    """
    low, high = number(low), number(high)
    if checks.is_concrete(low, high) and not low < high:
        raise InputError(f"`low` must lie below `high`, got {low} and {high}.")
    return _rests(model, number(u), low, high)


@jit
def _rests(model, u, low, high) -> Rests:
    now = Signals(jnp.zeros(()), u, jnp.zeros(()))
    m = model.memory.start(now)

    def drift(w):
        """The derivative of the output, output units/s, where that is w."""
        x = model.start(m, now, w)
        shapes = [jnp.shape(leaf) for leaf in jax.tree.leaves(x)]
        if shapes != [()]:
            raise InputError(
                "`rests` is about laws whose state is one number that the output "
                f"tells, and that of this {type(model).__name__} is not."
            )
        rate = model.rate(x, m, now)
        return jax.jvp(lambda x: model.output(x, m, now), (x,), (rate,))[1]

    nodes = jnp.linspace(low, high, _NODES)
    # Of a rest at a node only the interval before or after it counts.
    upward = jax.vmap(drift)(nodes) >= 0
    crossed = upward[:-1] != upward[1:]
    (first,) = jnp.nonzero(crossed, size=_MOST, fill_value=-1)
    stable = upward[first]

    def halved(_, ends):
        left, right = ends
        middle = (left + right) / 2
        beyond = (jax.vmap(drift)(middle) >= 0) == stable
        return jnp.where(beyond, middle, left), jnp.where(beyond, right, middle)

    ends = nodes[first], nodes[first + 1]
    left, right = jax.lax.fori_loop(0, _HALVINGS, halved, ends)
    found = first >= 0
    return Rests(jnp.where(found, (left + right) / 2, jnp.nan), found & stable)
