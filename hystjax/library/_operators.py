"""Variables with memory: play, stop and lag, of the input or of one another; and
creep that goes on with the logarithm of time.

Where an input goes one way, a play of it rests, then goes along with it, and then rests
again; and so does a play or a stop of such a signal. That is why a signal behind others
is exact too: it travels along with the input, over a step a cubic of time.
"""

import math
import re
from abc import abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any, ClassVar, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float, Shaped

from .._core.checks import InputError
from .._core.compiling import launched
from .._core.show import Dimension
from ..signals import Grid, Signals
from ._memory import composed
from ._parallel import Plays, carried, enveloped
from ._variable import (
    AbstractVariable,
    Nominal,
    Values,
    brief,
    is_number,
    shown,
    symbolic,
)

_SERIES = 18  # terms that are there to rounding where a step is shorter than the lag
_SHORT = 1.0  # step over time constant below which the series is taken
# Steps of Newton's method from where a straight line would be: to where a cubic has a
# value, and to where a lag turns.
_TO_A_VALUE, _TO_A_TURN = 5, 2


def cubic(before: Signals, now: Signals, h):
    """Coefficients, lowest power first, of the input over a step as a cubic of the
    share of the step: the one of its values and derivatives at both ends."""
    rise, first, last = now.u - before.u, h * before.du, h * now.du
    return (
        before.u,
        first,
        3 * rise - 2 * first - last,
        first + last - 2 * rise,
    )


def within(before: Signals, now: Signals, share: ArrayLike) -> Signals:
    """The input at a share of a step, as that cubic."""
    h = now.t - before.t
    a, b, c, d = cubic(before, now, h)
    slope = b + share * (2 * c + share * 3 * d)
    return Signals(
        before.t + share * h,
        a + share * (b + share * (c + share * d)),
        jnp.where(h > 0, slope / jnp.where(h > 0, h, 1.0), before.du),
    )


class Travel(NamedTuple):
    """A signal over one stretch.

    **Attributes:** input units, of one shape.

    - `before`, `now`: its values at the ends.
    - `wait`: by how much the input changes before the signal goes along with it.
    """

    before: Float[Array, "*s"]
    now: Float[Array, "*s"]
    wait: Float[Array, "*s"]

    @property
    def change(self) -> Float[Array, "*s"]:
        """By how much it goes along."""
        return self.now - self.before


def stretches(
    before: Signals, now: Signals, travel: Travel
) -> Iterator[tuple[Signals, Signals]]:
    """The signal as an input of its own: at rest, on its way, and at rest, each with
    both of its ends."""
    start = _when(before, now, travel.wait)
    stop = _when(before, now, travel.wait + travel.change)
    zero = jnp.zeros_like(before.u)
    yield Signals(before.t, travel.before, zero), Signals(start.t, travel.before, zero)
    yield start._replace(u=travel.before), stop._replace(u=travel.now)
    yield Signals(stop.t, travel.now, zero), Signals(now.t, travel.now, zero)


def _when(before: Signals, now: Signals, change: Float[Array, "*s"]) -> Signals:
    """The input where it has changed by so much: at once where it is straight, and by
    Newton's method where it is a cubic of time."""
    h, rise = now.t - before.t, now.u - before.u
    moves = rise != 0
    _, first, bend, curl = cubic(before, now, h)
    share = jnp.where(moves, change / jnp.where(moves, rise, 1.0), 0.0)
    straight = share
    for _ in range(_TO_A_VALUE):
        gone = share * (first + share * (bend + share * curl))
        slope = first + share * (2 * bend + share * 3 * curl)
        # The slope has the sign of the rise but at a turn, where a step would be long.
        steep = jnp.where(jnp.abs(slope) > 1e-3 * jnp.abs(rise), slope, rise)
        step = jnp.where(moves, (gone - change) / jnp.where(moves, steep, 1.0), 0.0)
        share = jnp.clip(share - step, 0.0, 1.0)
    share = jnp.where(jnp.isfinite(share), share, straight)
    slope = first + share * (2 * bend + share * 3 * curl)
    unit = jnp.where(h > 0, h, 1.0)
    return Signals(before.t + share * h, before.u + change, slope / unit)


