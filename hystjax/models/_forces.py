"""Forces over a position: friction by Dahl, LuGre and elements that slip; restoring
forces of Bouc and Wen's kind, and Ramberg and Osgood's."""

import itertools
from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from .._core import checks
from .._core.checks import InputError
from ..library import AbstractMemory, Plays, Term
from ..recording import Recording, as_recording
from ._base import AbstractLaw, AbstractModel, AbstractOperatorLaw
from ._guess import arrays, nearest, non_negative, stretches, thinned, wide_loop
from ._numbers import (
    Bounded,
    check_elements,
    from_zero,
    knee,
    knee_powers,
    magnitude,
    number,
    numbers,
    stack_of,
    together,
)

# Times a loop's width: of exponentials that a guess tries, for a loop without any slope
# the first.
_RATES = (200.0, 1.0)
_TRIED = 60
_SLIDING = 0.3  # of a stretch, after which it slides as far as a guess goes
_RANGES = 40  # of velocities, for a first Stribeck curve, and of stiffnesses
_MICRO = 0.03  # least damping of bristles, over coulomb and the fastest velocity
_LIMITS = 40  # of elements that slip, that a guess tries
_FARTHER = 10  # and of those that slip on the way to an input to one side of 0
# What a guess tries of a spring that weakens and slips, and what it is of one cycle.
_PINCHED = (
    (1.0, 1.5, 2.5),  # times stiffer before yield than the loop looks
    (0.1, 0.3, 1.0),  # of the stiffness after yield
    (1.0, 2.0),  # n
    (0.3, 0.6, 0.9),  # zeta_s
    (0.5, 2.0, 6.0),  # p by the energy that is taken up by the end
    (0.15, 0.4, 1.0),  # psi over the knee
    ((0.1, 0.1), (0.6, 0.1), (0.1, 0.6)),  # delta_nu and delta_eta by that energy
)
_OF_ONE_CYCLE = 1.0, 1.0, 1.0, 0.5, 1.4, 0.5, (0.1, 0.1)
_CYCLE = 3  # stretches of one that begins between its tips


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
    exponent: Float[Array, ""] = eqx.field(
        converter=Bounded("exponent", admits=(0.0,)), default=1.0
    )

    @classmethod
    def guess(cls, recording: Recording) -> "Dahl":
        """A first model: an exponential through the branches of the widest loop of a
        record, as they are with the exponent 1, least squares over a range of rates.

        **Raises:** `InputError` where there is no loop, or one that is run through the
        other way.
        """
        loop = wide_loop(recording, lags=False)
        along = loop.u - loop.u[0]
        branch = (loop.rising - loop.falling[::-1]) / 2
        rates = np.geomspace(*_RATES, _TRIED) / along[-1]
        curves = [(np.ones_like(along), -np.exp(-rate * along)) for rate in rates]
        fits = [non_negative(np.column_stack(each), branch) for each in curves]
        best = int(np.argmin([misfit for _, misfit in fits]))
        coulomb = fits[best][0][0]
        stiffness = rates[best] * coulomb
        return cls(stiffness, coulomb, names=recording.names, units=recording.units)

    @property
    def rate_independent(self):
        return True

    def dimensions(self):
        return {"stiffness": (1, -1, 0), "coulomb": (1, 0, 0)}

    def kinks(self, x):
        return x - self.coulomb, x + self.coulomb

    def rate(self, x, m, now):
        left = 1 - jnp.sign(now.du) * x / self.coulomb
        return self.stiffness * left * magnitude(left, self.exponent - 1) * now.du

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
    micro: Float[Array, ""] = eqx.field(converter=Bounded("micro", admits=(0.0,)))
    viscous: Float[Array, ""] = eqx.field(converter=Bounded("viscous", admits=(0.0,)))
    coulomb: Float[Array, ""] = eqx.field(converter=Bounded("coulomb"))
    static: Float[Array, ""] = eqx.field(converter=Bounded("static"))
    stribeck: Float[Array, ""] = eqx.field(converter=Bounded("stribeck"))

    @classmethod
    def guess(cls, recording: Recording) -> "LuGre":
        """A first model: the Stribeck curve from samples that slide, least squares with
        no negative part over a range of `stribeck`; then stiffness and damping of the
        bristles by least squares over a range of stiffnesses.

        **Raises:** `InputError` where there is no loop, or one that is run through the
        other way, or for a record without a clock.
        """
        if not as_recording(recording, "guess(recording)").clocked:
            raise InputError(
                "`recording` has no clock, and this friction depends on velocity; fit "
                "`Dahl`."
            )
        loop = wide_loop(recording, lags=False)
        speed, force = _sliding(recording)
        ranges = np.geomspace(0.02, 1, _RANGES) * speed.max()
        fits = [non_negative(_curves(speed, each), force) for each in ranges]
        best = int(np.argmin([misfit for _, misfit in fits]))
        coulomb, more, viscous = fits[best][0]
        size = loop.height / 2
        # What least squares leaves at zero, a fit could not leave again.
        coulomb = max(coulomb, 0.1 * size)
        viscous = max(viscous, 0.02 * size / speed.max())
        static = coulomb + max(more, 0.02 * coulomb)
        curve = coulomb, static - coulomb, viscous
        stiffness, micro = _bristles(recording, curve, ranges[best], size)
        return cls(
            stiffness,
            max(micro, _MICRO * coulomb / speed.max()),
            viscous,
            coulomb,
            static,
            ranges[best],
            names=recording.names,
            units=recording.units,
        )

    @property
    def rate_independent(self):
        return False

    def dimensions(self):
        return {
            "stiffness": (1, -1, 0),
            **dict.fromkeys(("micro", "viscous"), (1, -1, 1)),
            **dict.fromkeys(("coulomb", "static"), (1, 0, 0)),
            "stribeck": (0, 1, -1),
        }

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


