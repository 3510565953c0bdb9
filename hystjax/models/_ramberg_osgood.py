"""Ramberg and Osgood's curve, with Masing's rules for the way back."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from ..library import AbstractMemory
from ..recording import Recording
from ._base import AbstractOperatorLaw
from ._features import wide_loop
from ._numbers import Bounded, magnitude

_SHARE = 3 / 7  # plastic part of the strain at the strength over its elastic part
_NEWTON = 12  # steps to rounding, from no more than twice the force
_SHARPNESSES = np.linspace(1.5, 20, 75)


class TurningPoints(AbstractMemory):
    """The turning points that larger loops have not wiped out.

    The state is an array: they in their order, outermost first, and the input itself in
    all places after the last. What goes up to `u` wipes out the first maximum that is
    not above it with all that follows, and what goes down the same of minima; both go
    by the first turning point, the farthest from 0, on either side.

    **Attributes:** `depth`, most turning points that are kept. In deeper loops there is
    no hysteresis.
    """

    depth: int = eqx.field(static=True, default=32)

    def start(self, now):
        return jnp.full(self.depth, now.u)

    def after(self, m, before, now):
        # Maxima and minima alternate. So where the input turns, its first place has the
        # other kind and stays, as a new turning point.
        way = jnp.sign(now.u - before.u)
        alternating = (-1.0) ** np.arange(self.depth)
        kind = jnp.sign(m[0]) * alternating
        passed = (kind == way) & (way * (now.u - m) >= 0)
        passed = passed.at[0].set(passed[0] | (jnp.abs(now.u) >= jnp.abs(m[0])))
        gone = (jnp.cumsum(passed) > 0).at[-1].set(True)
        return jnp.where(gone, now.u, m)

    def values(self, m, now):
        return {f"turning point {i}": each for i, each in enumerate(m)}


class RambergOsgood(AbstractOperatorLaw):
    """The stress w in a material that yields, over its strain u, by the curve of
    Ramberg and Osgood and the rules of Masing:

        u = S(w),  S(w) = w / stiffness (1 + 3/7 |w / strength|^(n-1))

    at first, and (u - u0) / 2 = S((w - w0) / 2) after a turn at (u0, w0). A branch that
    comes back to the turning point before goes on as the branch before did; one that
    goes beyond the largest strain, as the first curve. All loops are closed, and what
    is inside of a loop is forgotten at its end.

    It starts at the first curve, where nothing has happened.

    **Attributes:** scalars, positive.

    - `stiffness`: modulus of elasticity, Pa (output over input units).
    - `strength`: stress at which the secant is 0.7 of that, Pa (output units).
    - `n`: sharpness of the knee, more than 1; known as well as the record yields.
    - `depth`: most turning points inside of each other that are remembered.
    - `names`, `units`: of input and output; keyword only.

    **Source:** Ramberg and Osgood (1943), NACA Technical Note 902; Masing (1926),
    *Eigenspannungen und Verfestigung beim Messing*, 2nd International Congress of
    Applied Mechanics; rules of memory as in Madelung (1905), doi
    10.1002/andp.19053221003.
    """

    stiffness: Float[Array, ""] = eqx.field(converter=Bounded("stiffness"))
    strength: Float[Array, ""] = eqx.field(converter=Bounded("strength"))
    n: Float[Array, ""] = eqx.field(converter=Bounded("n", 1.0))
    depth: int = eqx.field(static=True, default=32)

    @classmethod
    def guess(cls, rec: Recording) -> "RambergOsgood":
        """A first model, read off the widest loop of a record: the slope after turning
        points, and half of the branches, which are the curve itself.

        **Raises:** `InputError` where there is no loop, or one that is run through the
        other way.
        """
        loop = wide_loop(rec, lags=False)
        strain = (loop.u - loop.u[0]) / 2
        up = loop.rising - loop.rising[0]
        down = (loop.falling[-1] - loop.falling)[::-1]
        stress = (up + down) / 4
        stiffness = max(loop.start_slope, 1.05 * stress[-1] / strain[-1])
        # Through the tip for every sharpness; then the one whose strains are closest.
        top, left = stress[-1], stiffness * strain[-1] / stress[-1] - 1
        strengths = top * (_SHARE / left) ** (1 / (_SHARPNESSES - 1))
        plastic = _SHARE * (np.abs(stress) / strengths[:, None]) ** (
            _SHARPNESSES[:, None] - 1
        )
        misfits = np.sum((stress / stiffness * (1 + plastic) - strain) ** 2, axis=1)
        best = int(np.argmin(misfits))
        return cls(
            stiffness,
            strengths[best],
            _SHARPNESSES[best],
            names=rec.names,
            units=rec.units,
        )

    @property
    def memory(self):
        return TurningPoints(self.depth)

    def output(self, x, m, now):
        # Branch by branch; those after the input, from it to itself, add nothing.
        return self.first(m[0]) + 2 * jnp.sum(self.first(jnp.diff(m) / 2))

    def first(self, strain: Float[ArrayLike, "*s"]) -> Float[Array, "*s"]:
        """The stress of the first curve."""
        strain = jnp.asarray(strain)
        v = jnp.abs(strain) * self.stiffness / self.strength

        def plastic(y):
            """The plastic part of the strain over the elastic one, at a stress y times
            the strength."""
            return _SHARE * magnitude(y, self.n - 1)

        def newton(_, y):
            share = plastic(y)
            return y - (y * (1 + share) - v) / (1 + self.n * share)

        # It is convex: from above, Newton's steps come down to the root.
        above = jnp.minimum(v, magnitude(v / _SHARE, 1 / self.n))
        y = jax.lax.stop_gradient(jax.lax.fori_loop(0, _NEWTON, newton, above))
        # One more has the derivatives of the root. By the secant, not as sgn(strain) y,
        # whose derivative at 0 would be 0.
        return self.stiffness * strain / (1 + plastic(newton(0, y)))
