"""Classical laws with the same interface as learned ones: Duhem's, Bouc and Wen's,
and two that are drawn to curves, Tellinen's between the branches of a major loop,
Coleman and Hodgdon's around one curve."""

import itertools

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from ..library import Term
from ..recording import Recording
from ._base import AbstractLaw
from ._guess import course, nearest, non_negative, scaled, wide_loop
from ._numbers import (
    Bounded,
    coefficients,
    field_parameters,
    knee,
    knee_powers,
    number,
    polynomial,
    replace_fields,
    together,
)


class Duhem(AbstractLaw):
    """The Duhem law w' = |u'| (f(u) - beta w) + g(u) u', f and g polynomials.

    With scalars, f(u) = alpha u and g(u) = gamma; with sequences of numbers, f(u) =
    alpha[0] + alpha[1] u + ... and likewise g.

    **Attributes:**

    - `alpha`: a scalar, or a tuple of scalars, that of u^k in output units over input
        units to the power k + 1.
    - `beta`: 1 over input units, a scalar; positive for a law that forgets.
    - `gamma`: likewise.
    - `names`, `units`: of input and output; keyword only.

    **Source:** Coleman and Hodgdon (1986), doi 10.1016/0020-7225(86)90064-0.
    """

    alpha: Float[Array, ""] | tuple[Float[Array, ""], ...] = eqx.field(
        converter=coefficients
    )
    beta: Float[Array, ""] = eqx.field(converter=number)
    gamma: Float[Array, ""] | tuple[Float[Array, ""], ...] = eqx.field(
        converter=coefficients
    )

    @property
    def rate_independent(self):
        return True

    def rate(self, x, m, now):
        pull = polynomial(self._drawn_to(), now.u) - self.beta * x
        return pull * jnp.abs(now.du) + polynomial(self._along(), now.u) * now.du

    def _drawn_to(self):
        """Coefficients of f, from u^0 on."""
        alpha = self.alpha
        return alpha if isinstance(alpha, tuple) else (jnp.zeros_like(alpha), alpha)

    def _along(self):
        """Coefficients of g, from u^0 on."""
        return self.gamma if isinstance(self.gamma, tuple) else (self.gamma,)

    def parameters(self):
        return field_parameters(self)

    def with_parameters(self, values):
        return replace_fields(self, values)

    def dimensions(self):
        along, drawn = enumerate(self._along()), enumerate(self._drawn_to())
        alpha = {f"alpha[{k}]": (1, -k - 1, 0) for k, _ in drawn}
        gamma = {f"gamma[{k}]": (1, -k - 1, 0) for k, _ in along}
        scalars = {"alpha": (1, -2, 0), "beta": (0, -1, 0), "gamma": (1, -1, 0)}
        return alpha | gamma | scalars

    def addends(self):
        # Numbers first: under `jit` what is computed of known ones is not known.
        along = [(float(c), _power_of_u(k, "du")) for k, c in enumerate(self._along())]
        alpha = self.alpha
        several = enumerate(alpha) if isinstance(alpha, tuple) else [(1, alpha)]
        drawn = [(float(c), _power_of_u(k, "|du|")) for k, c in several]
        return (*along, *drawn, (-float(self.beta), Term.parse("w*|du|")))


def _power_of_u(k: int, speed: str) -> Term:
    return Term.parse(f"u^{k}*{speed}")