def _sliding(recording: Recording) -> tuple[np.ndarray, np.ndarray]:
    """Speeds, and forces against the motion, of the samples of a record that lie far
    from the last turning point."""
    u, w = arrays(recording)
    velocity = np.gradient(u, np.asarray(recording.t))
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


def _bristles(
    recording: Recording,
    curve: tuple[float, float, float],
    stribeck: float,
    size: float,
) -> tuple[float, float]:
    """Stiffness and damping of bristles with this Stribeck curve, and friction of this
    size, by which a record is followed best."""
    u, w = arrays(recording)
    t, steps = np.asarray(recording.t), np.abs(np.diff(u))
    # From bristles as long as the whole way to ones that samples just miss.
    ends = size / np.ptp(u), 5 * size / np.mean(steps)
    stiffnesses = np.geomspace(*ends, _RANGES)

    def level(velocity):
        return _curves(np.abs(velocity), stribeck)[:, :2] @ curve[:2]

    over = np.diff(u) / np.diff(t)
    slides = level(over) * np.sign(over)
    kept = np.exp(-np.outer(steps / level(over), stiffnesses))
    forces = [np.zeros(_RANGES)]
    for sliding, share in zip(slides, kept, strict=True):
        forces.append(sliding + (forces[-1] - sliding) * share)
    velocity = np.gradient(u, t)
    forces = np.array(forces)
    bending = velocity[:, None] - (np.abs(velocity) / level(velocity))[:, None] * forces
    left = (w - curve[2] * velocity)[:, None] - forces
    damping = np.maximum(np.sum(left * bending, 0) / np.sum(bending**2, 0), 0)
    best = int(np.argmin(np.sum((left - damping * bending) ** 2, axis=0)))
    return stiffnesses[best], damping[best]


