"""A mass on a hysteretic spring: a classical model with hidden states."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._core.checks import is_concrete
from ._base import AbstractModel, field_parameters, replace_fields
from ._classical import BoucWen
from ._equations import equation, signed_sum
from ._numbers import exponent, knee, number

_RENAMED = str.maketrans("wu", "zy")  # the hidden law is driven by y and makes z


class BoucWenOscillator(AbstractModel):
    """A mass, a damper, and a spring with a Bouc-Wen restoring force z beside it:

        mass y'' + damping y' + stiffness y + z = u
        z' = alpha y' - beta |y'| z |z|^(n-1) - gamma y' |z|^n

    The input is the force u, the output the position y; the velocity y' and z are
    hidden. A recording starts at rest: at its first position, with y' and z zero.

    Only m, c, k and what follows decide y: alpha, beta and gamma are known because z is
    a force that adds to the others. (Where a product beta' gamma' stands for beta, as
    in the benchmark, the product alone can be found.)

    **Attributes:** all scalars; units for u in N and y in m.

    - `mass`: kg.
    - `damping`: N s/m.
    - `stiffness`: N/m.
    - `alpha`: N/m, slope of z where it starts from 0.
    - `beta`, `gamma`: N^(1-n)/m.
    - `n`: sharpness of the knee, positive, whole or not; 1 by default.
    - `names`, `units`: of input and output; keyword only.

    **Source:** Wen (1976), doi 10.1061/JMCEA3.0002106; as the benchmark of Noël and
    Schoukens (2016), Hysteretic benchmark with a dynamic nonlinearity, doi
    10.4121/12967592.
    """

    mass: Float[Array, ""] = eqx.field(converter=number)
    damping: Float[Array, ""] = eqx.field(converter=number)
    stiffness: Float[Array, ""] = eqx.field(converter=number)
    alpha: Float[Array, ""] = eqx.field(converter=number)
    beta: Float[Array, ""] = eqx.field(converter=number)
    gamma: Float[Array, ""] = eqx.field(converter=number)
    n: Float[Array, ""] = eqx.field(converter=exponent, default=1.0)

    @property
    def rate_independent(self):
        return False

    def kinks(self, x):
        _, v, z = x
        return v, z

    def start(self, m, now, seen):
        return seen, jnp.zeros_like(seen), jnp.zeros_like(seen)

    def rate(self, x, m, now):
        y, v, z = x
        force = now.u - self.damping * v - self.stiffness * y - z
        bend = knee(z, v, self.beta, self.gamma, self.n)
        return v, force / self.mass, self.alpha * v - bend

    def output(self, x, m, now):
        y, _, _ = x
        return y

    def parameters(self):
        return field_parameters(self)

    def with_parameters(self, values):
        return replace_fields(self, values)

    @property
    def spring(self) -> BoucWen:
        """The law of z, driven by the position."""
        return BoucWen(self.alpha, self.beta, self.gamma, self.n)

    def balance(self) -> tuple[tuple[float, str], ...]:
        """The left side of the balance of forces as coefficients and symbols. For
        concrete models only."""
        numbers = (self.mass, self.damping, self.stiffness, 1.0)
        symbols = ("y''", "y'", "y", "z")
        return tuple((float(x), s) for x, s in zip(numbers, symbols, strict=True))

    def __str__(self) -> str:
        leaves = [leaf for leaf in jax.tree.leaves(self) if eqx.is_array(leaf)]
        return equations(self) if is_concrete(*leaves) else repr(self)


def equations(model: BoucWenOscillator, digits: int = 4) -> str:
    """The oscillator in plain text, in one line."""
    balance = signed_sum(model.balance(), lambda c: f"{c:.{digits}g}", " ")
    return f"{balance} = u, {equation(model.spring, digits).translate(_RENAMED)}"
