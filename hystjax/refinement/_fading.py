"""Whether a law forgets its initial value."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..interpolation import Signals
from ..models import AbstractModel


class Fading(eqx.Module):
    """How a law contracts or expands along an input: two trajectories that start close
    together come together where the derivative of w' with respect to w is negative.

    **Attributes:**

    - `exponent`: its mean over time, 1/s: negative for a law that forgets.
    - `gain`: logarithm of the factor by which a difference in w grows over the whole
        recording.
    - `largest`: its largest value, 1/s.
    - `where`: the time of that, s.
    - `share`: share of the samples at which it is positive.
    """

    exponent: Float[Array, ""]
    gain: Float[Array, ""]
    largest: Float[Array, ""]
    where: Float[Array, ""]
    share: Float[Array, ""]


def exponents(
    model: AbstractModel, w: Float[Array, " n"], m: Any, now: Signals
) -> tuple[Float[Array, " n"], Float[Array, ""]]:
    """The derivative of w' with respect to w at each sample, 1/s, and its integral."""
    ones = jnp.ones_like(w)
    rates = jax.vmap(model.rate)
    local = jax.jvp(lambda w: rates(w, m, now), (w,), (ones,))[1]
    # u' is the right limit: constant over the step that follows.
    return local, jnp.sum(local[:-1] * jnp.diff(now.t))


def fading(model: AbstractModel, w: Float[Array, " n"], m: Any, now: Signals) -> Fading:
    """Measure fading along a trajectory of a law (one whose state is its output)."""
    local, gain = exponents(model, w, m, now)
    row = jnp.argmax(local)
    share, t = jnp.mean(local > 0), now.t
    return Fading(gain / (t[-1] - t[0]), gain, local[row], t[row], share)