class BoucWen(AbstractLaw):
    """The Bouc-Wen law w' = alpha u' - beta |u'| w |w|^(n-1) - gamma u' |w|^n.

    **Attributes:**

    - `alpha`: output over input units, a scalar.
    - `beta`, `gamma`: output units to the power 1 - n over input units, scalars.
    - `n`: sharpness of the knee, a positive scalar, whole or not.
    - `names`, `units`: of input and output; keyword only.

    **Source:** Wen (1976), doi 10.1061/JMCEA3.0002106.
    """

    alpha: Float[Array, ""] = eqx.field(converter=number)
    beta: Float[Array, ""] = eqx.field(converter=number)
    gamma: Float[Array, ""] = eqx.field(converter=number)
    n: Float[Array, ""] = eqx.field(converter=Bounded("n", admits=(0.0,)), default=1.0)

    @property
    def rate_independent(self):
        return True

    def kinks(self, x):
        return (x,)

    def rate(self, x, m, now):
        return self.alpha * now.du - knee(x, now.du, self.beta, self.gamma, self.n)

    def parameters(self):
        return field_parameters(self)

    def with_parameters(self, values):
        return replace_fields(self, values)

    def powers(self):
        return knee_powers(self.beta, self.gamma, self.n, self.alpha)

    def dimensions(self):
        knee = (1 - float(self.n), -1, 0)
        return {"alpha": (1, -1, 0), "beta": knee, "gamma": knee}

    def addends(self):
        n = float(self.n)
        addends = (
            (float(self.alpha), Term.parse("du")),
            (-float(self.beta), Term.parse(f"w*|du|*|w|^{n - 1!r}")),
            (-float(self.gamma), Term.parse(f"du*|w|^{n!r}")),
        )
        return together(addends)


_WIDTHS = 40  # of branches, that a guess tries
# What it tries of a loop off centre: coercive field and width over the farthest input,
# and the slope's share of the farthest output.
_TELLINEN = np.geomspace(0.03, 1, 8), np.geomspace(0.05, 1.5, 6), (0.05, 0.3, 0.6)
_CLOSED = 1e-12  # of the saturation: the loop's width that is none


class Tellinen(AbstractLaw):
    """The law of Tellinen: between the branches of its major loop, the output goes up
    (down) by the slope of the rising (falling) one, times the share of the loop's
    height that it is below (above) the other:

        w' = (slope + (top - w) / (top - bottom) (bottom' - slope)) u'  where u' > 0
        w' = (slope + (w - bottom) / (top - bottom) (top' - slope)) u'  where u' < 0

    Here the branches, top and bottom, are

        slope u + (2/pi) saturation atan((u ± coercive) / width)

    Loops inside are drawn towards their middle cycle by cycle, until they are closed.

    **Attributes:** scalars, positive.

    - `saturation`: T (output units).
    - `coercive`: half the major loop's width at 0, A/m (input units).
    - `width`: of its flanks, A/m.
    - `slope`: far out, T m/A (output over input units); mu0 for a flux density.
    - `names`, `units`: of input and output; keyword only.

    **Source:** Tellinen (1998), doi 10.1109/20.703856.
    """

    saturation: Float[Array, ""] = eqx.field(converter=Bounded("saturation"))
    coercive: Float[Array, ""] = eqx.field(converter=Bounded("coercive"))
    width: Float[Array, ""] = eqx.field(converter=Bounded("width"))
    slope: Float[Array, ""] = eqx.field(
        converter=Bounded("slope", admits=(0.0,)), default=4e-7 * np.pi
    )

    @classmethod
    def guess(cls, recording: Recording) -> "Tellinen":
        """A first model: branches through the widest loop of a record, least squares
        over a range of widths, with its coercive field; of a loop to one side of 0,
        that of many whose free run is nearest.

        **Raises:** `InputError` where there is no loop, or one that is run through the
        other way.
        """
        loop = wide_loop(recording, lags=True)
        if loop.off_centre:
            numbers = cls._to_one_side(recording)
            return cls(*numbers, names=recording.names, units=recording.units)
        reach, coercive = np.ptp(loop.u) / 2, loop.coercive
        middle = loop.u.mean()
        u = np.concatenate([loop.u - middle - coercive, loop.u - middle + coercive])
        w = np.concatenate([loop.rising, loop.falling])
        w = w - (w.max() + w.min()) / 2
        widths = np.geomspace(0.02, 2, _WIDTHS) * reach
        fits = [non_negative(np.column_stack([np.arctan(u / a), u]), w) for a in widths]
        best = int(np.argmin([misfit for _, misfit in fits]))
        scale, slope = fits[best][0]
        return cls(
            np.pi / 2 * scale,
            coercive,
            widths[best],
            max(slope, 1e-3 * loop.swing / 2 / reach),
            names=recording.names,
            units=recording.units,
        )

    @classmethod
    def _to_one_side(cls, recording: Recording) -> np.ndarray:
        """Its numbers, of a record to one side of 0."""
        seen = course(recording)
        reach, top = (np.max(np.abs(x)) for x in seen)
        coercive, width, share = np.array([*itertools.product(*_TELLINEN)]).T
        bends = np.arctan((1 - coercive) / width) + np.arctan((1 + coercive) / width)
        saturation = np.pi * (1 - share) / bends  # the mean of its branches at the tip
        columns = np.stack(
            [saturation * top, coercive * reach, width * reach, share * top / reach]
        )
        return nearest(cls, scaled(cls, columns, (1, 0, 0, 1), seen), seen)

    @property
    def rate_independent(self):
        return True

    def dimensions(self):
        across = dict.fromkeys(("coercive", "width"), (0, 1, 0))
        return {"saturation": (1, 0, 0), "slope": (1, -1, 0)} | across

    def rate(self, x, m, now):
        way = jnp.sign(now.du)
        scale = 2 / np.pi * self.saturation
        ahead = (now.u - way * self.coercive) / self.width
        behind = (now.u + way * self.coercive) / self.width
        # The distance of the branches as one arc tangent: that of two nearly equal ones
        # would be lost where the loop is closed.
        across = 2 * self.coercive / self.width
        gap = scale * jnp.arctan2(across, 1 + ahead * behind)
        bound = self.slope * now.u + scale * jnp.arctan(behind)
        share = way * (bound - x) / jnp.maximum(gap, _CLOSED * self.saturation)
        steep = scale / self.width / (1 + ahead**2)
        return (self.slope + share * steep) * now.du

    def branch(self, u: Float[ArrayLike, "*s"], way: float) -> Float[Array, "*s"]:
        """The rising (1) or falling (-1) branch of the major loop."""
        u = jnp.asarray(u)
        bend = jnp.arctan((u - way * self.coercive) / self.width)
        return self.slope * u + 2 / np.pi * self.saturation * bend


