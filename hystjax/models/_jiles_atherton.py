"""Jiles and Atherton's model, by field or flux density; anhysteretic curves."""

import itertools
import math
from abc import abstractmethod

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from .._core import checks
from .._core.checks import InputError
from ..recording import Recording
from ..recording._notation import to_si
from ..saving import register
from ._base import AbstractLaw
from ._guess import Build, course, nearest, scaled, wide_loop
from ._numbers import Bounded, number

_SMALL = 1.0  # below which the Langevin function is a quotient of polynomials
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(64)


def _quotient() -> tuple[np.ndarray, np.ndarray]:
    """L / h of the Langevin function, 1 / (3 + h^2 / (5 + h^2 / (7 + ...))), as two
    polynomials in h^2, highest power first: up to 19, which leaves less than rounding
    for |h| < 1."""
    above, below = np.ones(1), np.array([19.0])
    for odd in range(17, 1, -2):
        above, below = below, np.polyadd(odd * below, np.append(above, 0.0))
    return above / below[-1], below / below[-1]


_ABOVE, _BELOW = _quotient()
_D_ABOVE, _D_BELOW = np.polyder(_ABOVE), np.polyder(_BELOW)


class AbstractAnhysteretic(eqx.Module):
    """The magnetisation over its saturation that a field leads to without losses."""

    @abstractmethod
    def __call__(
        self, h: Float[Array, ""]
    ) -> tuple[Float[Array, ""], Float[Array, ""]]:
        """That share, between -1 and 1, and its derivative by the field h, which is in
        units of the model's field `width`."""


@register
class Langevin(AbstractAnhysteretic):
    """Of moments that may point anywhere: coth h - 1/h.

    **Source:** Langevin (1905), doi 10.1051/jphystap:019050040067800.
    """

    def __call__(self, h):
        return _langevin(h)


@jax.custom_jvp
def _langevin(h: Float[Array, ""]) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """The Langevin function and its slope."""
    # A difference of two large numbers near 0: there L / h by a quotient. The slope is
    # 1 - 2 L / h - L^2, of which nothing is lost near 0, nor anything that matters
    # beside 1 far out.
    small = jnp.abs(h) < _SMALL
    square = jnp.where(small, h, 0.0) ** 2
    # Of its own precision: JAX keeps what it has traced.
    above, below = (jnp.asarray(each, square.dtype) for each in (_ABOVE, _BELOW))
    near = jnp.polyval(above, square) / jnp.polyval(below, square)
    far = jnp.where(small, _SMALL, jnp.abs(h))
    left = jnp.exp(-2 * far)  # where sinh and cosh would overflow
    ratio = jnp.where(small, near, ((1 + left) / (1 - left) - 1 / far) / far)
    return h * ratio, 1 - 2 * ratio - (h * ratio) ** 2


@_langevin.defjvp
def _(primals, tangents):
    # The slope is there already, and its own derivative takes that of L / h.
    (h,), (change,) = primals, tangents
    value, slope = _langevin(h)
    small = jnp.abs(h) < _SMALL
    square = jnp.where(small, h, 0.0) ** 2
    above, below, d_above, d_below = (
        jnp.polyval(jnp.asarray(each, square.dtype), square)
        for each in (_ABOVE, _BELOW, _D_ABOVE, _D_BELOW)
    )
    bend = (d_above - above / below * d_below) / below
    far = jnp.where(small, _SMALL, h)
    bend = jnp.where(small, 2 * h * bend, (slope - value / far) / far)
    return (value, slope), (slope * change, -2 * (bend + value * slope) * change)


