"""Models with another one inside, whose numbers are in part those of that one: started
elsewhere, behind instruments, squared; and devices in series, one of which is driven by
the signal of a play, a stop or a lag."""

import re
from collections.abc import Collection, Container, Mapping
from typing import Any, ClassVar, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from .._core import checks
from .._core.checks import InputError
from .._core.compiling import changed, depends
from .._core.show import Dimension, unit_of
from ..library import (
    AbstractMemory,
    AbstractOperator,
    Library,
    Operators,
    Term,
    operator_named,
    within,
)
from ..recording import Recording, as_recording
from ..signals import Grid, Signals
from ._base import AbstractModel, kinds
from ._numbers import (
    check_named,
    field_parameters,
    leaf_parameters,
    number,
    optional,
    replace_fields,
    replace_leaves,
)
from ._sparse import compacted

Whole = TypeVar("Whole", bound="AbstractWhole")


class AbstractWhole(AbstractModel):
    """A model with another one inside, in the field that is named `_part`.

    Its parameters are those of the part, by their names there, and its own: its fields'
    by default. Of two of one name that of the part is told by its place, such as
    `device.offset`.
    """

    _part: eqx.AbstractClassVar[str]

    def _own(self) -> dict[str, Array]:
        """The parameters that are not the part's, by name."""
        return field_parameters(self)

    def _with_own(self: Whole, values: Mapping[str, ArrayLike]) -> Whole:
        """The model with other values for some of these."""
        return replace_fields(self, values)

    def _joined(self, inner: dict[str, Any], own: dict[str, Any]) -> dict[str, Any]:
        """What is told of the part's parameters and of its own, in their order."""
        return inner | own

    @property
    def _inside(self) -> AbstractModel:
        return getattr(self, self._part)

    def _around(self: Whole, inside: AbstractModel) -> Whole:
        return eqx.tree_at(lambda model: model._inside, self, inside)

    def _names(self, own: Container[str]) -> dict[str, str]:
        """The part's parameters, as they are called there and here."""
        return _outside(self._inside.parameters(), own, self._part)

    def parameters(self):
        inner, own = self._inside.parameters(), self._own()
        names = self._names(own)
        return self._joined({names[name]: x for name, x in inner.items()}, own)

    def with_parameters(self: Whole, values) -> Whole:
        own = self._own()
        names = self._names(own)
        check_named(self._joined(dict.fromkeys(names.values()), own), values)
        inner = {name: values[each] for name, each in names.items() if each in values}
        around = self._with_own({k: x for k, x in values.items() if k in own})
        return around._around(self._inside.with_parameters(inner))

    def bounds(self):
        own = self._own()
        names, inside = self._names(own), self._inside.bounds()
        return {
            **{names[name]: ends for name, ends in inside.items() if name in names},
            **{name: ends for name, ends in super().bounds().items() if name in own},
        }

    def powers(self):
        powers = self._inside.powers()
        names = self._names(self._own()) if powers else {}
        return {
            names[name]: (names.get(other, other), size)
            for name, (other, size) in powers.items()
            if name in names
        }

    def _dimensions_inside(self) -> dict[str, Dimension]:
        """Those of the part's parameters, by the units that it counts in, under their
        names here."""
        names = self._names(self._own())
        inside = self._inside.dimensions()
        return {names.get(name, name): each for name, each in inside.items()}

    @property
    def rows_in_use(self):
        return self._inside.rows_in_use

    def restricted(self, rows):
        return self._around(self._inside.restricted(rows)) if rows else self

    def settled(self):
        return self._around(self._inside.settled())


def _outside(inside: Collection[str], own: Container[str], part: str) -> dict[str, str]:
    """How the numbers of a part are called in a whole that has numbers of its own: as
    there, but for those that would be there twice, such as `spring.stiffness`."""
    place = f"{part}."
    twice = {name for name in inside if name.rpartition(place)[2] in own}
    return {name: place + name if name in twice else name for name in inside}