def response(x: Float[Array, " k"]) -> list[Float[Array, " k"]]:
    """What inputs s^j, j = 0 to 3, of the share s of a step make of a lag that is x
    times shorter than the step: the integral of s^j x exp(-x (1 - s)) over s."""
    short = x < _SHORT
    near, far = jnp.where(short, x, 0.0), jnp.where(short, _SHORT, x)
    # By parts from one to the next, which loses all digits where x is small ...
    parts = [-jnp.expm1(-far)]
    for j in range(1, 4):
        parts.append(1 - j * parts[-1] / far)
    # ... and there by the series of the exponential for the last, and by parts from it
    # to the ones before, which loses none.
    term = total = near / 4
    for i in range(1, _SERIES):
        term = -term * near / (i + 4)
        total += term
    series = [total]
    for j in range(3, 0, -1):
        series.insert(0, (1 - series[0]) * near / j)
    return [jnp.where(short, a, b) for a, b in zip(series, parts, strict=True)]


DEEPEST = 4  # operators inside of each other, in names that are read


@dataclass(frozen=True)
class AbstractFollower(AbstractVariable):
    """A signal that another one makes, and some numbers.

    **Attributes:** `of`, what it is of: `u`, or a play or stop.
    """

    of: "str | AbstractOperator"

    symbol: ClassVar[str]

    @property
    @abstractmethod
    def nominals(self) -> tuple[Nominal, ...]:
        """The numbers, as its name has them."""

    @property
    def dimension(self):
        return 0, 1, 0

    @property
    def name(self):
        return f"{self.symbol}({','.join(self._arguments('name', shown))})"

    @property
    def unnumbered(self):
        of, *numbers = self._arguments("unnumbered", shown)
        return f"{self.symbol}({','.join([of] if self.numbers else [of, *numbers])})"

    @property
    def text(self):
        return f"{self.symbol}({', '.join(self._arguments('text', brief))})"

    @property
    def latex(self):
        told = ", ".join(self._arguments("latex", brief))
        return rf"\mathrm{{{self.symbol}}}({told})"

    def _arguments(
        self, attribute: str, number: Callable[[Nominal], str]
    ) -> tuple[str, ...]:
        of = self.of if isinstance(self.of, str) else getattr(self.of, attribute)
        return of, *map(number, self.nominals)

    def sympy(self):
        import sympy

        of: Any = self.of
        inner = sympy.Symbol(of, real=True) if isinstance(of, str) else of.sympy()
        numbers = map(symbolic, self.nominals)
        return sympy.Function(self.symbol, real=True)(inner, *numbers)

    def renamed(self, numbers):
        own = super().renamed(numbers)
        if isinstance(self.of, str):
            return own
        return replace(own, of=self.of.renamed(numbers))


