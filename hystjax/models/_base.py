"""The contract of models: memory, flow and output; how far the inputs went that one
was fitted on, and where another leaves that; and what people see of it, equations in
text and LaTeX."""

import inspect
import types
import typing
from abc import abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import fields
from typing import Any, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from .._core.checks import VALUE_ASKED, InputError, described, is_concrete
from .._core.compiling import changed
from .._core.show import (
    Card,
    Dimension,
    Number,
    Shown,
    moment,
    quantity,
    unit_of,
    with_unit,
)
from ..library import AbstractMemory, Kind, NoMemory, Term, kind
from ..recording import Recording
from ..saving import Storable
from ..signals import AbstractInputPath, Grid, Signals
from ._numbers import (
    count_of_leaves,
    field_bounds,
    floats,
    leaf_parameters,
    number,
    optional,
    replace_leaves,
)

# By which noise on an input takes one half of a record beyond the other: up to 3.5 % of
# its width, and 1.03 times as fast, on the measured recordings of `datasets`.
_WIDER, _FASTER = 0.05, 0.25
_MUCH = 0.01  # of the output's range, by which laws differ


class FittedRange(Storable):
    """How far and how fast the inputs went that a law was fitted on.

    **Attributes:**

    - `low`, `high`: least and greatest input, input units.
    - `fastest`: largest change of the input from one sample to the next over the time
        between, input units per s; `None` where there was no clock.
    - `apart`: by how much of the output's range laws that follow as well differ under
        inputs that go farther, at another rate or in another waveform; 0 where none are
        known.
    """

    low: Float[Array, ""] = eqx.field(converter=number)
    high: Float[Array, ""] = eqx.field(converter=number)
    fastest: Float[Array, ""] | None = eqx.field(converter=optional, default=None)
    apart: Float[Array, ""] = eqx.field(converter=number, default=0.0)

    @classmethod
    def of(cls, recordings: Sequence[Recording]) -> "FittedRange":
        """That of the inputs of some recordings."""
        xp = _numbers_of([(each.t, each.u) for each in recordings])
        every = [(xp.asarray(each.t), xp.asarray(each.u)) for each in recordings]
        ends = [(xp.min(u), xp.max(u)) for _, u in every]
        low, high = (xp.stack(side) for side in zip(*ends, strict=True))
        fastest = None
        if all(each.clocked for each in recordings):
            fastest = xp.max(xp.stack([xp.max(_speeds(xp, *each)) for each in every]))
        return cls(xp.min(low), xp.max(high), fastest)

    def left_by(
        self,
        t: Float[Array | np.ndarray, " n"],
        u: Float[Array | np.ndarray, " n"],
        any_rate: bool,
    ) -> "Beyond":
        """Where an input leaves the range.

        **Arguments:** times, s; the input there; and whether it may run at any rate, as
        it may where a law does not depend on that.
        """
        xp = _numbers_of(t, u, self)
        t, u = xp.asarray(t), xp.asarray(u)
        low, high = xp.asarray(self.low), xp.asarray(self.high)
        width = xp.where(high > low, high - low, 1.0)

        def outside(u):
            return xp.maximum(xp.maximum(u - high, low - u) / width, 0.0)

        farthest = xp.maximum(outside(xp.min(u)), outside(xp.max(u)))
        faster = xp.zeros_like(t[1:])
        if self.fastest is not None and not any_rate:
            known = xp.asarray(self.fastest)
            known = xp.where(known > 0, known, 1.0)
            faster = xp.maximum(_speeds(xp, t, u) / known - 1, 0.0)
        fastest, since = xp.max(faster), xp.inf
        # Most leave it nowhere, and need not be looked at sample by sample.
        if xp is jnp or farthest > _WIDER or fastest > _FASTER:
            gone = (outside(u) > _WIDER) | (xp.append(faster, faster[-1]) > _FASTER)
            since = xp.min(xp.where(gone, t, xp.inf))
        found = (farthest, fastest, since)
        return Beyond(*(xp.asarray(x, t.dtype) for x in found))

    def __str__(self) -> str:
        if not is_concrete(*jax.tree.leaves(self)):
            return repr(self)
        return f"inputs from {self.in_words('')}"

    def in_words(self, unit: str) -> str:
        """Such as `-150 V to 150 V, up to 943 V per s`. For concrete ranges only."""
        low, high = (quantity(float(end), unit) for end in (self.low, self.high))
        if self.fastest is None:
            return f"{low} to {high}"
        return f"{low} to {high}, up to {quantity(float(self.fastest), unit)} per s"