class AbstractWrapper(AbstractWhole):
    """A device of which something else is seen.

    **Attributes:** `device`, the model inside.
    """

    device: eqx.AbstractVar[AbstractModel]

    _part: ClassVar[str] = "device"

    def __check_init__(self):
        _check_device(self.device)

    @property
    def memory(self):
        return self.device.memory

    @property
    def rate_independent(self):
        return self.device.rate_independent

    def rate(self, x, m, now):
        return self.device.rate(x, m, now)

    @property
    def flowing(self):
        return self.device.flowing

    def legs(self, m, row):
        return self.device.legs(m, row)

    def caught_up(self, x, m, now):
        return self.device.caught_up(x, m, now)

    def kinks(self, x):
        return self.device.kinks(x)

    def inner(self, x, m, now):
        return self.device.inner(x, m, now)

    def inner_axes(self, names, units):
        return self.device.inner_axes(names, units)

    def recorded(self, t, w):
        return self.device.recorded(t, w)


def _check_device(given: Any) -> None:
    """Raise `InputError` for what is no model."""
    if not isinstance(given, AbstractModel):
        raise InputError(
            "`device` must be a model, such as the `value` of a fit; got "
            f"{checks.described(given)}."
        )


def _arrays(state: Any) -> Any:
    return jax.tree.map(jnp.asarray, state)


class AbstractOfInput(AbstractWrapper):
    """A device that is driven by the recorded input itself, and not by a signal of it:
    what is known of how far that went where it was fitted is known of both."""

    def __post_init__(self):
        if self.fitted_range is None and isinstance(self.device, AbstractModel):
            self.fitted_range = self.device.fitted_range

    def fitted_on(self, known):
        return changed(super().fitted_on(known), device=self.device.fitted_on(known))


class AbstractOfSignal(AbstractWrapper):
    """A device that is driven by a signal of the recorded input: it cannot know how far
    that went where it was fitted, and so what is around it does."""

    def fitted_on(self, known):
        return changed(super().fitted_on(known), device=self.device.fitted_on(None))


class Started(AbstractOfInput):
    """A device of whose past nothing is known but what its memory is at first.

    Windows of a recording remember the input before them, and other recordings are
    taken to start from a memory at rest. Where neither holds, as for a device that was
    driven before anyone recorded it, the state of its memory is one of the unknowns:
    its numbers are parameters, named `state[...]`, which `refine` fits beside the
    device's own. What came before a recording is not looked at.

    All recordings that are fitted together start from the one state. What the input
    wipes out within them is known as well as it can be seen before that; of a play
    whose signal never differs from that of a start at rest nothing is. Plays forget in
    leaps, and with them the sum of squares falls in leaps: several `starts` help.

    **Attributes:**

    - `device`: the model inside; of a law over a library, with the terms that take
        part alone.
    - `state`: of its memory, a PyTree of arrays as `memory.start` returns; moved to
        what the first input allows, so that a play is never further than its radius
        from it.
    - `names`, `units`: of input and output; keyword only.
    """

    # A run leaves terms out that do not take part, and with them what they remember.
    device: AbstractModel = eqx.field(converter=compacted)
    state: Any = eqx.field(converter=_arrays)

    def __check_init__(self):
        AbstractWrapper.__check_init__(self)  # which Equinox comes to after this one
        zero = jnp.zeros(())
        at_rest = jax.eval_shape(self.device.memory.start, Signals(zero, zero, zero))
        wanted, got = kinds(at_rest), kinds(self.state)
        if got != wanted:
            raise InputError(
                "`state` must be of the arrays that the memory of `device` has, "
                f"{wanted}; got {got}. `Started.at_rest(device, recording)` makes one "
                "to change, by `with_parameters`."
            )

    @classmethod
    def at_rest(cls, device: AbstractModel, recording: Recording) -> "Started":
        """The device as it is taken to start on a recording: from what came before it
        where that is known, else at rest."""
        _check_device(device)
        recording = as_recording(recording, "Started.at_rest(device, recording)")
        device = compacted(device)
        state = device.memory.first(recording.path)
        return cls(device, state, names=device.names, units=device.units)

    @property
    def memory(self):
        return Resumed(self.device.memory, self.state)

    @property
    def hidden(self):
        return self.device.hidden

    def start(self, m, now, seen):
        return self.device.start(m, now, seen)

    def output(self, x, m, now):
        return self.device.output(x, m, now)

    def _own(self):
        return leaf_parameters({"state": self.state})

    def _with_own(self, values):
        state = replace_leaves({"state": self.state}, values)["state"]
        return eqx.tree_at(lambda model: model.state, self, state)

    def dimensions(self):
        return self._dimensions_inside()

    def number_units(self):
        names = self._names(self._own())
        inside = changed(self.device, units=self.units).number_units()
        return {names[name]: each for name, each in inside.items() if name in names}

    def text(self):
        told = ", ".join(f"{name} = {x:.4g}" for name, x in self._own().items())
        return f"{self.device.text()} ({told})" if told else self.device.text()


