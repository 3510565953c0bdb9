"""Devices in series: one that is driven by the signal of a play, a stop or a lag."""

from typing import Any

import equinox as eqx
import numpy as np

from .._core import checks
from .._core.checks import InputError
from ..library import (
    AbstractMemory,
    AbstractOperator,
    Library,
    Operators,
    Term,
    operator_named,
    within,
)
from ..signals import Grid, Signals
from ._around import AbstractWrapper
from ._base import AbstractModel


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


class Behind(AbstractWrapper):
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

    def recorded(self, t, w):
        return self.device.recorded(t, w)

    def inner(self, x, m, now):
        driven = self.memory.driven(m, now)
        return driven.u, self.device.output(x, m[1], driven)

    def inner_axes(self, names, units):
        return (f"{self.operator.symbol} of {names[0]}", units[0]), (names[1], units[1])

    def parameters(self):
        numbers = self.front.numbers
        own = {name: numbers[place] for name, place in self._places.items()}
        return self.device.parameters() | own

    def with_parameters(self, values):
        places = self._places
        own = {places[name]: x for name, x in values.items() if name in places}
        inner = {name: x for name, x in values.items() if name not in places}
        parts = self.device.with_parameters(inner), self.front.with_numbers(own)
        return self._of(*parts)

    def settled(self):
        return self._of(self.device.settled(), self.front.settled())

    def _of(self, device: AbstractModel, front: Library) -> "Behind":
        return eqx.tree_at(lambda it: (it.device, it.front), self, (device, front))

    def bounds(self):
        return {**self.device.bounds(), **dict.fromkeys(self._places, (0.0, np.inf))}

    def number_units(self):
        time = {name for name in self._places if name.endswith(".time")}
        own = {name: "s" if name in time else self.units[0] for name in self._places}
        return self.device.number_units() | own

    def text(self):
        return f"{self.device} behind {self.settled().operator.text}"


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