def coefficient_dimension(term: Term, target: str | None) -> Dimension | None:
    """Powers of the units of output, input and second in the unit of the coefficient of
    a term; `None` where that of the term is not known."""
    if term.dimension is None:
        return None
    w, u, s = term.dimension
    return 1 - w, -u, -s - (target == "rate")


def check_fitted_range(given: Any) -> None:
    """Raise `InputError` for what is no `FittedRange`, and is given for one."""
    if not isinstance(given, FittedRange | None):
        raise InputError(
            f"`fitted_range` must be a `models.FittedRange` or None, got {given!r}."
        )


class Beyond(eqx.Module):
    """How far an input leaves what a law was fitted on.

    **Attributes:**

    - `input`: the farthest that it is outside of the fitted inputs, over their width; 0
        where it stays inside.
    - `rate`: by how much its fastest change is faster than any that was fitted, over
        that; 0 where it is not, where the law does not depend on the rate, or where
        there was no clock.
    - `since`: the time from which that is more than what noise on an input does, 5 % of
        the width or 25 % of the rate, s; inf where it never is.
    """

    input: Float[Array | np.ndarray, ""]
    rate: Float[Array | np.ndarray, ""]
    since: Float[Array | np.ndarray, ""]

    @property
    def noticed(self) -> bool:
        """Whether that is more than what noise on an input does. For concrete numbers
        only."""
        return bool(np.isfinite(np.asarray(self.since)))

    def in_words(self, fitted: FittedRange, unit: str, clocked: bool = True) -> str:
        """What is said of it where it is `noticed`; of inputs that are not `clocked` by
        the sample. For concrete numbers only."""
        since = moment(self.since)
        when = f"t = {since} s" if clocked else f"sample {since}"
        said = []
        if self.input > _WIDER:
            said.append(f"goes outside by {100 * float(self.input):.3g} % of the width")
        if self.rate > _FASTER:
            said.append(f"runs {1 + float(self.rate):.3g} times as fast")
        share = float(fitted.apart)
        others = (
            f" Laws that follow as well differ by some {100 * share:.2g} % of the "
            "output's range there."
            if share > _MUCH
            else ""
        )
        return (
            f"from {when} on the input leaves what this law was "
            f"fitted on ({fitted.in_words(unit)}): it {' and '.join(said)}. Nothing is "
            "known of the law there; fit it on a record that goes as far, or judge it "
            f"by one.{others}"
        )


def _numbers_of(*trees: Any) -> Any:
    """NumPy where all values are known, for which JAX would compile programs."""
    return np if is_concrete(*jax.tree.leaves(trees)) else jnp


def _speeds(xp: Any, t: Any, u: Any) -> Any:
    """The change of an input over each sample interval, input units per s."""
    return xp.abs(xp.diff(u) / xp.diff(t))