class Resumed(AbstractMemory):
    """A memory that starts from a state that is given.

    **Attributes:** the memory `inside`, and its `state`.
    """

    inside: AbstractMemory
    state: Any

    @property
    def needs_past(self):
        return False

    def start(self, now: Signals):
        # A step of no length moves a state to what the input allows, and no further.
        return self.inside.after(self.state, now, now)

    def resumed(self, m, now):
        return self.start(now)

    def after(self, m, before, now):
        return self.inside.after(m, before, now)

    def along(self, m, grid):
        return self.inside.along(m, grid)

    def values(self, m, now):
        return self.inside.values(m, now)

    def kinks(self, m, now):
        return self.inside.kinks(m, now)


def comes_late(model: AbstractModel) -> bool:
    """Whether what is recorded of a model is not its output itself, but that of another
    time: no step from one sample to the next can know it then."""
    some = jnp.zeros(3)
    traced = jax.make_jaxpr(model.recorded)(some, some).jaxpr
    return traced.outvars[0] is not traced.invars[1]


def sees(model: AbstractModel, what: str) -> bool:
    """Whether the output sees a signal as it is, besides what it has led to."""
    zero = jnp.zeros(())
    now = Signals(zero, zero, zero)
    m = model.memory.start(now)
    x = model.start(m, now, zero)

    def output(value):
        return model.output(x, m, now._replace(**{what: value}))

    return depends(output, zero)


class Instrumented(AbstractOfSignal):
    """A model behind a gain and an offset at its input, and a gain, an offset and a
    delay at its output:

        y: the device's output under  input_gain u(t) + input_offset
        w(t) = output_gain y(t - delay) + output_offset

    What is left out is ideal, and no parameter; the others can be fitted by `refine`,
    beside the device's own parameters. Not all can be told apart: the scale of a law's
    coefficients is one with a gain, for example, and a fixed `input_gain` or fixed
    coefficients settle that. `refine` says what the data leave open.

    Within the `delay` after the first sample the output is taken to have stood still;
    between samples it is a local cubic spline.

    **Attributes:**

    - `device`: the model behind.
    - `input_gain`: device's input over recorded input, a scalar.
    - `input_offset`: in units of the device's input.
    - `output_gain`: recorded output over device's output.
    - `output_offset`: in units of the recorded output.
    - `delay`: s, by which the recorded output comes late; negative if it comes early.
    - `fitted_range`: of the recorded input; keyword only.
    - `names`, `units`: of the recorded input and output; keyword only.
    """

    device: AbstractModel
    input_gain: Float[Array, ""] | None = eqx.field(converter=optional, default=None)
    input_offset: Float[Array, ""] | None = eqx.field(converter=optional, default=None)
    output_gain: Float[Array, ""] | None = eqx.field(converter=optional, default=None)
    output_offset: Float[Array, ""] | None = eqx.field(converter=optional, default=None)
    delay: Float[Array, ""] | None = eqx.field(converter=optional, default=None)

    def __check_init__(self):
        if self.output_gain is not None:
            why = "nothing of the device's output would be recorded."
            checks.not_zero("output_gain", self.output_gain, why)

    @property
    def hidden(self):
        return self.device.hidden

    @property
    def rate_independent(self):
        return self.device.rate_independent if self.delay is None else False

    @property
    def memory(self):
        return Driven(self.device.memory, self.input_gain, self.input_offset)

    def start(self, m, now, seen):
        return self.device.start(m, self.memory.inside(now), self._behind(seen))

    def rate(self, x, m, now):
        return self.device.rate(x, m, self.memory.inside(now))

    def caught_up(self, x, m, now):
        return self.device.caught_up(x, m, self.memory.inside(now))

    def legs(self, m, row):
        return self.device.legs(m, Grid(row.steps, *map(self.memory.inside, row[1:])))

    def output(self, x, m, now):
        y = self.device.output(x, m, self.memory.inside(now))
        return _plus(self.output_offset, _times(self.output_gain, y))

    def inner(self, x, m, now):
        return self.device.inner(x, m, self.memory.inside(now))

    def inner_axes(self, names, units):
        return self.device.inner_axes(names, self._units_inside(units))

    def hidden_signals(self, u, w, rate):
        if self.delay is not None:
            return None
        inside = _plus(self.input_offset, _times(self.input_gain, u))
        return self.device.hidden_signals(inside, self._behind(w), rate)

    def recorded(self, t, w):
        seen = self.device.recorded(t, w)
        return seen if self.delay is None else _at(t - self.delay, t, seen)

    def _units_inside(self, units):
        """The device's own, where it has some: gains may turn V into mm."""
        return self.device.units[0] or units[0], self.device.units[1] or units[1]

    def _behind(self, w):
        """The device's output, of a recorded one."""
        gain = 1.0 if self.output_gain is None else self.output_gain
        offset = 0.0 if self.output_offset is None else self.output_offset
        return (w - offset) / gain

    def number_units(self):
        (u, w), own = self.units, self._own()
        inside = self._units_inside(self.units)
        names = self._names(own)
        units = changed(self.device, units=inside).number_units()
        units = {names[name]: each for name, each in units.items() if name in names}
        units |= {
            "input_gain": _ratio(inside[0], u),
            "input_offset": unit_of((0, 1, 0), inside),
            "output_gain": _ratio(w, inside[1]),
            "output_offset": unit_of((1, 0, 0), self.units),
            "delay": "s",
        }
        return {name: units[name] for name in (*names.values(), *own) if name in units}

    def text(self):
        own = ", ".join(f"{name} = {x:.4g}" for name, x in self._own().items())
        return f"{self.device.text()} ({own or 'ideal instruments'})"