_SPANS = np.geomspace(0.05, 2, 40)  # widths that a guess tries, over the reach
_PULLS = np.geomspace(0.3, 100, 30)  # times the reach
_SOME = 0.02  # of the output's reach, and of 1, that is least in a guess
# What it tries of a loop off centre: width and pull by the farthest input, the slope's
# share of the farthest output, and the share that is reversible.
_COLEMAN = np.geomspace(0.1, 1.5, 6), np.geomspace(0.5, 30, 7), (0.05, 0.4), (0.1, 0.5)


def _from_middle(x: np.ndarray, u: np.ndarray) -> np.ndarray:
    """The integral from the middle of evenly spaced inputs on."""
    whole = np.append(0.0, np.cumsum((x[1:] + x[:-1]) / 2 * np.diff(u)))
    return whole - whole[len(u) // 2]


def _curves(x: np.ndarray, width: float) -> np.ndarray:
    """Integrals of g, and below them of f, over inputs of so many widths: by the slope
    far out, and by the saturation as far as it follows, and as it does not."""
    level, area = np.tanh(x), width * np.log(np.cosh(x))
    of_g = width * x, level, np.zeros_like(x)
    of_f = (width * x) ** 2 / 2, area, area
    return np.vstack([np.column_stack(of_g), np.column_stack(of_f)])


class ColemanHodgdon(AbstractLaw):
    """The law of Coleman and Hodgdon, w' = pull |u'| (f(u) - w) + g(u) u', with a curve
    that saturates and a slope between nothing and its own:

        f(u) = slope u + saturation tanh(u / width)
        g(u) = slope + following saturation / width / cosh(u / width)^2

    So g <= f', and equal far out, where loops close. From a turning point (u0, w0) on

        w = f(u) + (w0 - f(u0)) exp(-pull |u - u0|)
            - integral of (f' - g)(x) exp(-pull |u - x|) dx from u0 to u

    Polynomials for f and g are `Duhem`. With `following` near 1, or a `pull` by which
    all is over at once, loops are thin, and then these two are hard to tell apart.

    **Attributes:** scalars, positive.

    - `saturation`: T (output units).
    - `width`: of f, A/m (input units).
    - `slope`: far out, T m/A (output over input units).
    - `pull`: m/A (1 over input units).
    - `following`: of the slope of f beyond that far out, the share that is reversible:
        without a unit, from 0 to 1.
    - `names`, `units`: of input and output; keyword only.

    **Source:** Coleman and Hodgdon (1986), doi 10.1016/0020-7225(86)90064-0, for the
    law and what f and g must satisfy.
    """

    saturation: Float[Array, ""] = eqx.field(converter=Bounded("saturation"))
    width: Float[Array, ""] = eqx.field(converter=Bounded("width"))
    slope: Float[Array, ""] = eqx.field(converter=Bounded("slope", admits=(0.0,)))
    pull: Float[Array, ""] = eqx.field(converter=Bounded("pull", admits=(0.0,)))
    following: Float[Array, ""] = eqx.field(
        converter=Bounded("following", 0.0, 1.0, (0.0, 1.0))
    )

    @classmethod
    def guess(cls, recording: Recording) -> "ColemanHodgdon":
        """A first model from the branches of the widest loop of a record, least squares
        over a range of widths and pulls. Of half their distance d and their mean m the
        law says, in integrals,

            m' = g + pull d,    d' = pull (m - f)

        Of a loop to one side of 0, that of many whose free run is nearest.

        **Raises:** `InputError` where there is no loop, or one that is run through the
        other way.
        """
        loop = wide_loop(recording, lags=True)
        if loop.off_centre:
            numbers = cls._to_one_side(recording)
            return cls(*numbers, names=recording.names, units=recording.units)
        reach = np.ptp(loop.u) / 2
        u = (loop.u - loop.u.mean()) / reach
        mean, apart = loop.rising + loop.falling, loop.falling - loop.rising
        mean, apart = (mean - mean[::-1]) / 4, (apart + apart[::-1]) / 4
        along, across = (_from_middle(x, u) for x in (mean, apart))
        middle = apart[len(u) // 2]
        fits = []
        for width, pull in itertools.product(_SPANS, _PULLS):
            target = mean - pull * across, along - (apart - middle) / pull
            fit = non_negative(_curves(u / width, width), np.concatenate(target))
            fits.append((*fit, width, pull))
        (slope, follows, rest), _, width, pull = min(fits, key=lambda fit: fit[1])
        most = loop.swing / 2
        saturation = max(follows + rest, _SOME * most)
        return cls(
            saturation,
            width * reach,
            max(slope, _SOME * most) / reach,
            pull / reach,
            float(np.clip(follows / saturation, _SOME, 1 - _SOME)),
            names=recording.names,
            units=recording.units,
        )

    @classmethod
    def _to_one_side(cls, recording: Recording) -> np.ndarray:
        """Its numbers, of a record to one side of 0."""
        seen = course(recording)
        reach, top = (np.max(np.abs(x)) for x in seen)
        width, pull, share, following = np.array([*itertools.product(*_COLEMAN)]).T
        saturation = (1 - share) / np.tanh(1 / width)
        columns = np.stack(
            [
                saturation * top,
                width * reach,
                share * top / reach,
                pull / reach,
                following,
            ]
        )
        return nearest(cls, scaled(cls, columns, (1, 0, 1, 0, 0), seen), seen)

    @property
    def rate_independent(self):
        return True

    def dimensions(self):
        return {
            "saturation": (1, 0, 0),
            "width": (0, 1, 0),
            "slope": (1, -1, 0),
            "pull": (0, -1, 0),
        }

    def rate(self, x, m, now):
        level = jnp.tanh(now.u / self.width)
        steep = self.saturation / self.width * (1 - level**2)
        drawn_to = self.slope * now.u + self.saturation * level
        along = self.slope + self.following * steep
        return self.pull * jnp.abs(now.du) * (drawn_to - x) + along * now.du