class MaxwellSlip(AbstractOperatorLaw):
    """The friction force of springs in parallel, each with an end that slips where it
    is stretched beyond a limit: w = sum of stiffnesses (u - slider).

    It is rate independent, and remembers all turning points that larger loops have not
    wiped out. Springs are slack at u = 0, or as slack as the first input lets them; so
    a record should start from rest with its position 0 there.

    **Attributes:**

    - `stiffnesses`: shape (k,), N/m (output over input units).
    - `limits`: stretches at which they slip, shape (k,), m (input units). A spring with
        0, on which a fit may end, has no force; of one that never slips, with a limit
        beyond the input's range, no record tells it.
    - `names`, `units`: of input and output; keyword only.

    **Source:** Iwan (1966), doi 10.1115/1.3625199; Goldfarb and Celanovic (1997),
    doi 10.1109/37.588158.
    """

    stiffnesses: Float[Array, " k"] = eqx.field(converter=numbers)
    limits: Float[Array, " k"] = eqx.field(converter=numbers)

    def __check_init__(self):
        check_elements(stiffnesses=self.stiffnesses, limits=self.limits)
        checks.positive("limits", self.limits, zero=True)

    @classmethod
    def guess(cls, recording: Recording, elements: int = 4) -> "MaxwellSlip":
        """A first model of so many `elements`: stiffnesses by least squares with none
        negative, of which neighbours on a grid of limits, over half the input's range,
        are taken together until as many are left.

        **Raises:** `InputError` where there is no loop, or one that is run through the
        other way.
        """
        checks.count("elements", elements)
        wide_loop(recording, lags=False)
        u, w = arrays(recording)
        half = np.ptp(u) / 2
        end = max(half, float(np.max(np.abs(u))))  # what slips on the first way there

        def fitted(limits):
            plays = Plays(jnp.asarray(limits)).at_samples(recording.path)
            return non_negative(u[:, None] - np.asarray(plays), w)[0]

        # Fits from limits that are far off end in false minima: the sum of squares has
        # a kink wherever a limit is the way that the input went.
        # The last of the grid is not reached: a spring that never slips.
        grid = half * np.linspace(0, 1, max(_LIMITS, elements) + 1)[1:]
        if end > half:
            grid = np.append(grid, np.linspace(half, end, _FARTHER + 1)[1:])
        limits = _centres(grid, fitted(grid), elements, end)
        stiffnesses = fitted(limits)
        return cls(
            np.maximum(stiffnesses, 1e-3 * stiffnesses.max()),
            limits,
            names=recording.names,
            units=recording.units,
        )

    @property
    def memory(self):
        return Plays(self.limits)

    def output(self, x, m, now):
        return self.stiffnesses @ (now.u - m)

    def dimensions(self):
        return {"stiffnesses": (1, -1, 0), "limits": (0, 1, 0)}

    def bounds(self):
        return from_zero("limits", self.limits)

    def addends(self):
        stiffnesses = np.asarray(self.stiffnesses)
        plays = stack_of((-stiffnesses).tolist(), self.limits.tolist())
        return together(((sum(stiffnesses.tolist()), Term.parse("u")), *plays))


def _centres(at: np.ndarray, share: np.ndarray, count: int, end: float) -> np.ndarray:
    """Where so many elements stand best for others: neighbours at their centre of
    weight, those first that move least; and in the widest gaps up to the `end`, where
    there are too few."""
    at, share = at[share > 0], share[share > 0]
    while len(at) > count:
        both = share[1:] * share[:-1] / (share[1:] + share[:-1])
        i = int(np.argmin(both * np.diff(at) ** 2))
        at[i] = np.average(at[i : i + 2], weights=share[i : i + 2])
        share[i] += share[i + 1]
        at, share = np.delete(at, i + 1), np.delete(share, i + 1)
    while len(at) < count:
        edges = np.array([0.0, *at, end])
        i = int(np.argmax(np.diff(edges)))
        at = np.insert(at, i, (edges[i] + edges[i + 1]) / 2)
    return at


_LOW, _HIGH = 0.01, 0.95  # first shares of the stiffness that is left after yield