def _ratio(one: str, other: str) -> str:
    """The unit of a gain, none between equal units."""
    return "" if one == other else unit_of((1, -1, 0), (other, one))


class Driven(AbstractMemory):
    """The memory of a device behind a gain and an offset at its input.

    **Attributes:** the `device`'s memory, and the `gain` and `offset`, if there are.
    """

    device: AbstractMemory
    gain: Float[Array, ""] | None
    offset: Float[Array, ""] | None

    def inside(self, now: Signals) -> Signals:
        """What the device sees of the input."""
        u = _plus(self.offset, _times(self.gain, now.u))
        return Signals(now.t, u, _times(self.gain, now.du))

    @property
    def needs_past(self):
        return self.device.needs_past

    def start(self, now):
        return self.device.start(self.inside(now))

    def resumed(self, m, now):
        return self.device.resumed(m, self.inside(now))

    def after(self, m, before, now):
        return self.device.after(m, self.inside(before), self.inside(now))

    def along(self, m, grid):
        # Where the input turns, so does what is inside.
        inside = map(self.inside, (grid.start, grid.middle, grid.end))
        return self.device.along(m, Grid(grid.steps, *inside))

    def values(self, m, now):
        return self.device.values(m, self.inside(now))

    def kinks(self, m, now):
        return self.device.kinks(m, self.inside(now))


def _times(gain, value):
    return value if gain is None else gain * value


def _plus(offset, value):
    return value if offset is None else value + offset


def _at(times: Float[Array, " n"], t: Float[Array, " n"], y: Float[Array, " n"]):
    """The output at other times; before the first sample and after the last one it
    stands still."""
    if t.shape[0] < 2:
        return y
    import interpax  # slow to import

    return interpax.interp1d(jnp.clip(times, t[0], t[-1]), t, y, method="cubic")