@dataclass(frozen=True)
class AbstractOperator(AbstractFollower):
    """A signal with a memory of its own, of one number; the operators of one kind that
    a law holds are advanced together, as arrays.

    **Attributes:** `of`, what it is of: `u`, or a play or stop.
    """

    what: ClassVar[str]
    measured_in: ClassVar[Dimension]
    least: ClassVar[float] = 0.0

    @property
    @abstractmethod
    def nominal(self) -> Nominal:
        """The number."""

    @staticmethod
    @abstractmethod
    def start(number: Float[Array, " k"], now: Signals) -> Float[Array, " k"]:
        """The states of operators with these numbers at a first time."""

    @staticmethod
    @abstractmethod
    def after(
        number: Float[Array, " k"],
        m: Float[Array, " k"],
        before: Signals,
        now: Signals,
    ) -> Float[Array, " k"]:
        """The states `now`, where they were `m` `before`."""

    @staticmethod
    @abstractmethod
    def behind(
        number: Float[Array, " k"],
        m: Float[Array, " k"],
        travel: Travel,
        before: Signals,
        now: Signals,
    ) -> Float[Array, " k"]:
        """The states `now` of operators of a signal that has travelled."""

    @classmethod
    @abstractmethod
    def along(
        cls, number: Float[Array, " k"], m: Float[Array, " k"], grid: Grid
    ) -> tuple[Array, Array, Array]:
        """The states at the start, the middle and the end of every step of a grid."""

    @classmethod
    @abstractmethod
    def along_behind(
        cls,
        number: Float[Array, " k"],
        m: Float[Array, " k"],
        halves: tuple[Travel, Travel],
        grid: Grid,
    ) -> tuple[Array, Array, Array]:
        """The same of operators of signals that have travelled, shape (n, k), over both
        halves of every step."""

    @staticmethod
    @abstractmethod
    def driven(
        number: Float[Array, ""], m: Float[Array, ""], of: Signals, slack: ArrayLike
    ) -> Signals:
        """The signal of a state and its one-sided rate, of those of what it is of,
        whose rounding is less than `slack`."""

    @abstractmethod
    def python_start(self) -> str:
        """Source text of its signal at a first input `u`."""

    @abstractmethod
    def python_after(self) -> str:
        """Source text of its signal after a straight line from `u0` to `u1` of `h`
        seconds; its own name stands for the signal before."""

    @staticmethod
    def signal(m: Float[Array, "*s"], of: Float[Array, "*s"]) -> Float[Array, "*s"]:
        """The signal of a state, where what it is of is `of`."""
        return m

    @property
    def chain(self) -> "tuple[AbstractOperator, ...]":
        """The operators that it is of, the innermost first, and itself."""
        return (*(() if isinstance(self.of, str) else self.of.chain), self)

    @property
    def numbers(self):
        return {self.what: self.nominal}

    @property
    def number_dimensions(self):
        return {self.what: self.measured_in}

    @property
    def nominals(self):
        return (self.nominal,)

    @property
    def python(self):  # a variable of the generated source
        return _identifier(self.name)

    def with_numbers(self, numbers):
        return super().with_numbers({what: abs(x) for what, x in numbers.items()})

    def value(self, values):
        return _remembered(values, self.name)

    @classmethod
    def parse(cls, text: str) -> "AbstractOperator | None":
        """The variable of a canonical name, if it is one."""
        match = re.fullmatch(cls.symbol + r"\((.+),([^(),*]+)\)", text)
        if match is None or not is_number(match[2]) or text.count("(") > DEEPEST:
            return None
        of, number = signal_of(match[1]), float(match[2])
        if of is None or number < cls.least:
            return None
        return cls(of, number)  # pyright: ignore[reportAbstractUsage, reportCallIssue]


def _remembered(values: Values, name: str) -> Shaped[Array, "*s"]:
    try:
        return values.memory[name]
    except KeyError:
        raise InputError(
            f"{name} has memory, and `memory` does not hold what it remembers: give "
            "all that `library.signals(path)` returns."
        ) from None


def signal_of(text: str) -> str | AbstractOperator | None:
    """What an operator can be of, by its name: the input, or what has stood still or
    gone along with it, as a play or a stop."""
    if not isinstance(text, str):
        return None
    return "u" if text == "u" else Play.parse(text) or Stop.parse(text)


