"""A mass on a hysteretic spring, whose law nobody measures."""

import re

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from .._core.checks import InputError, is_concrete
from ..signals import Signals
from ._base import AbstractModel
from ._classical import BoucWen
from ._equations import equation, signed_sum
from ._numbers import field_parameters, number, replace_fields

_RENAMED = {"w": "z", "u": "y"}  # the spring's law is driven by y and makes z


class Oscillator(AbstractModel):
    """A mass on a spring and a damper, and a hysteretic spring beside them:

        mass y'' + damping y' + stiffness y + z = u

    The input is the force u, the output the position y. The force z of the hysteretic
    spring is the output of a law that the position drives, such as z' = f(z, y, y');
    nobody measures it. A recording starts at rest: at its first position, with y' zero
    and the law's output zero.

    A part of z in proportion to y is one with the stiffness; all else of z is known,
    for it is a force that adds to the others.

    Its parameters are its own numbers and those of the spring by their names there, but
    for those that would be there twice: the stiffness of a `Dahl` spring is
    `spring.stiffness`.

    **Attributes:** units for u in N and y in m.

    - `mass`: a scalar, kg.
    - `damping`: a scalar, N s/m.
    - `stiffness`: a scalar, N/m.
    - `spring`: the law of z, a model whose input is y. It cannot have a memory of its
        input, such as plays, since that is advanced where the input is known before.
    - `names`, `units`: of input and output; keyword only.
    """

    mass: Float[Array, ""] = eqx.field(converter=number)
    damping: Float[Array, ""] = eqx.field(converter=number)
    stiffness: Float[Array, ""] = eqx.field(converter=number)
    spring: AbstractModel

    def __check_init__(self):
        if not isinstance(self.spring, AbstractModel):
            raise InputError(
                f"`spring` must be a model, such as `models.BoucWen`; got "
                f"{self.spring!r}."
            )
        if not self.spring.memory.empty:
            raise InputError(
                f"`spring`, {self.spring}, has a memory of its input, and the position "
                "that drives it is known only as it moves: use a law z' = f(z, y, y'), "
                "without plays, relays or lags."
            )

    @property
    def rate_independent(self):
        return False

    def kinks(self, x):
        _, v, s = x
        return v, *self.spring.kinks(s)

    def start(self, m, now, seen):
        still = jnp.zeros_like(seen)
        at_rest = Signals(now.t, seen, still)
        return seen, still, self.spring.start((), at_rest, still)

    def rate(self, x, m, now):
        y, v, s = x
        driver = Signals(now.t, y, v)
        _, z = self.inner(x, m, now)
        force = now.u - self.damping * v - self.stiffness * y - z
        return v, force / self.mass, self.spring.rate(s, (), driver)

    def output(self, x, m, now):
        y, _, _ = x
        return y

    def inner(self, x, m, now):
        y, v, s = x
        return y, self.spring.output(s, (), Signals(now.t, y, v))

    def inner_axes(self, names, units):
        return (names[1], units[1]), ("hidden force z", units[0])

    def hidden_signals(self, u, w, rate):
        v = rate(w)
        z = u - self.mass * rate(v) - self.damping * v - self.stiffness * w
        return self.spring.hidden_signals(w, z, rate)

    def parameters(self):
        inside = self.spring.parameters()
        renamed = {self._outside(name): x for name, x in inside.items()}
        return field_parameters(self) | renamed

    def with_parameters(self, values):
        own = field_parameters(self)
        changed = replace_fields(self, {k: x for k, x in values.items() if k in own})
        inside = {self._outside(name): name for name in self.spring.parameters()}
        inner = {inside[name]: x for name, x in values.items() if name not in own}
        return changed._with(self.spring.with_parameters(inner))

    def bounds(self):
        inside = self.spring.bounds()
        return {self._outside(name): ends for name, ends in inside.items()}

    def _outside(self, name: str) -> str:
        """How a parameter of the spring is called here."""
        return f"spring.{name}" if name in field_parameters(self) else name

    @property
    def rows_in_use(self):
        return self.spring.rows_in_use

    def restricted(self, rows):
        return self._with(self.spring.restricted(rows))

    def settled(self):
        return self._with(self.spring.settled())

    def _with(self, spring: AbstractModel) -> "Oscillator":
        return eqx.tree_at(lambda model: model.spring, self, spring)

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
