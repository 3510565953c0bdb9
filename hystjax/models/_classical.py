"""Classical models of hysteresis, with the same interface as learned laws."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..library import Term
from ._base import AbstractLaw
from ._numbers import (
    coefficients,
    exponent,
    field_parameters,
    knee,
    number,
    polynomial,
    replace_fields,
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
    n: Float[Array, ""] = eqx.field(converter=exponent, default=1.0)

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

    def addends(self):
        n = float(self.n)
        return (
            (float(self.alpha), Term.parse("du")),
            (-float(self.beta), Term.parse(f"w*|du|*|w|^{n - 1!r}")),
            (-float(self.gamma), Term.parse(f"du*|w|^{n!r}")),
        )
