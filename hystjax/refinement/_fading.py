"""Whether a law forgets its initial value."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

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
    model: AbstractModel,
    t: Float[Array, " n"],
    w: Float[Array, " n"],
    u: Float[Array, " n"],
    du: Float[Array, " n"],
) -> tuple[Float[Array, " n"], Float[Array, ""]]:
    """The derivative of w' with respect to w at each sample, 1/s, and its integral."""
    ones = jnp.ones_like(w)
    local = jax.jvp(lambda w: model.rate(w, u, du), (w,), (ones,))[1]
    # u' is the right limit: constant over the step that follows.
    return local, jnp.sum(local[:-1] * jnp.diff(t))


def fading(
    model: AbstractModel,
    t: Float[Array, " n"],
    w: Float[Array, " n"],
    u: Float[Array, " n"],
    du: Float[Array, " n"],
) -> Fading:
    """Measure fading along a trajectory of a law (one whose state is its output)."""
    local, gain = exponents(model, t, w, u, du)
    row = jnp.argmax(local)
    share = jnp.mean(local > 0)
    return Fading(gain / (t[-1] - t[0]), gain, local[row], t[row], share)