@dataclass(frozen=True)
class Play(AbstractOperator):
    """The play operator: a signal that the input pulls along at a distance.

        p(t) = min(max(p(t-), u(t) - radius), u(t) + radius)

    Its memory is rate independent, and starts from 0, or as close to 0 as the first
    input lets it.

    **Attributes:** `of`, the signal it is of; `radius`, in its units.

    **Source:** Krasnosel'skii and Pokrovskii (1989), doi 10.1007/978-3-642-61302-9;
    Visintin (1994), doi 10.1007/978-3-662-11557-2.
    """

    radius: Nominal

    order: ClassVar[int] = 5
    symbol: ClassVar[str] = "play"
    what: ClassVar[str] = "radius"
    measured_in: ClassVar[Dimension] = (0, 1, 0)

    @property
    def nominal(self):
        return self.radius

    @property
    def numbers(self):
        # The play of radius 0 is the input itself, and no fit is to change that.
        return {} if self.radius == 0 else super().numbers

    def python_start(self):
        return f"np.clip(0.0, u - {self.radius!r}, u + {self.radius!r})"

    def python_after(self):
        return f"np.clip({self.python}, u1 - {self.radius!r}, u1 + {self.radius!r})"

    @staticmethod
    def start(number, now):
        origin = now._replace(u=jnp.zeros_like(now.u))
        return Play.after(number, jnp.zeros_like(number), origin, now)

    @staticmethod
    def after(number, m, before, now):
        return carried(m, before.u - number, now.u - number, now.u + number)

    @staticmethod
    def behind(number, m, travel, before, now):
        was, of = travel.before, travel.now
        return carried(m, was - number, of - number, of + number)

    @classmethod
    def along(cls, number, m, grid):
        return Plays(number).along(m, grid)

    @classmethod
    def along_behind(cls, number, m, halves, grid):
        # The signal goes the way of the input, where it goes.
        of = jnp.concatenate([halves[0].before[:1], halves[1].now])
        nodes = enveloped(grid.nodes, (of, of), number, m)
        middle = halves[0].now
        edges = of[:-1] - number, middle - number, middle + number
        middles = jax.vmap(carried)(nodes[:-1], *edges)
        return nodes[:-1], middles, nodes[1:]

    @staticmethod
    def driven(number, m, of, slack):
        up = (of.du > 0) & (m <= of.u - number + slack)
        down = (of.du < 0) & (m >= of.u + number - slack)
        return of._replace(u=m, du=jnp.where(up | down, of.du, 0.0))

    def travel(self, inner: Travel, before, now) -> Travel:
        """How its signal goes, from one state to another."""
        change = now - before
        return Travel(before, now, inner.wait + inner.change - change)


@dataclass(frozen=True)
class Stop(Play):
    """The stop operator, the input less a play: a spring that slides when it is drawn
    further than its radius.

    **Attributes:** `of`, the signal it is of; `radius`, in its units.

    **Source:** Krasnosel'skii and Pokrovskii (1989), doi 10.1007/978-3-642-61302-9;
    Visintin (1994), doi 10.1007/978-3-662-11557-2.
    """

    symbol: ClassVar[str] = "stop"

    @property
    def numbers(self):
        return {"radius": self.radius}

    @staticmethod
    def signal(m, of):
        return of - m

    @staticmethod
    def driven(number, m, of, slack):
        play = Play.driven(number, m, of, slack)
        return of._replace(u=of.u - m, du=of.du - play.du)

    def travel(self, inner, before, now):
        return Travel(inner.before - before, inner.now - now, inner.wait)

    def python_start(self):
        return f"u - {super().python_start()}"

    def python_after(self):
        r = self.radius
        return f"u1 - np.clip(u0 - {self.python}, u1 - {r!r}, u1 + {r!r})"