@register
class Uniaxial(AbstractAnhysteretic):
    """Of moments with an easy axis, a share of them, beside others that may point
    anywhere.

    The energy of a moment at an angle t to the field, over the thermal one, is
    -h cos t + K (sin(p - t)^2 + sin(p + t)^2) / 2 with an easy axis at an angle p: but
    for a constant it is -h cos t - K cos(2 p) (cos t)^2. So a loop tells K cos(2 p)
    only, never K and p; that is `anisotropy`, positive for a field along the easy axis
    and negative across. Means over all directions are by 64 nodes of Gauss and
    Legendre, right to 1e-10 for |h| and |anisotropy| up to 100.

    **Attributes:** scalars without a unit.

    - `anisotropy`: K cos(2 p), K the anisotropy's energy density over that of a moment
        in a field of `width`.
    - `share`: of the moments, between 0 and 1.

    **Source:** Ramesh, Jiles and Roderick (1996), doi 10.1109/20.539344; shares as in
    Szewczyk (2014), doi 10.3390/ma7075109.
    """

    anisotropy: Float[Array, ""] = eqx.field(converter=number)
    share: Float[Array, ""] = eqx.field(
        converter=Bounded("share", 0.0, 1.0, (0.0, 1.0))
    )

    def __call__(self, h):
        exponents = h * _NODES + self.anisotropy * _NODES**2
        chances = _WEIGHTS * jnp.exp(
            exponents - jax.lax.stop_gradient(jnp.max(exponents))
        )
        chances = chances / jnp.sum(chances)
        mean = jnp.sum(chances * _NODES)
        # The variance about the mean, which is no difference of large numbers.
        variance = jnp.sum(chances * (_NODES - mean) ** 2)
        value, slope = Langevin()(h)
        one, other = self.share, 1 - self.share
        return one * mean + other * value, one * variance + other * slope


MU0 = 4e-7 * np.pi  # V s/(A m); to 1e-9 the measured one
_STEEP = 0.05  # of the slope of H over B from tip to tip: what is less is noise
_SHARE = 0.3  # of the saturation, least at the tips of a loop
_MAGNETIC = ("A/m", "T", "A m²", "A m²/kg")
_LEAST = 1e-4  # of 1 - coupling times susceptibility: what is less is a jump


class Components(eqx.Module):
    """What a magnetisation is made of, A/m.

    **Attributes:** `total` M; `anhysteretic`, where it is drawn to; and its
    `irreversible` and `reversible` parts, whose sum it is.
    """

    total: Float[Array, "*s"]
    anhysteretic: Float[Array, "*s"]
    irreversible: Float[Array, "*s"]
    reversible: Float[Array, "*s"]


def _check_units(recording: Recording, expected: tuple[str, str]) -> None:
    """Raise `InputError` for units of magnetism other than these: mu0 is a number of
    A/m and T only. Other devices may behave like magnets."""
    for unit, wanted in zip(recording.units, expected, strict=True):
        found = to_si(unit)
        if found[0] in _MAGNETIC and found != (wanted, 1.0):
            raise InputError(
                f"`recording` has the units {recording.units}, and mu0 in B = mu0 (H + "
                f"M) asks for {expected}. `hystjax.loops.in_si(recording)` converts H "
                "and B, or give a file in these units; of a magnetisation make B first."
            )


# What is tried of a loop off centre: the share of the saturation at the farthest field,
# that of the work that the coupling does, pinning over that field, and reversibility.
_TRIED = (0.4, 0.6, 0.8, 0.93), (0.2, 0.5, 0.8), np.geomspace(0.03, 1, 7), (0.1, 0.4)
_POWERS = (1, 0, 0, -1, 0)  # of the output's scale, in the numbers of the model


def _magnetised(field: float, density: float) -> float:
    """The magnetisation where field strength and flux density are these.

    **Raises:** `InputError` where there is none.
    """
    top = density / MU0 - field
    if not top > 0:
        raise InputError(
            f"`recording` shows no magnet: its flux density goes to {density:.3g} T, "
            f"that of empty space to {MU0 * field:.3g} T in its field strength of "
            f"{field:.3g} A/m. Is one of them in another unit, or no such quantity?"
        )
    return top


