"""Friction over a position: Dahl, LuGre and elements that slip."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from .._core import checks
from .._core.checks import InputError
from ..library import Plays, Term, sampled
from ..recording import Recording
from ._base import AbstractLaw, AbstractModel, AbstractOperatorLaw
from ._features import arrays, non_negative, stretches, wide_loop
from ._numbers import Bounded, check_elements, magnitude, numbers

_SLIDING = 0.3  # of a stretch, after which it slides as far as a guess goes
_RANGES = 40  # of velocities, for a first Stribeck curve
_MICRO = 0.3  # first damping of bristles, over what is critical for unit mass


class Dahl(AbstractLaw):
    """The friction force of Dahl, over a position:

        w' = stiffness u' |1 - s w / coulomb|^exponent sgn(1 - s w / coulomb),
        s = sign of u'

    With the exponent 1 the force comes close to the Coulomb force as exp(-stiffness d /
    coulomb), over the distance d from a turning point.

    **Attributes:** scalars, positive.

    - `stiffness`: of the contact at rest, N/m (output over input units).
    - `coulomb`: the force while it slides, N (output units).
    - `exponent`: without a unit: 1 for ductile materials, less for brittle ones.
    - `names`, `units`: of input and output; keyword only.

    **Source:** Dahl (1976), doi 10.2514/3.61511.
    """

    stiffness: Float[Array, ""] = eqx.field(converter=Bounded("stiffness"))
    coulomb: Float[Array, ""] = eqx.field(converter=Bounded("coulomb"))
    exponent: Float[Array, ""] = eqx.field(converter=Bounded("exponent"), default=1.0)

    @classmethod
    def guess(cls, rec: Recording) -> "Dahl":
        """A first model, read off the widest loop of a record: its height and its slope
        after turning points.

        **Raises:** `InputError` where there is no loop, or one that is run through the
        other way.
        """
        loop = wide_loop(rec, lags=False)
        coulomb = loop.height / 2
        slope = max(loop.start_slope, coulomb / np.ptp(loop.u))
        return cls(slope, coulomb, names=rec.names, units=rec.units)

    @property
    def rate_independent(self):
        return True

    def kinks(self, x):
        return x - self.coulomb, x + self.coulomb

    def rate(self, x, m, now):
        left = 1 - jnp.sign(now.du) * x / self.coulomb
        return self.stiffness * magnitude(left, self.exponent) * jnp.sign(left) * now.du

    def addends(self):
        if float(self.exponent) != 1:
            return None
        stiffness = float(self.stiffness)
        bend = -stiffness / float(self.coulomb)
        return (stiffness, Term.parse("du")), (bend, Term.parse("w*|du|"))


class LuGre(AbstractModel):
    """The friction force of bristles that bend and slip, over a position u with the
    velocity v = u':

        w = f + micro / stiffness f' + viscous v
        f' = stiffness v - stiffness |v| f / g(v)
        g(v) = coulomb + (static - coulomb) exp(-(v / stribeck)^2)

    with the force f of the bristles (their bend z times the stiffness). At a constant
    velocity w is g(v) sgn v + viscous v: the Stribeck curve. Bristles start straight.

    They settle within a distance of coulomb / stiffness: where samples are much
    further apart, steps are too coarse, as `simulate` and `refine` say.

    **Attributes:** scalars, positive.

    - `stiffness`: sigma_0, N/m.
    - `micro`: sigma_1, damping of the bristles, N s/m.
    - `viscous`: sigma_2, N s/m.
    - `coulomb`: Fc, force of fast sliding less the viscous one, N.
    - `static`: Fs, force of very slow sliding, N.
    - `stribeck`: vs, the velocity at which g has come most of the way, m/s.
    - `names`, `units`: of input and output; keyword only.

    **Source:** Canudas de Wit, Olsson, Åström and Lischinsky (1995),
    doi 10.1109/9.376053.
    """

    stiffness: Float[Array, ""] = eqx.field(converter=Bounded("stiffness"))
    micro: Float[Array, ""] = eqx.field(converter=Bounded("micro"))
    viscous: Float[Array, ""] = eqx.field(converter=Bounded("viscous"))
    coulomb: Float[Array, ""] = eqx.field(converter=Bounded("coulomb"))
    static: Float[Array, ""] = eqx.field(converter=Bounded("static"))
    stribeck: Float[Array, ""] = eqx.field(converter=Bounded("stribeck"))

    @classmethod
    def guess(cls, rec: Recording) -> "LuGre":
        """A first model: the Stribeck curve from samples that slide, least squares with
        no negative part over a range of `stribeck`; the stiffness from the slope after
        turning points.

        **Raises:** `InputError` where there is no loop, or one that is run through the
        other way, or for a record without a clock.
        """
        if not rec.clocked:
            raise InputError(
                "`rec` has no clock, and this friction depends on velocity; fit `Dahl`."
            )
        loop = wide_loop(rec, lags=False)
        speed, force = _sliding(rec)
        ranges = np.geomspace(0.02, 1, _RANGES) * speed.max()
        fits = [non_negative(_curves(speed, each), force) for each in ranges]
        best = int(np.argmin([misfit for _, misfit in fits]))
        coulomb, more, viscous = fits[best][0]
        size = loop.height / 2
        # What least squares leaves at zero, a fit could not leave again.
        coulomb = max(coulomb, 0.1 * size)
        viscous = max(viscous, 0.02 * size / speed.max())
        stiffness = max(loop.start_slope, size / np.ptp(loop.u))
        static = coulomb + max(more, 0.02 * coulomb)
        relaxed = coulomb / stiffness / speed.max()  # s
        return cls(
            stiffness,
            _MICRO * stiffness * relaxed,
            viscous,
            coulomb,
            static,
            ranges[best],
            names=rec.names,
            units=rec.units,
        )

    @property
    def rate_independent(self):
        return False

    def start(self, m, now, seen):
        return jnp.zeros_like(seen)

    def rate(self, x, m, now):
        slip = jnp.abs(now.du) * x / self.level(now.du)
        return self.stiffness * (now.du - slip)

    def output(self, x, m, now):
        bending = self.rate(x, m, now) / self.stiffness
        return x + self.micro * bending + self.viscous * now.du

    def level(self, velocity: Float[ArrayLike, "*s"]) -> Float[Array, "*s"]:
        """g, the force of the bristles at a constant velocity, without its sign."""
        share = jnp.exp(-((jnp.asarray(velocity) / self.stribeck) ** 2))
        return self.coulomb + (self.static - self.coulomb) * share

    def steady(self, velocity: Float[ArrayLike, "*s"]) -> Float[Array, "*s"]:
        """The force at a constant velocity: the Stribeck curve."""
        velocity = jnp.asarray(velocity)
        return self.level(velocity) * jnp.sign(velocity) + self.viscous * velocity


def _sliding(rec: Recording) -> tuple[np.ndarray, np.ndarray]:
    """Speeds, and forces against the motion, of the samples of a record that lie far
    from the last turning point."""
    u, w = arrays(rec)
    velocity = np.gradient(u, np.asarray(rec.t))
    speeds, forces = [], []
    for each in stretches(u):
        way, here = np.sign(each.width), u[each.rows]
        far = way * (here - here[0]) > _SLIDING * np.abs(each.width)
        speeds.append(way * velocity[each.rows][far])
        forces.append(way * w[each.rows][far])
    return np.abs(np.concatenate(speeds)), np.concatenate(forces)


def _curves(speed: np.ndarray, stribeck: float) -> np.ndarray:
    """Columns of a Stribeck curve: constant, drop and viscous."""
    drop = np.exp(-((speed / stribeck) ** 2))
    return np.column_stack([np.ones_like(speed), drop, speed])


class MaxwellSlip(AbstractOperatorLaw):
    """The friction force of springs in parallel, each with an end that slips where it
    is stretched beyond a limit: w = sum of stiffnesses (u - slider).

    It is rate independent, and remembers all turning points that larger loops have not
    wiped out. Springs are slack at u = 0, or as slack as the first input lets them; so
    a record should start from rest with its position 0 there.

    **Attributes:**

    - `stiffnesses`: shape (k,), N/m (output over input units).
    - `limits`: stretches at which they slip, shape (k,), m (input units), positive. One
        beyond the input's range is a spring that never slips, whose limit no record
        tells.
    - `names`, `units`: of input and output; keyword only.

    **Source:** Iwan (1966), doi 10.1115/1.3625199; Goldfarb and Celanovic (1997),
    doi 10.1109/37.588158.
    """

    stiffnesses: Float[Array, " k"] = eqx.field(converter=numbers)
    limits: Float[Array, " k"] = eqx.field(converter=numbers)

    def __check_init__(self):
        check_elements(stiffnesses=self.stiffnesses, limits=self.limits)
        checks.positive("limits", self.limits)

    @classmethod
    def guess(cls, rec: Recording, elements: int = 4) -> "MaxwellSlip":
        """A first model: limits evenly spaced over half the input's range, and
        stiffnesses by least squares with none negative.

        **Raises:** `InputError` where there is no loop, or one that is run through the
        other way.
        """
        loop = wide_loop(rec, lags=False)
        half = np.ptp(loop.u) / 2
        limits = half * (np.arange(elements) + 0.5) / elements
        memory, path = Plays(jnp.asarray(limits)), rec.path
        substeps = path.least_substeps
        steps = memory.along(memory.first(path), path.grid(substeps))
        sliders = np.asarray(sampled(steps, substeps))
        u, w = arrays(rec)
        stiffnesses, _ = non_negative(u[:, None] - sliders, w)
        return cls(
            np.maximum(stiffnesses, 1e-3 * stiffnesses.max()),
            limits,
            names=rec.names,
            units=rec.units,
        )

    @property
    def memory(self):
        return Plays(self.limits)

    def output(self, x, m, now):
        return jnp.sum(self.stiffnesses * (now.u - m))

    def bounds(self):
        return {f"limits[{i}]": (0.0, np.inf) for i in range(len(self.limits))}

    def addends(self):
        stiffnesses = [float(each) for each in self.stiffnesses]
        slips = zip(stiffnesses, map(float, self.limits), strict=True)
        return (
            (sum(stiffnesses), Term.parse("u")),
            *((-k, Term.parse(f"play(u,{limit!r})")) for k, limit in slips),
        )