_NAMES, _UNITS = ("input", "output"), ("", "")  # where none are given

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
    - `fitted_range`: how far and how fast the inputs went that it was fitted on, a
        `FittedRange`, as fits keep it: of the device elsewhere it knows nothing. `None`
        where that is not known; keyword only.
    """

    names: tuple[str, str] = eqx.field(static=True, kw_only=True, default=_NAMES)
    units: tuple[str, str] = eqx.field(static=True, kw_only=True, default=_UNITS)
    fitted_range: FittedRange | None = eqx.field(kw_only=True, default=None)

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
        check_fitted_range(self.fitted_range)

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
                f"{self}. Give the recording its times, or use rate-independent terms, "
                "such as `library.Duhem()`."
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
        check_answers(self)
        w, result, stats = method.integrate(self, path, w0, scale)
        check_outputs(f"`integrate` of {type(method).__name__}", w, path)
        return w, result, stats

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

    def fitted_on(self: Model, known: FittedRange | None) -> Model:
        """The model with such a `fitted_range`, or without."""
        check_fitted_range(known)
        return changed(self, fitted_range=known)

    def fitted_to(self: Model, recordings: Sequence[Recording]) -> Model:
        """The model after a fit to recordings: with the range of their inputs, and with
        their names and units where it has none."""
        named = names_and_units(self, recordings[0])
        return changed(self.fitted_on(FittedRange.of(recordings)), **named)

    @classmethod
    def from_fields(cls, fields, context):
        # A constructor of one's own need not take what every model has.
        taken = inspect.signature(cls).parameters.values()
        if any(each.kind == each.VAR_KEYWORD for each in taken):
            return super().from_fields(fields, context)
        left = {"names", "units", "fitted_range"} - {each.name for each in taken}
        others = {name: x for name, x in fields.items() if name not in left}
        model = super().from_fields(others, context)
        model = changed(model, **{name: fields[name] for name in left & fields.keys()})
        AbstractModel.__check_init__(model)
        return model

    def numbers(self) -> dict[str, float]:
        """What reports list: coefficients by term of a sum, parameters by name of other
        models. For concrete models only."""
        addends = self.addends()
        if addends is None:
            return {name: float(x) for name, x in self.parameters().items()}
        return {term.name: value for value, term in addends if value != 0}

    def dimensions(self) -> Mapping[str, Dimension]:
        """In whose units parameters are: powers of the units of output, input and
        second, such as (1, -1, 0) for a slope; by name, or by that of an array for all
        numbers in it. What is not there has no unit, or one that nobody knows."""
        return {}

    def number_units(self) -> dict[str, str]:
        """Units of some of these, and of parameters, such as `µm V^-1`, by name."""
        told = self.dimensions()
        own = {x: told.get(x, told.get(x.partition("[")[0])) for x in self.parameters()}
        units = {x: unit_of(each, self.units) for x, each in own.items() if each}
        return units | self.coefficient_units()

    def coefficient_units(self) -> dict[str, str]:
        """Units of the coefficients of a sum, such as `µm V^-1`, by term; `?` where
        that of a term is not known. For concrete models only."""
        terms = [term for value, term in self.addends() or () if value != 0]
        of = {term.name: coefficient_dimension(term, self.target) for term in terms}
        return {
            name: unit_of(each, self.units) if each else "?"
            for name, each in of.items()
        }

    def listed(self, errors: Mapping[str, Any] | None = None) -> tuple[Number, ...]:
        """`numbers` with their units and standard errors, and parameters that have an
        error and are none of these; parameters alone where no term has an error, as in
        laws whose terms are not what was fitted. For concrete models only."""
        errors = errors or {}
        own = {name: float(x) for name, x in self.parameters().items()}
        numbers, units = self.numbers(), self.number_units()
        if errors and not errors.keys() & numbers.keys():
            numbers = own
        listed = numbers | {name: own[name] for name in errors if name in own}
        return tuple(
            Number(
                name,
                value,
                units.get(name, ""),
                float(errors[name]) if name in errors else None,
            )
            for name, value in listed.items()
        )

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

    def with_parameters(self: Model, values: Mapping[str, ArrayLike]) -> Model:
        """The model with other values for some of its parameters.

        **Raises:** `InputError` for a name that is of none.
        """
        return replace_leaves(self, values)

    def bounds(self) -> Mapping[str, tuple[float, float]]:
        """Within what `refine` keeps some of its parameters, lower and upper bound by
        name, where it is told nothing else: what its fields accept, by default."""
        return field_bounds(self)

    def powers(self) -> Mapping[str, tuple[str, ArrayLike]]:
        """Parameters whose unit is a power that another one decides, such as m^-n: by
        name that other, and a number in the unit itself (m^-1), of the size that it has
        in this model. `refine` moves in the parameter over that power of the number, or
        a fit of both would depend on the unit."""
        return {}

    def settled(self: Model) -> Model:
        """The model after a fit, its names in step with its numbers."""
        return self

    def _card(self) -> Card | None:
        return card(self)

    def __str__(self) -> str:
        if not is_concrete(*jax.tree.leaves(eqx.filter(self, eqx.is_array))):
            return repr(self)
        if incomplete(self):
            return gradient(self)
        try:
            return self.text()
        except (InputError, TypeError):  # a batch, which has arrays for numbers
            return eqx.tree_pformat(self)

    def text(self) -> str:
        """The model for people, such as its equation. For concrete models only."""
        if self.addends() is not None:
            return equation(self)
        return f"{type(self).__name__}({_in_short(self, ' = ')})"


def names_and_units(model: Any, recording: Recording) -> dict[str, tuple[str, str]]:
    """Those of a model, and of a recording where it has none."""
    return {
        "names": recording.names if model.names == _NAMES else model.names,
        "units": recording.units if model.units == _UNITS else model.units,
    }


_BATCH = " If it is a batch of models, map over them by `jax.vmap`."


def check_answers(model: AbstractModel) -> None:
    """Raise `InputError` for a model whose answers do not fit one another, as one's own
    may, or are not written in JAX: by their shapes alone."""
    zero = jnp.zeros(())
    now, name = Signals(zero, zero, zero), type(model).__name__

    def answer(question, answers, *given):
        try:
            with in_jax(f"`{question}` of {name}"):
                return jax.eval_shape(answers, *given)
        except InputError:
            raise
        except (TypeError, ValueError) as error:
            raise InputError(
                f"`{question}` of {name} fails for single numbers: {error}{_BATCH}"
            ) from error

    memory = model.memory
    if not isinstance(memory, AbstractMemory):
        raise InputError(
            f"`memory` of {name} must be an `AbstractMemory`, such as "
            f"`library.NoMemory()`; got {described(memory)}."
        )
    m = answer("memory.start", lambda: memory.start(now))
    later = answer("memory.after", lambda m: memory.after(m, now, now), m)
    if not _goes_on(m, later):
        raise InputError(
            f"`memory.after` of {name} must return what `memory.start` does, "
            f"{kinds(m)}; got {kinds(later)}.{_BATCH}"
        )
    # Whole and plain numbers are taken for floats, as what flows is.
    x = answer("start", lambda m: jax.tree.map(floats, model.start(m, now, zero)), m)
    rate = answer(
        "rate", lambda x, m: jax.tree.map(floats, model.rate(x, m, now)), x, m
    )
    output = answer("output", lambda x, m: model.output(x, m, now), x, m)
    if kinds(rate) != kinds(x):
        raise InputError(
            f"`rate` of {name} must return what `start` does, {kinds(x)}; got "
            f"{kinds(rate)}.{_BATCH}"
        )
    if kinds(output) != "float[]":
        raise InputError(
            f"`output` of {name} must return one number, a float; got "
            f"{kinds(output)}.{_BATCH}"
        )


def _goes_on(m: Any, later: Any) -> bool:
    """Whether a loop can go on from one state to a later one, by what they are."""
    before, structure = jax.tree.flatten(m)
    after, other = jax.tree.flatten(later)
    return structure == other and all(
        # A plain number takes the type of what comes after it.
        a.shape == b.shape and (a.weak_type or a.dtype == b.dtype)
        for a, b in zip(before, after, strict=True)
    )


@contextmanager
def in_jax(answer: str) -> Iterator[None]:
    """Raise `InputError` where an answer of one's own class is not written in JAX."""
    try:
        yield
    except VALUE_ASKED as error:
        raise InputError(
            f"{answer} asks for the value of what is traced, as `if x > 0:`, "
            "`float(x)` and functions of NumPy and `math` do: write "
            "`jax.numpy.where(x > 0, this, that)` for `if`, and `jax.numpy` for NumPy."
        ) from error


