"""Machines with a spring in them, whose law their own state drives; a mass on a
hysteretic spring, whose law nobody measures, is one."""

import re
from abc import abstractmethod
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from .._core import checks
from .._core.checks import InputError
from ..library import followed
from ..signals import Signals
from ._around import AbstractWhole, comes_late
from ._base import AbstractModel, equation, signed_sum
from ._classical import BoucWen
from ._numbers import field_parameters, number


class Held(NamedTuple):
    """What a spring is in.

    **Attributes:**

    - `flow`: its flowing state.
    - `memory`: the state of its memory as the step began; `()` for none.
    - `since`: its input as the step began, `Signals`; `()` without memory.
    """

    flow: Any
    memory: Any = ()
    since: Any = ()


class AbstractMachine(AbstractWhole):
    """A machine with a hysteretic spring in it, whose force nobody measures.

    The spring is any law of hystjax. What drives it, such as a position, is made of the
    machine's own state: so `rest`, `driver`, `motion` and `output` are all that a
    machine has to say, and all that the spring needs is done here.

    A memory of the spring, such as the plays of a stop, is advanced with the flow: in a
    step from what it was at its start, along the cubic that the driver's values and
    rates at both ends make, and for good when the step is done. Where a play starts to
    move inside of a step the Runge-Kutta method of `FixedStep` is of second order;
    `Automatic` ends steps there. Of a spring that is a device `Behind` a play it is of
    first order, `Automatic` may tell far less than its error (3e-8 for 3e-4), and the
    radius of that play has no derivative: `Adaptive` is right to what is asked.

    The state is a pair, of the machine's own and the spring's, a `Held`. Its parameters
    are its own numbers and those of the spring by their names there, but for those that
    would be there twice: the stiffness of a `Dahl` spring in a machine that has one is
    `spring.stiffness`.

    **Attributes:** `spring`, the law of the force, a model.
    """

    if TYPE_CHECKING:
        # As a field of this class it would be the first argument of all others.
        @property
        def spring(self) -> AbstractModel:
            """The law of the force."""
            ...
    else:
        spring: eqx.AbstractVar[AbstractModel]

    _part: ClassVar[str] = "spring"

    def __check_init__(self):
        if not isinstance(self.spring, AbstractModel):
            raise InputError(
                f"`spring` must be a model, such as `models.BoucWen`; got "
                f"{self.spring!r}."
            )
        zero = jnp.zeros(())
        kept = jax.eval_shape(self.spring.memory.start, Signals(zero, zero, zero))
        if not all(
            jnp.issubdtype(x.dtype, jnp.floating) for x in jax.tree.leaves(kept)
        ):
            raise InputError(
                f"`spring`, {self.spring}, has a memory of switches, which cannot flow "
                "with the position that drives it: use one of plays, stops or lags."
            )
        if comes_late(self.spring):
            raise InputError(
                f"`spring`, {self.spring}, has an output that comes late, which a step "
                "cannot know: leave its delay out."
            )

    @abstractmethod
    def rest(self, seen: Float[Array, ""]) -> Any:
        """The machine's own state where a recording starts at rest, at the output
        `seen`: a PyTree of arrays."""

    @abstractmethod
    def driver(self, own: Any) -> tuple[Float[Array, ""], Float[Array, ""]]:
        """What drives the spring, such as a position, and its rate, such as a velocity,
        of the machine's own state."""

    @abstractmethod
    def motion(self, own: Any, force: Float[Array, ""], now: Signals) -> Any:
        """Time derivative of the machine's own state, per s, under the force of the
        spring and the input."""

    @property
    def rate_independent(self):
        return False

    def start(self, m, now, seen):
        own = self.rest(seen)
        driver = Signals(now.t, *self.driver(own))
        memory = self.spring.memory
        kept = memory.start(driver)
        flow = self.spring.start(kept, driver, jnp.zeros_like(seen))
        if memory.empty:
            return own, Held(flow)
        return own, Held(flow, kept, jax.tree.map(jnp.asarray, driver))

    def rate(self, x, m, now):
        own, held = x
        driver, kept = self._driven(x, now)
        force = self.spring.output(held.flow, kept, driver)
        still = jax.tree.map(jnp.zeros_like, held)
        flow = self.spring.rate(held.flow, kept, driver)
        return self.motion(own, force, now), still._replace(flow=flow)

    def caught_up(self, x, m, now):
        own, held = x
        driver, kept = self._driven(x, now)
        flow = self.spring.caught_up(held.flow, kept, driver)
        return own, Held(flow, kept, driver) if held.since else Held(flow)

    def kinks(self, x):
        own, held = x
        u, du = self.driver(own)
        inside = self.spring.kinks(held.flow)
        if not held.since:
            return du, *inside
        started = self.spring.memory.kinks(held.memory, held.since._replace(u=u))
        return du, *inside, *started

    def inner(self, x, m, now):
        driver, kept = self._driven(x, now)
        _, held = x
        return driver.u, self.spring.output(held.flow, kept, driver)

    def _driven(self, x, now: Signals) -> tuple[Signals, Any]:
        """The spring's input, and the state of its memory."""
        own, held = x
        driver = Signals(now.t, *self.driver(own))
        if not held.since:
            return driver, ()
        return driver, followed(self.spring.memory, held.memory, held.since, driver)

    def _joined(self, inner, own):
        return own | inner


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

    def __check_init__(self):
        checks.not_zero("mass", self.mass, "nothing would oscillate.")

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

    def dimensions(self):
        # The spring's input is what is put out here, and its output is of the input's
        # kind, a force.
        spring = self._dimensions_inside()
        swapped = {name: (u, w, s) for name, (w, u, s) in spring.items()}
        return swapped | {
            "mass": (-1, 1, 2),
            "damping": (-1, 1, 1),
            "stiffness": (-1, 1, 0),
        }

    def inner_axes(self, names, units):
        return (names[1], units[1]), ("hidden force z", units[0])

    def hidden_signals(self, u, w, rate):
        v = rate(w)
        z = u - self.mass * rate(v) - self.damping * v - self.stiffness * w
        return self.spring.hidden_signals(w, z, rate)

    def text(self):
        own = zip(field_parameters(self).values(), ("y''", "y'", "y"), strict=True)
        numbers = [(float(value), symbol) for value, symbol in own]
        balance = signed_sum(numbers, lambda c: f"{c:.4g}", " ")
        spring = self.spring
        if spring.addends() is None:
            return f"{balance} + z = u, z of {spring.text()}"
        law = re.sub(r"\b[wu]\b", lambda it: _RENAMED[it[0]], equation(spring))
        return f"{balance} + z = u, {law}"


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
