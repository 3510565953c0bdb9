"""What a ferromagnet would be magnetised to without losses: anhysteretic curves."""

from abc import abstractmethod

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..saving import register
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
        # A difference of two large numbers near 0: there L / h by a quotient. The slope
        # is 1 - 2 L / h - L^2, of which nothing is lost near 0, nor anything that
        # matters beside 1 far out.
        small = jnp.abs(h) < _SMALL
        square = jnp.where(small, h, 0.0) ** 2
        near = jnp.polyval(_ABOVE, square) / jnp.polyval(_BELOW, square)
        far = jnp.where(small, _SMALL, jnp.abs(h))
        left = jnp.exp(-2 * far)  # where sinh and cosh would overflow
        ratio = jnp.where(small, near, ((1 + left) / (1 - left) - 1 / far) / far)
        return h * ratio, 1 - 2 * ratio - (h * ratio) ** 2


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
    share: Float[Array, ""] = eqx.field(converter=Bounded("share", 0.0, 1.0))

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
