"""Classical models of hysteresis, with the same interface as learned laws."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..library import Term
from ._base import AbstractLaw, field_parameters, replace_fields
from ._numbers import exponent, knee, number


class Duhem(AbstractLaw):
    """The Duhem law w' = alpha |u'| u - beta |u'| w + gamma u'.

    **Attributes:**

    - `alpha`: 1 over input units times output over input units, a scalar.
    - `beta`: 1 over input units, a scalar; positive for a law that forgets.
    - `gamma`: output over input units, a scalar.
    - `names`, `units`: of input and output; keyword only.

    **Source:** Coleman and Hodgdon (1986), doi 10.1016/0020-7225(86)90064-0.
    """

    alpha: Float[Array, ""] = eqx.field(converter=number)
    beta: Float[Array, ""] = eqx.field(converter=number)
    gamma: Float[Array, ""] = eqx.field(converter=number)

    def rate(self, w, u, du):
        return (self.alpha * u - self.beta * w) * jnp.abs(du) + self.gamma * du

    def parameters(self):
        return field_parameters(self)

    def with_parameters(self, values):
        return replace_fields(self, values)

    def addends(self):
        return (
            (float(self.gamma), Term.parse("du")),
            (float(self.alpha), Term.parse("u*|du|")),
            (-float(self.beta), Term.parse("w*|du|")),
        )


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

    def rate(self, w, u, du):
        return self.alpha * du - knee(w, du, self.beta, self.gamma, self.n)

    def parameters(self):
        return field_parameters(self)

    def with_parameters(self, values):
        return replace_fields(self, values)

    def addends(self):
        n = float(self.n)
        signed = Term((1, 0, 0, 1, n - 1)) if n != 1 else Term.parse("w*|du|")
        return (
            (float(self.alpha), Term.parse("du")),
            (-float(self.beta), signed),
            (-float(self.gamma), Term((0, 0, 1, 0, n))),
        )