class BoucWenForce(AbstractModel):
    """The restoring force of a spring that yields, over a position u:

        w = alpha k u + (1 - alpha) k z
        z' = u' - beta |u'| z |z|^(n-1) - gamma u' |z|^n

    The slope of z at 0 is 1: another could be taken into k, beta and gamma, and no
    record would tell. n is known as well as the record has a knee; where it never
    yields, only k is.

    The output tells z: the fit of a record starts at its first force.

    **Attributes:** scalars.

    - `alpha`: stiffness after yield over that before, without a unit, from 0 to 1.
    - `k`: stiffness before, N/m (output over input units), positive.
    - `beta`, `gamma`: m^-n (input units to the power -n). Loops are closed for beta >
        0, and z comes to (beta + gamma)^(-1/n).
    - `n`: sharpness of the knee, positive.
    - `names`, `units`: of input and output; keyword only.

    **Source:** Wen (1976), doi 10.1061/JMCEA3.0002106; what is redundant, Ma et al.
    (2004), doi 10.1115/1.1668082.
    """

    alpha: Float[Array, ""] = eqx.field(converter=Bounded("alpha", 0.0, 1.0, (0.0,)))
    k: Float[Array, ""] = eqx.field(converter=Bounded("k"))
    beta: Float[Array, ""] = eqx.field(converter=number)
    gamma: Float[Array, ""] = eqx.field(converter=number)
    n: Float[Array, ""] = eqx.field(converter=Bounded("n", admits=(0.0,)), default=1.0)

    @classmethod
    def guess(cls, recording: Recording) -> "BoucWenForce":
        """A first model, read off the widest loop of a record: its slopes after and
        before turning points, and its height.

        **Raises:** `InputError` where there is no loop, or one that is run through the
        other way.
        """
        alpha, k, bend = _knee_of(recording)
        return cls(
            alpha,
            k,
            bend / 2,
            bend / 2,
            1.0,
            names=recording.names,
            units=recording.units,
        )

    @property
    def hidden(self):
        return False

    @property
    def rate_independent(self):
        return True

    def powers(self):
        return knee_powers(self.beta, self.gamma, self.n)

    def dimensions(self):
        knee = dict.fromkeys(("beta", "gamma"), (0, -float(self.n), 0))
        return {"k": (1, -1, 0)} | knee

    def kinks(self, x):
        return (x,)

    # The state is the force (1 - alpha) k z, of the size of the output, so that the
    # tolerances of solvers mean what they say.

    def start(self, m, now, seen):
        return seen - self.alpha * self.k * now.u

    def rate(self, x, m, now):
        scale = (1 - self.alpha) * self.k
        return scale * (now.du - knee(x / scale, now.du, self.beta, self.gamma, self.n))

    def output(self, x, m, now):
        return self.alpha * self.k * now.u + x


_SLIP, _THERE = 0.1, 0.5  # q and lam, which few records tell


