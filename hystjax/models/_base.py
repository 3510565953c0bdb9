"""The contract of models: memory, flow and output."""

from abc import abstractmethod
from collections.abc import Callable, Mapping
from typing import Any, TypeVar

import equinox as eqx
import jax
from jaxtyping import Array, Float

from .._core.checks import InputError, is_concrete
from .._core.show import Card, Shown
from ..library import AbstractMemory, Kind, NoMemory, Term, kind
from ..saving import Storable
from ..signals import AbstractInputPath, Grid, Signals
from ._equations import TOLD, card, equation, gradient, incomplete
from ._numbers import field_bounds, leaf_parameters, replace_leaves
from ._range import FittedRange

Model = TypeVar("Model", bound="AbstractModel")

Leg = tuple[tuple[Any, Any, Any], Grid]
"""Part of a step: the memory at its start, its middle and its end, and the input."""


class AbstractModel(Storable, Shown):
    """A device with memory.

    What it is at one time is in two parts: a state x that flows, by a differential
    equation that may feed back; and a state m of its `memory`, which the input alone
    decides. Both are PyTrees of arrays, `()` where there is nothing to keep. The output
    is made of both and of the input, at one time.

    `rate` and `output` are enough for a model of one's own, and `start` where x does
    not begin as the output. Everything else has a default: `docs/models.md` goes
    through it.

    **Attributes:**

    - `names`: what the input and the output are; keyword only.
    - `units`: units of the input and of the output; time is in s; keyword only.
    """

    names: tuple[str, str] = eqx.field(
        static=True, kw_only=True, default=("input", "output")
    )
    units: tuple[str, str] = eqx.field(static=True, kw_only=True, default=("", ""))

    def __init_subclass__(cls, **more: Any):
        super().__init_subclass__(**more)
        own = vars(cls).get("__annotations__", {})
        if "memory" in own and "memory" not in vars(cls):
            raise InputError(
                f"{cls.__name__} has a field `memory`, which in a model is a property: "
                "give the field another name, and return it from a property `memory`."
            )

    def __check_init__(self):
        for what in ("names", "units"):
            pair = getattr(self, what)
            texts = isinstance(pair, tuple) and all(isinstance(x, str) for x in pair)
            if not texts or len(pair) != 2:
                raise InputError(
                    f"`{what}` must hold two texts, of the input and of the output; "
                    f"got {pair!r}."
                )

    @property
    def memory(self) -> AbstractMemory:
        """What the input alone decides; nothing by default."""
        return NoMemory()

    @property
    def hidden(self) -> bool:
        """Whether the output does not tell the flowing state: if so, a recording is
        taken to start where `start` says, of a first output that is fitted."""
        return True

    def start(self, m: Any, now: Signals, seen: Float[Array, ""]) -> Any:
        """The flowing state at a first sample, where the output `seen` was; that output
        by default."""
        return seen

    @abstractmethod
    def rate(self, x: Any, m: Any, now: Signals) -> Any:
        """Time derivative of the flowing state, per s; a PyTree of its structure.

        **Arguments:** the flowing state, that of the memory, and the input.
        """

    @abstractmethod
    def output(self, x: Any, m: Any, now: Signals) -> Float[Array, ""]:
        """The output at one time."""

    def output_of(self, x: Any) -> Callable[[Any, Signals], Float[Array, ""]]:
        """The output as a function of the memory and the input, where nothing but `x`
        flows; a PyTree. To one of a kind that it knows, such as `library.Weighted` to
        plays, a memory may know a short way."""
        return _Output(self, x)

    @property
    def flowing(self) -> "AbstractModel":
        """The model whose `rate` moves the flowing state over `legs`: this one, or the
        one inside that it hands its input to."""
        return self

    def legs(self, m: tuple[Any, Any, Any], row: Grid) -> tuple[Leg, ...]:
        """A step over which the input goes one way, in legs over each of which the rate
        is smooth in time: one, unless memory starts or stops to move inside of a step.

        **Arguments:** the memory at the start, the middle and the end of the step; and
        the step, a row of a grid.

        **Returns:** of each leg the memory and the input of the `flowing` model, told
        likewise.
        """
        return ((m, row),)

    def caught_up(self, x: Any, m: Any, now: Signals) -> Any:
        """The flowing state at the start of a step, with what it remembers of itself
        brought up to there; of a model that remembers its input alone the state as it
        is."""
        return x

    def check_times(self, t: Float[Array, " n"], clocked: bool) -> None:
        """Raise `InputError` unless the model can follow samples at these times, s,
        which if they are not `clocked` only number the samples."""
        if not clocked and self.rate_independent is False:
            raise InputError(
                "the recording has no clock (its `t` only numbers the samples), and "
                f"this {type(self).__name__} depends on the rate of the input, or may: "
                f"{self}. Use rate-independent terms, such as `library.Duhem()`."
            )

    def free_run(
        self,
        method: Any,
        path: AbstractInputPath,
        w0: Float[Array, ""],
        scale: Float[Array, ""],
    ) -> tuple[Float[Array, " n"], Any, dict]:
        """The output along a path, by a `method` of simulation, whose `integrate` says
        what goes in and what comes out."""
        return method.integrate(self, path, w0, scale)

    def recorded(self, t: Float[Array, " n"], w: Float[Array, " n"]) -> Array:
        """What is recorded at the times `t` of the outputs there: these, but for
        instruments that come late."""
        return w

    def hidden_signals(
        self,
        u: Float[Array, " n"],
        w: Float[Array, " n"],
        rate: Callable[[Float[Array, " n"]], Float[Array, " n"]],
    ) -> tuple[Float[Array, " n"], Float[Array, " n"]] | None:
        """Input and output of the law inside of the model along a record, where the
        model's own tell them, by what it knows of the rest; `None` where they do not.
        Then `discover` needs no luck to find that law.

        **Arguments:** input and output of the model at the samples, without noise; and
        what makes the time derivative of such a signal there.
        """
        return None

    def inner(
        self, x: Any, m: Any, now: Signals
    ) -> tuple[Float[Array, ""], Float[Array, ""]] | None:
        """Input and output of the law inside of the model at one time, which nobody
        measures; `None` where there is no such law."""
        return None

    def inner_axes(
        self, names: tuple[str, str], units: tuple[str, str]
    ) -> tuple[tuple[str, str], tuple[str, str]] | None:
        """What `inner` returns, each a name and a unit, by those of the model's own
        input and output; `None` where it returns nothing."""
        return None

    def kinks(self, x: Any) -> tuple[Array, ...]:
        """Numbers of the flowing state at whose zeros `rate` is not smooth, such as w
        where |w| is in it: steps of controlled accuracy end there."""
        return ()

    @property
    def target(self) -> str | None:
        """What a sum of terms gives where the model is one: the `rate` of the output,
        which then is all of the flowing state, or its `value`."""
        return None

    def addends(self) -> tuple[tuple[float, Term], ...] | None:
        """The model as a sum, coefficients and terms, of which equations and source
        text are made; `None` where it is no such sum. For concrete models only."""
        return None

    @property
    def kind(self) -> Kind | None:
        """Whether there is hysteresis in a sum of terms, by these; `None` where there
        is no such sum. For concrete models only."""
        addends = self.addends()
        if addends is None:
            return None
        terms = (term for value, term in addends if value != 0)
        return kind(terms, self.target == "rate")

    @property
    def rate_independent(self) -> bool | None:
        """Whether the output is the same however fast the input runs; `None` where that
        is not known. For concrete models only."""
        return None

    @property
    def fitted_range(self) -> FittedRange | None:
        """How far the inputs went that the model was fitted on, where it keeps that: a
        sum of terms does, which knows nothing of the device elsewhere."""
        return None

    def fitted_on(self: Model, known: FittedRange | None) -> Model:
        """The model with such a range, or without; as it is where it keeps none."""
        return self

    def numbers(self) -> dict[str, float]:
        """What reports list: coefficients by term of a sum, parameters by name of other
        models. For concrete models only."""
        addends = self.addends()
        if addends is None:
            return {name: float(x) for name, x in self.parameters().items()}
        return {term.name: value for value, term in addends if value != 0}

    def number_units(self) -> dict[str, str]:
        """Units of some of these, such as `µm V^-1`, by the same names."""
        return {}

    def tabulated(self) -> dict[str, tuple[Array, tuple[str, ...]]]:
        """Arrays that tell models of one kind apart, for tables of many: by name, with
        labels of their last axis, or none."""
        return {name: (value, ()) for name, value in self.parameters().items()}

    @property
    def rows_in_use(self) -> tuple[int, ...]:
        """Which of its candidate terms take part, where that is known: what is compiled
        then has no others in it."""
        return ()

    def restricted(self: Model, rows: tuple[int, ...]) -> Model:
        """The model with these of its terms only; as it is for no rows."""
        return self

    def parameters(self) -> dict[str, Float[Array, ""]]:
        """The numbers that define the model, by name: by default all real numbers in
        it, by their place, such as `spring.alpha` or `weights[0,2]`."""
        return leaf_parameters(self)

    def with_parameters(self: Model, values: Mapping[str, Float[Array, ""]]) -> Model:
        """The model with other values for some of its parameters."""
        return replace_leaves(self, values)

    def bounds(self) -> Mapping[str, tuple[float, float]]:
        """Within what `refine` keeps some of its parameters, lower and upper bound by
        name, where it is told nothing else: what its fields accept, by default."""
        return field_bounds(self)

    def settled(self: Model) -> Model:
        """The model after a fit, its names in step with its numbers."""
        return self

    def _card(self) -> Card | None:
        return card(self)

    def __str__(self) -> str:
        """The model for people, such as its equation."""
        if not is_concrete(*jax.tree.leaves(eqx.filter(self, eqx.is_array))):
            return repr(self)
        if incomplete(self):
            return gradient(self)
        if self.addends() is not None:
            return equation(self)
        named = [f"{name} = {x:.4g}" for name, x in self.parameters().items()]
        told = ", ".join(named) if len(named) <= TOLD else f"{len(named)} numbers"
        return f"{type(self).__name__}({told})"