class Butterfly(AbstractOfInput):
    """The strain w = y^2 + offset of a device whose output y, a polarisation, is
    hidden.

    A loop of y becomes the wings of a butterfly. The sign of y leaves no trace in w:
    of a law and its mirror image, with -y for y, the data tell neither.

    **Attributes:**

    - `device`: the law of y, driven by the input; y is in roots of the output's unit.
    - `offset`: c, least output where y passes 0, output units.
    - `y0`: y at the first sample; 0 by default, for a device at rest.
    - `names`, `units`: of input and output w; keyword only.

    **Source:** Chandra et al. (2023), doi 10.1063/5.0146134, who take y for known.
    """

    device: AbstractModel
    offset: Float[Array, ""] = eqx.field(converter=number, default=0.0)
    y0: Float[Array, ""] = eqx.field(converter=number, default=0.0)

    def start(self, m, now, seen):
        return self.device.start(m, now, self.y0)

    def output(self, x, m, now):
        return self.device.output(x, m, now) ** 2 + self.offset

    def inner(self, x, m, now):
        return now.u, self.device.output(x, m, now)

    def inner_axes(self, names, units):
        root = f"√({units[1]})" if units[1] else ""
        return (names[0], units[0]), ("hidden output y", root)

    def dimensions(self):
        inside = self._dimensions_inside()
        rooted = {name: (w / 2, u, s) for name, (w, u, s) in inside.items()}
        return rooted | {"offset": (1, 0, 0), "y0": (0.5, 0, 0)}

    def text(self):
        inside = self.device.text()
        known = self.device.addends() is not None
        law = re.sub(r"\bw\b", "y", inside) if known else f"y of {inside}"
        sign, size = "+-"[float(self.offset) < 0], abs(float(self.offset))
        return f"w = y^2 {sign} {size:.4g}, {law}"


def _front(front: Library | str) -> Library:
    """A library of one operator, or made of its name."""
    if isinstance(front, str):
        operator = operator_named(front)
        if operator is not None:
            return Library((Term(((operator, 1),)),))
    elif isinstance(front, Library) and _operator(front) is not None:
        return front
    came = repr(front) if isinstance(front, str) else checks.described(front)
    if isinstance(front, Library):
        came = f"the terms {', '.join(front.names)}"
    raise InputError(
        "`front` must be one play, stop or lag of the input, such as 'play(u,0.1)', "
        f"'stop(play(u,0.1),0.3)' or `hj.library.Lag([0.5])`; got {came}."
    )


def _operator(front: Library) -> AbstractOperator | None:
    """The one operator of a library, if that is all there is in it."""
    if len(front) != 1 or len(front.terms[0].factors) != 1:
        return None
    ((variable, power),) = front.terms[0].factors
    return variable if isinstance(variable, AbstractOperator) and power == 1 else None