class BoucWenBaberNoori(AbstractModel):
    """The restoring force of a spring that yields, weakens and slips, over a position:

        w = alpha k u + (1 - alpha) k z,    e' = (1 - alpha) k z u'
        z' = h (u' - (1 + delta_nu e) (beta |u'| z |z|^(n-1) + gamma u' |z|^n))
             / (1 + delta_eta e)
        h = 1 - zeta_1 exp(-(z sgn u' - q z_u)^2 / zeta_2^2)
        z_u = ((1 + delta_nu e) (beta + gamma))^(-1/n)
        zeta_1 = zeta_s (1 - exp(-p e)),  zeta_2 = (psi + delta_psi e) (lam + zeta_1)

    With e, the energy that it has taken up, strength (delta_nu) and stiffness
    (delta_eta) degrade and loops are pinched (h). It starts undamaged and slack: e = z
    = 0.

    A record that hardly pinches does not tell q, p, psi, delta_psi and lam from each
    other (`stats["certainty"].undetermined()` of a fit says which): keep some of them
    by `hj.refine(..., fixed=[...])`. psi and lam both give the width of the slip, and
    are told apart by how it grows with zeta_1 only.

    **Attributes:** scalars; energies in J (output times input units).

    - `alpha`, `k`, `beta`, `gamma`, `n`: as of `BoucWenForce`.
    - `delta_nu`, `delta_eta`: loss of strength and of stiffness, 1/J.
    - `zeta_s`: most of the slip, without a unit, from 0 to 1.
    - `q`: where it is, over z_u, without a unit.
    - `p`: how soon it comes, 1/J, positive.
    - `psi`, `delta_psi`: width of the slip, m (input units), and its growth, m/J.
    - `lam`: share of it that is there from the start, without a unit, positive.
    - `names`, `units`: of input and output; keyword only.

    **Source:** Baber and Noori (1985),
    doi 10.1061/(ASCE)0733-9399(1985)111:8(1010), with the slip as in Foliente (1995),
    doi 10.1061/(ASCE)0733-9445(1995)121:6(1013).
    """

    alpha: Float[Array, ""] = eqx.field(converter=Bounded("alpha", 0.0, 1.0, (0.0,)))
    k: Float[Array, ""] = eqx.field(converter=Bounded("k"))
    beta: Float[Array, ""] = eqx.field(converter=number)
    gamma: Float[Array, ""] = eqx.field(converter=number)
    n: Float[Array, ""] = eqx.field(converter=Bounded("n", admits=(0.0,)))
    delta_nu: Float[Array, ""] = eqx.field(converter=number, default=0.0)
    delta_eta: Float[Array, ""] = eqx.field(converter=number, default=0.0)
    zeta_s: Float[Array, ""] = eqx.field(
        converter=Bounded("zeta_s", 0.0, 1.0, (0.0, 1.0)), default=0.5
    )
    q: Float[Array, ""] = eqx.field(converter=number, default=_SLIP)
    p: Float[Array, ""] = eqx.field(converter=Bounded("p", admits=(0.0,)), default=1.0)
    psi: Float[Array, ""] = eqx.field(
        converter=Bounded("psi", admits=(0.0,)), default=0.2
    )
    delta_psi: Float[Array, ""] = eqx.field(converter=number, default=0.0)
    lam: Float[Array, ""] = eqx.field(
        converter=Bounded("lam", admits=(0.0,)), default=_THERE
    )

    @classmethod
    def guess(cls, recording: Recording) -> "BoucWenBaberNoori":
        """A first model: of springs that weaken and slip more or less, about that of
        `BoucWenForce.guess`, the one whose free run is nearest to the record. Of one
        cycle, which does not tell what comes with the energy, that spring with a slip
        as wide as half of its knee, half of which has come by the middle of the record.

        **Raises:** `InputError` where there is no loop, or one that is run through the
        other way.
        """
        alpha, k, bend = _knee_of(recording)
        u, w = arrays(recording)
        energy = abs(float(np.sum((w[1:] + w[:-1]) / 2 * np.diff(u))))

        def numbers(stiffer, soft, n, zeta_s, p, psi, losses):
            knee, (strength, stiffness) = bend * stiffer, losses
            return (
                *(soft * alpha / stiffer, k * stiffer),
                *(knee**n / 2, knee**n / 2, n),
                *(strength / energy, stiffness / energy),
                *(zeta_s, _SLIP, p / energy, psi / knee, 0.0, _THERE),
            )

        if len(stretches(u)) > _CYCLE:
            tried = [numbers(*each) for each in itertools.product(*_PINCHED)]
            found = nearest(cls, np.array(tried).T, thinned(u, w))
        else:
            found = numbers(*_OF_ONE_CYCLE)
        return cls(*found, names=recording.names, units=recording.units)

    @property
    def rate_independent(self):
        return True

    def powers(self):
        return knee_powers(self.beta, self.gamma, self.n)

    def dimensions(self):
        per_energy = ("delta_nu", "delta_eta", "p")
        return {
            "k": (1, -1, 0),
            **dict.fromkeys(("beta", "gamma"), (0, -float(self.n), 0)),
            **dict.fromkeys(per_energy, (-1, -1, 0)),
            "psi": (0, 1, 0),
            "delta_psi": (-1, 0, 0),
        }

    def kinks(self, x):
        return (x[0],)

    def start(self, m, now, seen):
        return jnp.zeros_like(seen), jnp.zeros_like(seen)

    def rate(self, x, m, now):
        force, energy = x
        scale = (1 - self.alpha) * self.k
        z, weaker = force / scale, 1 + self.delta_nu * energy
        bend = weaker * knee(z, now.du, self.beta, self.gamma, self.n)
        slope = self._slip(z * jnp.sign(now.du), energy, weaker)
        slope = slope / (1 + self.delta_eta * energy)
        return scale * slope * (now.du - bend), force * now.du

    def _slip(self, ahead, energy, weaker):
        """h, the share of its slope that the force has where z is so far `ahead`."""
        # Without a limit, as where the spring hardens, there is none to slip at.
        total = weaker * (self.beta + self.gamma)
        limited = (total > 0) & (self.n > 0)
        last = jnp.where(limited, total, 1.0) ** (-1 / jnp.where(limited, self.n, 1.0))
        depth = -self.zeta_s * jnp.expm1(-self.p * energy)
        width = (self.psi + self.delta_psi * energy) * (self.lam + depth)
        # With lam = 0 it is 0 at first, and so is all slip.
        wide = limited & (width != 0)
        off = (ahead - self.q * last) / jnp.where(wide, width, 1.0)
        return 1 - depth * jnp.where(wide, jnp.exp(-(off**2)), 0.0)

    def output(self, x, m, now):
        force, _ = x
        return self.alpha * self.k * now.u + force


