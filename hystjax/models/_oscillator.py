"""A mass on a hysteretic spring, whose law nobody measures."""

import re

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from .._core.checks import is_concrete
from ._base import AbstractModel
from ._classical import BoucWen
from ._equations import equation, signed_sum
from ._machine import AbstractMachine
from ._numbers import field_parameters, number

_RENAMED = {"w": "z", "u": "y"}  # the spring's law is driven by y and makes z


class Oscillator(AbstractMachine):
    """A mass on a spring and a damper, and a hysteretic spring beside them:

        mass y'' + damping y' + stiffness y + z = u

    The input is the force u, the output the position y. The force z of the hysteretic
    spring is the output of a law that the position drives, such as z' = f(z, y, y'), or
    with a memory of the position z = k stop(y, r), dry friction with a contact that
    gives; nobody measures it. A recording starts at rest: at its first position, with
    y' zero, the output of a law of the rate zero, and plays as close to zero as that
    position lets them.

    A part of z in proportion to y is one with the stiffness; all else of z is known,
    for it is a force that adds to the others.

    How a spring with memory is advanced, and what its parameters are called, is told of
    `AbstractMachine`.

    **Attributes:** units for u in N and y in m.

    - `mass`: a scalar, kg.
    - `damping`: a scalar, N s/m.
    - `stiffness`: a scalar, N/m.
    - `spring`: the law of z, a model whose input is y.
    - `names`, `units`: of input and output; keyword only.
    """

    mass: Float[Array, ""] = eqx.field(converter=number)
    damping: Float[Array, ""] = eqx.field(converter=number)
    stiffness: Float[Array, ""] = eqx.field(converter=number)
    spring: AbstractModel

    def rest(self, seen):
        return seen, jnp.zeros_like(seen)

    def driver(self, own):
        return own

    def motion(self, own, force, now):
        y, v = own
        left = now.u - self.damping * v - self.stiffness * y - force
        return v, left / self.mass

    def output(self, x, m, now):
        (y, _), _ = x
        return y

    def inner_axes(self, names, units):
        return (names[1], units[1]), ("hidden force z", units[0])

    def hidden_signals(self, u, w, rate):
        v = rate(w)
        z = u - self.mass * rate(v) - self.damping * v - self.stiffness * w
        return self.spring.hidden_signals(w, z, rate)

    def __str__(self) -> str:
        leaves = jax.tree.leaves(eqx.filter(self, eqx.is_array))
        return equations(self) if is_concrete(*leaves) else repr(self)


def BoucWenOscillator(
    mass: Float[ArrayLike, ""],
    damping: Float[ArrayLike, ""],
    stiffness: Float[ArrayLike, ""],
    alpha: Float[ArrayLike, ""],
    beta: Float[ArrayLike, ""],
    gamma: Float[ArrayLike, ""],
    n: Float[ArrayLike, ""] = 1.0,
    *,
    names: tuple[str, str] = ("input", "output"),
    units: tuple[str, str] = ("", ""),
) -> Oscillator:
    """An `Oscillator` with a `BoucWen` spring:

        mass y'' + damping y' + stiffness y + z = u
        z' = alpha y' - beta |y'| z |z|^(n-1) - gamma y' |z|^n

    Only m, c, k and what follows decide y: alpha, beta and gamma are known because z is
    a force that adds to the others. (Where a product beta' gamma' stands for beta, as
    in the benchmark, the product alone can be found.)

    **Arguments:** all scalars; units for u in N and y in m.

    - `mass`: kg.
    - `damping`: N s/m.
    - `stiffness`: N/m.
    - `alpha`: N/m, slope of z where it starts from 0.
    - `beta`, `gamma`: N^(1-n)/m.
    - `n`: sharpness of the knee, positive, whole or not; 1 by default.
    - `names`, `units`: of input and output.

    **Source:** Wen (1976), doi 10.1061/JMCEA3.0002106; as the benchmark of Noël and
    Schoukens (2016), Hysteretic benchmark with a dynamic nonlinearity, doi
    10.4121/12967592.
    """
    spring = BoucWen(alpha, beta, gamma, n)
    return Oscillator(mass, damping, stiffness, spring, names=names, units=units)


def equations(model: Oscillator, digits: int = 4) -> str:
    """The oscillator in plain text, in one line. For concrete models only."""
    own = zip(field_parameters(model).values(), ("y''", "y'", "y"), strict=True)
    numbers = [(float(value), symbol) for value, symbol in own]
    balance = signed_sum(numbers, lambda c: f"{c:.{digits}g}", " ")
    spring = model.spring
    if spring.addends() is None:
        return f"{balance} + z = u, z of {spring}"
    law = re.sub(r"\b[wu]\b", lambda it: _RENAMED[it[0]], equation(spring, digits))
    return f"{balance} + z = u, {law}"
