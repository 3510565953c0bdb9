"""A machine of a user's own: two masses, and a hysteretic spring between them."""

import equinox as eqx
import jax
import jax.numpy as jnp

import hystjax as hj


@hj.models.register(name="lab/two_masses")
class TwoMasses(hj.models.AbstractMachine):
    """mass y'' + damping y' + stiffness y + z = u, the output is y, and behind it
    mass2 x'' + damping2 x' + stiffness2 x = z, with a spring that y - x drives."""

    mass: jax.Array = eqx.field(converter=jnp.asarray)
    damping: jax.Array = eqx.field(converter=jnp.asarray)
    stiffness: jax.Array = eqx.field(converter=jnp.asarray)
    mass2: jax.Array = eqx.field(converter=jnp.asarray)
    damping2: jax.Array = eqx.field(converter=jnp.asarray)
    stiffness2: jax.Array = eqx.field(converter=jnp.asarray)
    spring: hj.models.AbstractModel

    def rest(self, seen):
        zero = jnp.zeros_like(seen)
        return seen, zero, zero, zero

    def driver(self, own):
        y, v, x, s = own
        return y - x, v - s

    def motion(self, own, force, now):
        y, v, x, s = own
        first = now.u - self.damping * v - self.stiffness * y - force
        return v, first / self.mass, s, self._behind(x, s, force)

    def _behind(self, x, s, force):
        """The acceleration of the second mass."""
        return (force - self.damping2 * s - self.stiffness2 * x) / self.mass2

    def output(self, x, m, now):
        (y, *_), _ = x
        return y

    def hidden_signals(self, u, w, rate):
        v = rate(w)
        z = u - self.mass * rate(v) - self.damping * v - self.stiffness * w
        return w - self._carried(z, rate), z

    def _carried(self, z, rate):
        """Where the second mass is, from rest, by its own equation under the force."""
        dz, step = rate(z), 1 / rate(jnp.arange(len(z), dtype=z.dtype))[0]
        middle = (z[:-1] + z[1:]) / 2 + step / 8 * (dz[:-1] - dz[1:])

        def advance(state, row):
            def moved(slope, time):
                return tuple(a + time * b for a, b in zip(state, slope, strict=True))

            def field(state, force):
                return state[1], self._behind(state[0], state[1], force)

            k1 = field(state, row[0])
            k2 = field(moved(k1, step / 2), row[1])
            k3 = field(moved(k2, step / 2), row[1])
            k4 = field(moved(k3, step), row[2])
            slopes = zip(k1, k2, k3, k4, strict=True)
            total = tuple(a + 2 * (b + c) + d for a, b, c, d in slopes)
            state = moved(total, step / 6)
            return state, state[0]

        start = jnp.zeros_like(z[0]), jnp.zeros_like(z[0])
        _, later = jax.lax.scan(advance, start, (z[:-1], middle, z[1:]))
        return jnp.append(start[0], later)