@dataclass(frozen=True)
class Lag(AbstractOperator):
    """A first-order lag, time z' = u - z: a memory that creeps.

    It is exact for inputs that are cubic over a step. It starts settled, z = u.

    **Attributes:** `of`, the signal it is of; `time`, the time constant, s.
    """

    time: Nominal

    order: ClassVar[int] = 6
    symbol: ClassVar[str] = "lag"
    what: ClassVar[str] = "time"
    measured_in: ClassVar[Dimension] = (0, 0, 1)
    least: ClassVar[float] = 5e-324  # positive

    @property
    def nominal(self):
        return self.time

    @property
    def rate_degree(self):
        return None

    def with_numbers(self, numbers):
        # A lag of no time is what it is of, and so is a play of no radius, which has a
        # name that can be read.
        gone = numbers["time"] == 0
        return Play(self.of, 0.0) if gone else super().with_numbers(numbers)

    def python_start(self):
        return "u"

    def python_after(self):
        x = f"(h / {self.time!r})"
        slow = f"(u1 - u0) * np.expm1(-{x}) / {x}"
        return f"u1 + {slow} + ({self.python} - u0) * np.exp(-{x})"

    @staticmethod
    def start(number, now):
        return jnp.broadcast_to(now.u, jnp.shape(number)).astype(number.dtype)

    @staticmethod
    def after(number, m, before, now):
        h = now.t - before.t
        x = _times_over(h, number)
        weights = response(x)
        change = m * jnp.exp(-x)
        for coefficient, weight in zip(cubic(before, now, h), weights, strict=True):
            change += coefficient * weight
        return change

    @staticmethod
    def behind(number, m, travel, before, now):
        for ends in stretches(before, now, travel):
            m = Lag.after(number, m, *ends)
        return m

    @staticmethod
    def driven(number, m, of, slack):
        none = number == 0
        rate = (of.u - m) / jnp.where(none, 1.0, number)
        return of._replace(u=m, du=jnp.where(none, of.du, rate))

    @staticmethod
    def course(
        number: Float[Array, "1"], m: Float[Array, "1"], before: Signals, now: Signals
    ) -> tuple[Signals, Signals, Signals]:
        """The signal of one lag at both ends of a step, and in between where it turns:
        once at most, as the input that goes one way comes past it; if it does not, at
        one of the ends.
        """

        def at(share):
            there = within(before, now, share)
            z = Lag.after(number, m, before, there)[0]
            return there, Lag.driven(number[0], z, there, 0.0)

        h, rise = now.t - before.t, now.u - before.u
        length = jnp.where(h > 0, h, 1.0)
        reach = number[0] * rise / length
        still = reach == 0
        ahead = jnp.where(still, 0.0, (m[0] - before.u) / jnp.where(still, 1.0, reach))
        turns = ahead > 0
        share = number[0] * jnp.log1p(jnp.where(turns, ahead, 0.0)) / length
        share = jnp.clip(share, 0.0, 1.0)
        for _ in range(_TO_A_TURN):
            of, z = at(share)
            bend = length * (of.du - z.du)
            step = (of.u - z.u) / jnp.where(bend == 0, 1.0, bend)
            share = jnp.where(turns, jnp.clip(share - step, 0.0, 1.0), share)
        start = Lag.driven(number[0], m[0], before, 0.0)
        end = Lag.driven(number[0], Lag.after(number, m, before, now)[0], now, 0.0)
        return start, at(share)[1], end

    @classmethod
    def along(cls, number, m, grid):
        settled = jnp.zeros_like(number)

        def added(before, now):
            return cls.after(number, settled, before, now)

        ends = (grid.start, grid.middle), (grid.middle, grid.end)
        return _passed_on(number, m, grid, [jax.vmap(added)(*each) for each in ends])

    @classmethod
    def along_behind(cls, number, m, halves, grid):
        settled = jnp.zeros_like(number)

        def added(travel, before, now):
            return cls.behind(number, settled, travel, before, now)

        first, second = halves
        each = (first, grid.start, grid.middle), (second, grid.middle, grid.end)
        return _passed_on(number, m, grid, [jax.vmap(added)(*half) for half in each])


def _times_over(h: Any, time: Float[Array, " k"]) -> Float[Array, "*n k"]:
    """How many times a step is as long as lags take: without end for those of no time,
    but in no time not at all."""
    return jnp.where(h > 0, h / time, 0.0)


