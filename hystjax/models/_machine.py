"""Machines with a spring in them, whose law their own state drives."""

from abc import abstractmethod
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._core.checks import InputError
from ..library import followed
from ..signals import Signals
from ._base import AbstractModel
from ._numbers import field_parameters, replace_fields

Machine = TypeVar("Machine", bound="AbstractMachine")


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


class AbstractMachine(AbstractModel):
    """A machine with a hysteretic spring in it, whose force nobody measures.

    The spring is any law of hystjax. What drives it, such as a position, is made of the
    machine's own state: so `rest`, `driver`, `motion` and `output` are all that a
    machine has to say, and all that the spring needs is done here.

    A memory of the spring, such as the plays of a stop, is advanced with the flow: in a
    step from what it was at its start, along the cubic that the driver's values and
    rates at both ends make, and for good when the step is done. Where a play starts to
    move inside of a step the Runge-Kutta method of `FixedStep` is of second order;
    `Automatic` ends steps there.

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
        if not held.since:
            return x
        driver, kept = self._driven(x, now)
        return own, Held(self.spring.caught_up(held.flow, kept, driver), kept, driver)

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

    def _with(self: Machine, spring: AbstractModel) -> Machine:
        return eqx.tree_at(lambda model: model.spring, self, spring)