def check_outputs(answer: str, w: Any, path: AbstractInputPath) -> None:
    """Raise `InputError` unless an answer is one output at each sample of a path."""
    shape = path.t.shape
    if getattr(w, "shape", None) != shape:
        raise InputError(
            f"{answer} must return the output at each sample, an array of shape "
            f"{shape}; got {described(w)}."
        )


def kinds(tree: Any) -> Any:
    """A PyTree of arrays with what each is, such as `float[3]`."""

    def kind(leaf):
        floating = jnp.issubdtype(leaf.dtype, jnp.floating)
        shape = ",".join(map(str, leaf.shape))
        return f"{'float' if floating else leaf.dtype}[{shape}]"

    return jax.tree.map(kind, tree)


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


TOLD = 12  # parameters that are shown, before they are only counted


def equation(model: Any, digits: int = 4) -> str:
    """A sum of terms as text, such as `w' = 0.25 u' + 0.4 u |u'| - 0.5 w |u'|`."""
    model = model.settled()
    sum_of = [(c, term.text) for c, term in model.addends() or () if c != 0]
    left = "w' = " if model.target == "rate" else "w = "
    return left + signed_sum(sum_of, lambda c: f"{c:.{digits}g}", " ")


def latex_equation(model: Any, digits: int = 4) -> str:
    r"""A sum of terms in LaTeX, such as `\dot{w} = 0.25\,\dot{u}`."""
    sum_of = [(c, term.latex) for c, term in model.addends() or () if c != 0]
    left = r"\dot{w}" if model.target == "rate" else "w"
    total = signed_sum(sum_of, lambda c: _latex_number(c, digits), r"\,")
    return f"{left} = {total}"