class Behind(AbstractOfSignal):
    """A device whose input is a signal of the recorded input, and not that itself: a
    friction law, a spring or a static curve behind a backlash (a play) or a lag.

    The signal is exact, and where it starts, stops or turns inside of a step, the step
    is cut there, so that a device behind loses no accuracy. Only to a lag in the device
    the signal of a lag is a cubic in each step.

    Its parameters are the device's, and the front's by what they are of: `play.radius`,
    `lag.time`, or of a chain `play.radius` and `stop(play).radius`. To tell a radius, a
    record must turn, and then go further than the width of the play, twice its radius.

    **Attributes:**

    - `device`: the model behind, driven by the signal.
    - `front`: the signal: a `library.Library` of one play, stop or lag, or its name,
        such as `play(u,0.1)` or `lag(stop(play(u,0.1),0.3),0.5)`; radii in input units,
        times in s.
    - `fitted_range`: of the recorded input; keyword only.
    - `names`, `units`: of the recorded input and the output; keyword only.

    **Source:** Krasnosel'skii and Pokrovskii (1989), doi 10.1007/978-3-642-61302-9, for
    operators in series; Tao and Kokotović (1996), Adaptive Control of Systems with
    Actuator and Sensor Nonlinearities, ISBN 978-0-471-15654-3, for a backlash before a
    device.
    """

    device: AbstractModel
    front: Library = eqx.field(converter=_front)

    def __check_init__(self):
        AbstractWrapper.__check_init__(self)  # which Equinox comes to after this one
        both = sorted(self._places.keys() & self.device.parameters().keys())
        if both:
            raise InputError(
                f"`front` and `device` both have a number {both[0]!r}. Of plays and "
                "stops behind one another make one chain, such as "
                "'play(play(u,0.1),0.2)'."
            )

    @property
    def operator(self) -> AbstractOperator:
        """The operator whose signal drives the device."""
        operator = _operator(self.front)
        assert operator is not None  # as the converter has seen to
        return operator

    @property
    def _places(self) -> dict[str, str]:
        """The names of the front's numbers, and where in the front these are."""
        return {
            f"{_kind(each)}.{what}": f"{each.name}.{what}"
            for each in self.operator.chain
            for what in each.numbers
        }

    @property
    def memory(self):
        return InSeries(
            Operators((self.operator,), self.front.numbers), self.device.memory
        )

    @property
    def hidden(self):
        return self.device.hidden

    @property
    def rate_independent(self):
        if any(each.rate_degree is None for each in self.operator.chain):
            return False
        return self.device.rate_independent

    def start(self, m, now, seen):
        return self.device.start(m[1], self.memory.driven(m, now), seen)

    def rate(self, x, m, now):
        return self.device.rate(x, m[1], self.memory.driven(m, now))

    def caught_up(self, x, m, now):
        return self.device.caught_up(x, m[1], self.memory.driven(m, now))

    def output(self, x, m, now):
        return self.device.output(x, m[1], self.memory.driven(m, now))

    def legs(self, m, row):
        (front, first), *_ = m
        memory, legs = self.memory, []
        for before, now in memory.front.course(front, row.start, row.end):
            half = within(before, now, 0.5)
            middle = memory.device.after(first, before, half)
            last = memory.device.after(middle, half, now)
            part = Grid(now.t - before.t, before, half, now)
            legs += self.device.legs((first, middle, last), part)
            first = last
        return tuple(legs)

    def inner(self, x, m, now):
        driven = self.memory.driven(m, now)
        return driven.u, self.device.output(x, m[1], driven)

    def inner_axes(self, names, units):
        return (f"{self.operator.symbol} of {names[0]}", units[0]), (names[1], units[1])

    def _own(self):
        numbers = self.front.numbers
        return {name: numbers[place] for name, place in self._places.items()}

    def _with_own(self, values):
        places = self._places
        front = self.front.with_numbers({places[k]: x for k, x in values.items()})
        return eqx.tree_at(lambda model: model.front, self, front)

    def settled(self):
        parts = self.device.settled(), self.front.settled()
        return eqx.tree_at(lambda model: (model.device, model.front), self, parts)

    def bounds(self):
        return {**super().bounds(), **dict.fromkeys(self._places, (0.0, np.inf))}

    def dimensions(self):
        front = self.front.number_dimensions
        own = {name: front[place] for name, place in self._places.items()}
        return self._dimensions_inside() | own

    def text(self):
        return f"{self.device.text()} behind {self.settled().operator.text}"


def _kind(operator: AbstractOperator) -> str:
    """What an operator is, without its numbers, such as `stop(play)`."""
    of = operator.of
    return operator.symbol + ("" if isinstance(of, str) else f"({_kind(of)})")


class InSeries(AbstractMemory):
    """The memory of a device behind an operator: the state of both.

    **Attributes:** the operators of the `front`, of which the last one drives; and the
    `device`'s memory.
    """

    front: Operators
    device: AbstractMemory

    @property
    def empty(self):
        return False

    def driven(self, m: Any, now: Signals) -> Signals:
        """What the device sees of the input."""
        return self.front.signals(m[0], now)[self.front.last.name]

    def start(self, now):
        front = self.front.start(now)
        return front, self.device.start(self.driven((front, ()), now))

    def resumed(self, m, now):
        front, inside = m
        return front, self.device.resumed(inside, self.driven(m, now))

    def after(self, m, before, now):
        front, inside = m
        if not self.device.empty:
            for ends in self.front.course(front, before, now):
                inside = self.device.after(inside, *ends)
        return self.front.after(front, before, now), inside

    def along(self, m, grid):
        if not self.device.empty:
            return super().along(m, grid)
        return tuple((front, ()) for front in self.front.along(m[0], grid))

    def values(self, m, now):
        return self.device.values(m[1], self.driven(m, now))

    def kinks(self, m, now):
        # Where what is behind starts to move is not looked at.
        return self.front.kinks(m[0], now)