def _knee_of(recording: Recording) -> tuple[float, float, float]:
    """First alpha, k, and the sum of beta and gamma for n = 1, of a record."""
    loop = wide_loop(recording, lags=False)
    # It yields within the stroke, though samples may be too few to show how.
    least = max(1.2 * loop.swing, loop.height) / np.ptp(loop.u)
    k = max(loop.start_slope, least)
    alpha = float(np.clip(loop.end_slope / k, _LOW, _HIGH))
    # Between branches that have both yielded there is twice what z comes to.
    return alpha, k, 2 * (1 - alpha) * k / loop.height


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
        way = jnp.sign(now.u - m[-1])  # in a state that is given, not what was before
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
    n: Float[Array, ""] = eqx.field(converter=Bounded("n", 1.0, admits=(1.0,)))
    depth: int = eqx.field(
        converter=partial(checks.count, "depth"), static=True, default=32
    )

    @classmethod
    def guess(cls, recording: Recording) -> "RambergOsgood":
        """A first model, read off the widest loop of a record: the slope after turning
        points, and half of the branches, which are the curve itself.

        **Raises:** `InputError` where there is no loop, or one that is run through the
        other way or does not rise, and for strains that keep far from zero.
        """
        loop = wide_loop(recording, lags=False)
        low, high = float(jnp.min(recording.u)), float(jnp.max(recording.u))
        if max(low, -high) > high - low:
            raise InputError(
                f"`recording` has strains from {low:.6g} to {high:.6g}, far from 0, "
                "where this law begins: subtract from `u` what it is before any "
                "loading."
            )
        strain = (loop.u - loop.u[0]) / 2
        up = loop.rising - loop.rising[0]
        down = (loop.falling[-1] - loop.falling)[::-1]
        stress = (up + down) / 4
        if stress[-1] <= 0:
            raise InputError(
                "`recording` has a loop that does not rise from tip to tip, as this "
                "law does: fit another one, such as `Dahl`."
            )
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
            names=recording.names,
            units=recording.units,
        )

    @property
    def memory(self):
        return TurningPoints(self.depth)

    def dimensions(self):
        return {"stiffness": (1, -1, 0), "strength": (1, 0, 0)}

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
        # One more has the first derivatives of the root, two more its second ones. By
        # the secant, not as sgn(strain) y, whose derivative at 0 would be 0.
        return self.stiffness * strain / (1 + plastic(newton(0, newton(0, y))))