def signed_sum(addends, number, space: str) -> str:
    """Coefficients and symbols as a sum with its signs between the addends."""
    text = ""
    for coefficient, symbol in addends:
        sign = "-" if coefficient < 0 else "+"
        size = number(abs(coefficient))
        product = size if symbol == "1" else f"{size}{space}{symbol}"
        text += f" {sign} {product}" if text else f"{sign.strip('+')}{product}"
    return text or "0"


def _latex_number(value: float, digits: int) -> str:
    mantissa, _, exponent = f"{value:.{digits}g}".partition("e")
    return rf"{mantissa} \times 10^{{{int(exponent)}}}" if exponent else mantissa


def card(model: Any) -> Card | None:
    """What is shown of a model; `None` while it is traced, or for a batch of laws."""
    leaves = jax.tree.leaves(eqx.filter(model, eqx.is_array))
    if not is_concrete(*leaves):
        return None
    if incomplete(model):
        return Card(gradient(model))
    try:
        text = model.text()
        sum_of = model.addends() is not None
        listed = model.listed() if sum_of or _count(model) <= TOLD else ()
    except (InputError, TypeError):  # a batch, which has arrays for numbers
        return None
    pairs = zip(("u", "w"), model.names, model.units, strict=True)
    return Card(
        text,
        tuple((symbol, with_unit(name, unit)) for symbol, name, unit in pairs),
        listed if len(listed) <= TOLD else (),
        latex_equation(model.settled()) if sum_of else "",
    )


def incomplete(model: Any) -> bool:
    """Whether a model lacks arrays, as one does that holds cotangents: of masks and
    other arrays that are not real, there is no derivative."""
    return any(_lacking(model))


def gradient(model: Any) -> str:
    """A model without some of its arrays in words."""
    lacking = ", ".join(_lacking(model))
    said = f"not a {type(model).__name__} but a gradient, or part of one (no {lacking})"
    if not jax.tree.leaves(eqx.filter(model, eqx.is_inexact_array)):
        return said
    return f"{said}: {_in_short(model, ' ')}"


def _in_short(model: Any, between: str) -> str:
    """Parameters with their values, or how many there are."""
    if (count := _count(model)) > TOLD:
        return f"{count} numbers"
    named = model.parameters().items()
    return ", ".join(f"{name}{between}{x:.4g}" for name, x in named)


def _count(model: Any) -> int:
    """How many parameters a model has, without taking out tens of thousands, such as
    relays have, one by one."""
    if type(model).parameters is AbstractModel.parameters:
        return count_of_leaves(model)
    return len(model.parameters())


def _lacking(tree: Any, place: str = "") -> Iterator[str]:
    """Names of fields, here and in modules inside, that should hold something."""
    for field in fields(tree):
        value = getattr(tree, field.name, None)
        here = f"{place}{field.name}"
        missing = value is None and types.NoneType not in typing.get_args(field.type)
        if isinstance(value, eqx.Module):
            yield from _lacking(value, f"{here}.")
        elif missing or getattr(value, "dtype", None) == jax.dtypes.float0:
            yield here