def _passed_on(number, m, grid: Grid, added):
    """Lags at the start, the middle and the end of every step, by what both halves of
    each add to lags that were 0: the rest is a decay, and all that has to wait for the
    step before."""
    kept = [
        jnp.exp(-_times_over((b.t - a.t)[:, None], number))
        for a, b in ((grid.start, grid.middle), (grid.middle, grid.end))
    ]
    if launched():
        halves = [jnp.stack(x, axis=1).reshape(-1, len(m)) for x in (kept, added)]
        share, sum_ = composed(_then, tuple(halves))
        later = share * m + sum_
        middle, end = later[::2], later[1::2]
        return jnp.concatenate([m[None], end[:-1]]), middle, end

    def step(m, row):
        (first, second), (to_middle, to_end) = row
        middle = first * m + to_middle
        end = second * middle + to_end
        return end, (m, middle, end)

    return jax.lax.scan(step, m, (kept, added))[1]


def _then(one: tuple[Array, Array], other: tuple[Array, Array]) -> tuple[Array, Array]:
    """What is kept of a lag over two halves, and what both add."""
    return one[0] * other[0], one[1] * other[0] + other[1]


def operator_named(name: str) -> AbstractOperator | None:
    """The operator of a canonical name, if it is one."""
    return Play.parse(name) or Stop.parse(name) or Lag.parse(name)


def _identifier(name: str) -> str:
    """A name as one of Python's."""
    return re.sub(r"\W+", "_", name.replace("-", "m").replace(".", "p")).strip("_")


_A_DECADE = 2  # lags: near both times the sum is off by a hundredth of a decade

MOST_DECADES = 30


@dataclass(frozen=True)
class Relaxation(Lag):
    """A lag that creep is made of, whose time no fit is to change."""

    symbol: ClassVar[str] = "relaxation"

    @property
    def numbers(self):
        return {}


@dataclass(frozen=True)
class LogCreep(AbstractFollower):
    """What creeps as much in each decade of time as in the last: lags whose times are
    evenly spread over the logarithm, from the `shortest` to the `longest`.

    After a step of what it is `of` it rises by one step for each decade between the
    two times, to as many steps as there are decades; like lags it starts settled.

    **Attributes:** `of`, the input or a play or stop; `shortest` and `longest`, s.
    """

    shortest: float
    longest: float

    order: ClassVar[int] = 6
    symbol: ClassVar[str] = "creep"

    @property
    def lags(self) -> tuple[Relaxation, ...]:
        """What it is made of: in the middle of each of as many parts of the logarithm,
        where the sum is closest to the integral."""
        first, last = math.log10(self.shortest), math.log10(self.longest)
        edges = np.linspace(first, last, math.ceil(_A_DECADE * (last - first)) + 1)
        times = 10 ** ((edges[1:] + edges[:-1]) / 2)
        return tuple(Relaxation(self.of, time) for time in times.tolist())

    @property
    def share(self) -> float:
        """Of a decade, that a lag stands for."""
        return math.log10(self.longest / self.shortest) / len(self.lags)

    @property
    def chain(self):
        return (*(each for lag in self.lags for each in lag.chain), self)

    @property
    def nominals(self):
        return self.shortest, self.longest

    @property
    def rate_degree(self):
        return None

    @property
    def python(self):
        return f"({self.share!r} * ({' + '.join(lag.python for lag in self.lags)}))"

    def value(self, values):
        return self.share * sum(_remembered(values, lag.name) for lag in self.lags)

    @classmethod
    def parse(cls, text: str) -> "LogCreep | None":
        """The variable of a canonical name, if it is one."""
        match = re.fullmatch(r"creep\((.+),([^(),*]+),([^(),*]+)\)", text)
        if match is None or not (is_number(match[2]) and is_number(match[3])):
            return None
        of, shortest, longest = signal_of(match[1]), float(match[2]), float(match[3])
        if of is None or not is_range(shortest, longest):
            return None
        return cls(of, shortest, longest)


def is_range(shortest: float, longest: float) -> bool:
    """Whether creep can go from one time to another: each decade takes its lags, and
    names of laws come from strangers."""
    return 0 < shortest < longest <= shortest * 10.0**MOST_DECADES