def _tried(build: Build, h: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Numbers of models, a column each, for loops to one side of 0, of which little can
    be read off: the anhysteretic curve goes through the farthest point of the loop, and
    then all is scaled until the free run over the field strength is as large as it.

    **Raises:** `InputError` where nothing is magnetised.
    """
    field, density = (float(np.max(np.abs(x))) for x in (h, b))
    top = _magnetised(field, density)
    share, coupled, pinning, reversible = np.array([*itertools.product(*_TRIED)]).T
    inverse = share * (3 - share**2) / (1 - share**2)  # of Langevin's, as below
    width = field / (inverse - 3 * coupled * share)
    saturation = top / share
    coupling = 3 * coupled * width / saturation
    columns = np.stack([saturation, width, pinning * field, coupling, reversible])
    return scaled(build, columns, _POWERS, (h, b))


def _first(field: float, density: float, coercive: float, slope: float):
    """First numbers of a model: of the field strength and the flux density at the tips
    of a loop, its coercive field, and dB/dH in the middle of its branches.

    **Raises:** `InputError` where nothing is magnetised.
    """
    top = _magnetised(field, density)
    # The anhysteretic curve of a material in which the coupling does half of the work:
    # a slope of saturation / (3 a - coupling saturation), the former twice the latter.
    # It goes through the tip where the inverse of the Langevin function at the share
    # s = top / saturation is 1.5 (1 + steepness) s: s (3 - s^2) / (1 - s^2), by Cohen
    # (1991), doi 10.1007/BF00366640.
    steepness = max(field / top * (slope / MU0 - 1), 1.0)
    ratio = 1.5 * (1 + steepness)
    share = max(math.sqrt((ratio - 3) / (ratio - 1)), _SHARE)
    saturation = top / share
    width = 2 / 3 * saturation / top * field / steepness
    return saturation, width, coercive, 1.5 * width / saturation, 0.2


class JilesAtherton(AbstractLaw):
    """The flux density B = mu0 (H + M) in a ferromagnet, over the field strength H.

    With the effective field He = H + coupling M and the anhysteretic Man(He),

        M = (1 - reversibility) Mirr + reversibility Man
        dMirr/dHe = max(0, s (Man - Mirr) / pinning),    s = sign of H'

    The maximum is the clamp (delta_M) without which susceptibility is negative after
    a turn, until M has come to the other side of Man. For M this gives X / (1 -
    coupling X) for dM/dH, X = max(0, s (Man - M) / pinning) + reversibility dMan/dHe.
    Where the denominator would be less than 1e-4, M jumps as far as steps are fine.
    Where the clamp ends, inside of a step, the slope has a kink: `FixedStep` is of
    second order there, the default right to some 1e-6; `Adaptive` sees to it.

    B tells M, which is no state of its own: the fit of a record starts at its first B.

    **Attributes:** scalars, positive.

    - `saturation`: Ms, A/m.
    - `width`: a, A/m: the field in which a moment is as good as free.
    - `pinning`: k, A/m; near the coercive field in soft materials.
    - `coupling`: alpha, without a unit, 1e-6 to 1e-2.
    - `reversibility`: c, without a unit, below 1.
    - `anhysteretic`: `Langevin()`, or `Uniaxial(...)` for anisotropic materials.
    - `names`, `units`: of input and output, H in A/m and B in T; keyword only.

    **Source:** Jiles and Atherton (1986), doi 10.1016/0304-8853(86)90066-1; with the
    clamp as in Bergqvist (1996), doi 10.1109/20.539337.
    """

    saturation: Float[Array, ""] = eqx.field(converter=Bounded("saturation"))
    width: Float[Array, ""] = eqx.field(converter=Bounded("width"))
    pinning: Float[Array, ""] = eqx.field(converter=Bounded("pinning"))
    coupling: Float[Array, ""] = eqx.field(converter=Bounded("coupling", admits=(0.0,)))
    reversibility: Float[Array, ""] = eqx.field(
        converter=Bounded("reversibility", 0.0, 1.0, (0.0, 1.0))
    )
    anhysteretic: AbstractAnhysteretic = Langevin()

    def __check_init__(self):
        if not isinstance(self.anhysteretic, AbstractAnhysteretic):
            raise InputError(
                "`anhysteretic` must be a curve such as `Langevin()` or "
                f"`Uniaxial(...)`, got {checks.described(self.anhysteretic)}."
            )

    @classmethod
    def guess(
        cls, recording: Recording, anhysteretic: AbstractAnhysteretic = Langevin()
    ) -> "JilesAtherton":
        """A first model, read off the widest loop of a record of B over H: its tips,
        its coercive field and the slope of the line in its middle; of a loop to one
        side of 0, that of many whose free run is nearest.

        **Raises:** `InputError` where there is no loop, or one that is run through the
        other way, where the flux density is no more than that of empty space, and for
        units of magnetism other than A/m and T.
        """
        loop = wide_loop(recording, lags=True)
        _check_units(recording, ("A/m", "T"))
        if loop.off_centre:
            seen = course(recording)

            def build(*numbers):
                return cls(*numbers, anhysteretic=anhysteretic)

            numbers = nearest(build, _tried(build, *seen), seen)
        else:
            field, density = np.ptp(loop.u) / 2, loop.swing / 2
            numbers = _first(field, density, loop.coercive, loop.middle_slope)
        return cls(
            *numbers,
            anhysteretic=anhysteretic,
            names=recording.names,
            units=recording.units,
        )

    @property
    def rate_independent(self):
        return True

    def dimensions(self):
        return dict.fromkeys(("saturation", "width", "pinning"), (0, 1, 0))

    def rate(self, x, m, now):
        magnetisation = x / MU0 - now.u
        direction = jnp.sign(now.du)
        chi = self.susceptibility(now.u, magnetisation, direction)
        return MU0 * (1 + chi) * now.du

    def susceptibility(
        self,
        field: Float[ArrayLike, ""],
        magnetisation: Float[ArrayLike, ""],
        direction: Float[ArrayLike, ""],
    ) -> Float[Array, ""]:
        """dM/dH, never negative, of a field strength and a magnetisation, both A/m,
        and the sign of H'."""
        level, slope = self._drawn_to(field + self.coupling * magnetisation)
        pull = direction * (level - magnetisation) / self.pinning
        # Not `maximum`, whose derivative looks for ties.
        by_effective = jnp.where(pull > 0, pull, 0.0) + self.reversibility * slope
        left = 1 - self.coupling * by_effective
        return by_effective / jnp.where(left > _LEAST, left, _LEAST)

    def components(
        self, field: Float[ArrayLike, "*s"], density: Float[ArrayLike, "*s"]
    ) -> Components:
        """Parts of the magnetisation where the field strength, A/m, and the flux
        density, T, are these."""
        field = jnp.asarray(field)
        total = jnp.asarray(density) / MU0 - field
        level, _ = jnp.vectorize(self._drawn_to)(field + self.coupling * total)
        share = self.reversibility
        rest = jnp.where(share < 1, 1 - share, 1.0)  # of 1 nothing is irreversible
        irreversible = (total - share * level) / rest
        return Components(total, level, irreversible, total - irreversible)

    def _drawn_to(self, effective):
        """The anhysteretic magnetisation and its derivative by the effective field."""
        value, slope = self.anhysteretic(effective / self.width)
        return self.saturation * value, self.saturation / self.width * slope


class InverseJilesAtherton(AbstractLaw):
    """The field strength H in a ferromagnet over its flux density B: what
    `JilesAtherton` is the other way round.

        dH/dB = 1 / (mu0 (1 + dM/dH)),    M = B / mu0 - H

    **Attributes:**

    - `device`: a `JilesAtherton`, whose parameters these are.
    - `names`, `units`: of input and output, B in T and H in A/m; keyword only.

    **Source:** Leite et al. (2004), doi 10.1109/TMAG.2004.830998, who have B for the
    variable.
    """

    device: JilesAtherton

    def __check_init__(self):
        if not isinstance(self.device, JilesAtherton):
            raise InputError(
                "`device` must be a `JilesAtherton`, got "
                f"{checks.described(self.device)}."
            )

    @classmethod
    def guess(
        cls, recording: Recording, anhysteretic: AbstractAnhysteretic = Langevin()
    ) -> "InverseJilesAtherton":
        """A first model, read off the widest loop of a record of H over B as that of
        `JilesAtherton` is of one of B over H.

        **Raises:** `InputError` as there.
        """
        loop = wide_loop(recording, lags=False)
        _check_units(recording, ("T", "A/m"))
        if loop.off_centre:
            b, h = course(recording)

            def build(*numbers):
                return JilesAtherton(*numbers, anhysteretic=anhysteretic)

            tried = _tried(build, h, b)
            numbers = nearest(lambda *each: cls(build(*each)), tried, (b, h))
        else:
            field, density = loop.swing / 2, np.ptp(loop.u) / 2
            half = len(loop.u) // 2
            coercive = float(loop.rising[half] - loop.falling[half]) / 2
            steepest = max(loop.middle_slope, _STEEP * field / density)
            numbers = _first(field, density, coercive, 1 / steepest)
        device = JilesAtherton(*numbers, anhysteretic=anhysteretic)
        return cls(device, names=recording.names, units=recording.units)

    @property
    def rate_independent(self):
        return True

    def dimensions(self):
        return {f"device.{x}": (1, 0, 0) for x in self.device.dimensions()}

    def rate(self, x, m, now):
        direction = jnp.sign(now.du)  # H and B rise together
        chi = self.device.susceptibility(x, now.u / MU0 - x, direction)
        return now.du / (MU0 * (1 + chi))
