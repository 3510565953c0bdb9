"""Excitations of straight lines: triangles and first-order reversal curves."""

from collections.abc import Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from .. import _checks
from .._errors import InputError
from ._arguments import count, positive, scalar
from ._excitation import AbstractPiecewiseLinear


class Triangle(AbstractPiecewiseLinear):
    """A triangle wave: from `offset` up, down through it, and back, `periods` times.

    **Attributes:**

    - `amplitude`, `offset`: input units.
    - `frequency`: Hz, positive.
    - `periods`: how many, from 1.
    """

    amplitude: Float[Array, ""] = eqx.field(converter=scalar("amplitude"))
    frequency: Float[Array, ""] = eqx.field(converter=positive("frequency"))
    periods: int = eqx.field(converter=count("periods"), static=True)
    offset: Float[Array, ""] = eqx.field(converter=scalar("offset"), default=0.0)

    def corners(self):
        """Times (s) and inputs at the ends and the extremes, shape (2 periods + 2,)."""
        extremes = jnp.arange(2 * self.periods)
        quarters = jnp.concatenate(
            [jnp.zeros(1), 2.0 * extremes + 1, jnp.full(1, 4.0 * self.periods)]
        )
        sign = jnp.pad(1.0 - 2 * (extremes % 2), 1)
        return quarters / (4 * self.frequency), self.offset + self.amplitude * sign


class FirstOrderReversalCurves(AbstractPiecewiseLinear):
    """From saturation down to a reversal point and back, for each reversal point in
    turn, at one speed.

    Pike, Roberts and Verosub (1999), doi:10.1063/1.370176. Bring the device to
    saturation first: the input starts there.

    **Attributes:**

    - `saturation`: input units.
    - `reversals`: shape (k,), input units, each below `saturation`.
    - `rate`: speed of the input, input units/s, positive.
    """

    saturation: Float[Array, ""]
    reversals: Float[Array, " k"]
    rate: Float[Array, ""]

    def __init__(
        self,
        saturation: ArrayLike,
        reversals: ArrayLike | Sequence[float],
        rate: ArrayLike,
    ):
        """**Arguments:** as the attributes.

        **Raises:** `InputError` when a reversal is not below `saturation`, or `rate`
        is not positive.
        """
        self.saturation = scalar("saturation")(saturation)
        self.reversals = _checks.vector("reversals", reversals)
        self.rate = positive("rate")(rate)

    def __check_init__(self):
        _checks.enough_samples("first-order reversal curves", len(self.reversals), 1)
        _checks.finite("reversals", self.reversals)
        if not _checks.is_concrete(self.saturation, self.reversals):
            return
        above = np.asarray(self.reversals)[self.reversals >= self.saturation]
        if above.size:
            raise InputError(
                f"`reversals` must lie below `saturation` ({float(self.saturation):g}),"
                f" got {above[0]:g}. Turn the signs round for curves from below."
            )

    def corners(self):
        """Times (s) and inputs where the input turns, shape (2 k + 1,): saturation,
        first reversal, saturation, and so on.
        """
        top = jnp.full_like(self.reversals, self.saturation)
        u = jnp.append(jnp.stack([top, self.reversals], axis=1).ravel(), top[0])
        t = jnp.cumsum(jnp.abs(jnp.diff(u))) / self.rate
        return jnp.concatenate([jnp.zeros_like(t[:1]), t]), u