class _Output(eqx.Module):
    """The output of a model whose flowing state is known."""

    model: AbstractModel
    x: Any

    def __call__(self, m, now):
        return self.model.output(self.x, m, now)


class AbstractLaw(AbstractModel):
    """A law w' = f(w, u, u') whose state is the output, or w = f(u), which has no state
    but that of its memory. Where it has `addends`, reports and exports know it."""

    @property
    def target(self) -> str:
        """What the law gives: the `rate` of the output, or its `value`."""
        return "rate"

    @property
    def hidden(self) -> bool:
        """No."""
        return False

    def hidden_signals(self, u, w, rate):
        return u, w

    def terms(self) -> dict[str, float]:
        """Non-zero coefficients by the name of their term."""
        return {term.name: x for x, term in self.addends() or () if x != 0}

    def output(self, x, m, now):
        return x


class AbstractSum(AbstractLaw):
    """A law whose `target`, the rate of the output or the output itself, is a sum.

    **Attributes:** `target`, `"rate"` or `"value"`.
    """

    target: eqx.AbstractVar[str]  # pyright: ignore[reportIncompatibleMethodOverride]

    @abstractmethod
    def made(self, w: Any, m: Any, now: Signals) -> Float[Array, ""]:
        """The sum, of the output, the memory and the input. That of a value sees no
        output."""

    def start(self, m, now, seen):
        return seen if self.target == "rate" else ()

    def rate(self, x, m, now):
        return self.made(x, m, now) if self.target == "rate" else ()

    def output(self, x, m, now):
        return x if self.target == "rate" else self.made(now.u, m, now)


class AbstractOperatorLaw(AbstractLaw):
    """A rate-independent law w = f(u) of what the input has been, such as an operator
    of plays or relays: its memory is all of its state, and nothing flows."""

    @property
    def target(self):
        return "value"

    @property
    def rate_independent(self):
        return True

    def start(self, m, now, seen):
        return ()

    def rate(self, x, m, now):
        return ()
