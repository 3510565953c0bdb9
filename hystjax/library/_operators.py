"""Variables with memory: play and lag of the input."""

import re
from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._errors import InputError
from ..interpolation import Grid, Signals
from ..saving import check_candidates
from ._memory import AbstractMemory, scanned
from ._play import Plays, pulled
from ._variable import AbstractVariable, Nominal, brief, is_number, shown

_SERIES = 18  # terms that are there to rounding where a step is shorter than the lag
_SHORT = 1.0  # step over time constant below which the series is taken


@dataclass(frozen=True)
class AbstractOperator(AbstractVariable):
    """A signal with a memory of its own, of one number; the operators of one kind that
    a law holds are advanced together, as arrays."""

    of: str

    symbol: ClassVar[str]
    what: ClassVar[str]
    least: ClassVar[float] = 0.0

    @property
    @abstractmethod
    def nominal(self) -> Nominal:
        """The number."""

    @staticmethod
    @abstractmethod
    def start(number: Float[Array, " k"], now: Signals) -> Float[Array, " k"]:
        """The signals of operators with these numbers at a first time."""

    @staticmethod
    @abstractmethod
    def after(
        number: Float[Array, " k"],
        m: Float[Array, " k"],
        before: Signals,
        now: Signals,
    ) -> Float[Array, " k"]:
        """The signals `now`, where they were `m` `before`."""

    @classmethod
    def along(
        cls, number: Float[Array, " k"], m: Float[Array, " k"], grid: Grid
    ) -> tuple[Array, Array, Array]:
        """The signals at the start, the middle and the end of every step of a grid."""
        return scanned(lambda *step: cls.after(number, *step), m, grid)

    @abstractmethod
    def python_start(self) -> str:
        """Source text of its signal at a first input `u`."""

    @abstractmethod
    def python_after(self) -> str:
        """Source text of its signal after a straight line from `u0` to `u1` of `h`
        seconds; its own name stands for the signal before."""

    @property
    def numbers(self):
        return {self.what: self.nominal}

    @property
    def unit(self):
        return 0, 1, 0

    @property
    def name(self):
        return f"{self.symbol}({self.of},{shown(self.nominal)})"

    @property
    def text(self):
        return f"{self.symbol}({self.of}, {brief(self.nominal)})"

    @property
    def latex(self):
        return rf"\mathrm{{{self.symbol}}}({self.of}, {brief(self.nominal)})"

    @property
    def python(self):  # a variable of the generated source
        return _identifier(self.name)

    def with_numbers(self, numbers):
        return super().with_numbers({what: abs(x) for what, x in numbers.items()})

    def value(self, values):
        return values.memory[self.name]

    def sympy(self):
        import sympy

        return sympy.Function(self.symbol, real=True)(
            sympy.Symbol(self.of, real=True), sympy.nsimplify(self.nominal)
        )

    @classmethod
    def parse(cls, text: str) -> "AbstractOperator | None":
        """The variable of a canonical name, if it is one."""
        match = re.fullmatch(cls.symbol + r"\((\w+),([^(),*]+)\)", text)
        if match is None or match[1] != "u" or not is_number(match[2]):
            return None
        number = float(match[2])
        return cls(match[1], number) if number >= cls.least else None  # pyright: ignore[reportAbstractUsage, reportCallIssue]


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
        return Play.after(number, jnp.zeros_like(number), now, now)

    @staticmethod
    def after(number, m, before, now):
        return pulled(m, now.u - number, now.u + number)

    @classmethod
    def along(cls, number, m, grid):
        return Plays(number).along(m, grid)


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
    least: ClassVar[float] = 5e-324  # positive

    @property
    def nominal(self):
        return self.time

    @property
    def rate_degree(self):
        return None

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
        x = h / number
        weights = _response(x)
        change = m * jnp.exp(-x)
        for coefficient, weight in zip(_cubic(before, now, h), weights, strict=True):
            change += coefficient * weight
        return change


def _cubic(before: Signals, now: Signals, h):
    """Coefficients, lowest power first, of the input over a step as a cubic of the
    share of the step: the one of its values and derivatives at both ends."""
    rise, first, last = now.u - before.u, h * before.du, h * now.du
    return (
        before.u,
        first,
        3 * rise - 2 * first - last,
        first + last - 2 * rise,
    )


def _response(x: Float[Array, " k"]) -> list[Float[Array, " k"]]:
    """What inputs s^j, j = 0 to 3, of the share s of a step make of a lag that is x
    times shorter than the step: the integral of s^j x exp(-x (1 - s)) over s."""
    short = x < _SHORT
    near, far = jnp.where(short, x, 0.0), jnp.where(short, _SHORT, x)
    # By parts from one to the next, which loses all digits where x is small ...
    parts = [-jnp.expm1(-far)]
    for j in range(1, 4):
        parts.append(1 - j * parts[-1] / far)
    # ... and there by the series of the exponential.
    series = []
    for j in range(4):
        term = near / (j + 1)
        total = term
        for i in range(1, _SERIES):
            term = -term * near / (i + j + 1)
            total += term
        series.append(total)
    return [jnp.where(short, a, b) for a, b in zip(series, parts, strict=True)]


class Operators(AbstractMemory):
    """The memory of a law: its operators, those of one kind as one array.

    **Attributes:**

    - `kinds`: the operators of each kind.
    - `arrays`: their numbers, one array for each kind.
    """

    kinds: tuple[tuple[AbstractOperator, ...], ...] = eqx.field(static=True)
    arrays: tuple[Float[Array, " _k"], ...]

    def __init__(
        self, operators: Sequence[AbstractOperator], numbers: Mapping[str, Array]
    ):
        """**Arguments:** the operators; and numbers by `name.what`, as of `Values`."""
        classes = dict.fromkeys(type(each) for each in operators)
        self.kinds = tuple(
            tuple(each for each in operators if type(each) is kind) for kind in classes
        )
        self.arrays = tuple(
            jnp.stack([_positive(each, numbers) for each in kind])
            for kind in self.kinds
        )

    @property
    def empty(self):
        return False

    def to_fields(self):
        kinds = zip(self.kinds, self.arrays, strict=True)
        every = [pair for both in kinds for pair in zip(*both, strict=True)]
        return {"signals": {operator.name: number for operator, number in every}}

    @classmethod
    def from_fields(cls, fields, context):
        signals = fields.get("signals")
        if not isinstance(signals, dict):
            raise InputError(f'"signals" must be an object, got {signals!r}.')
        check_candidates(len(signals))
        numbers = context.numbers("signals", signals)
        known, operators = {}, []
        for name, number in zip(signals, numbers, strict=True):
            operator = Play.parse(name) or Lag.parse(name)
            if operator is None:
                raise InputError(f"{name!r} is neither a play nor a lag.")
            known[f"{operator.name}.{operator.what}"] = jnp.asarray(number)
            operators.append(operator)
        return cls(operators, known)

    def start(self, now):
        pairs = zip(self.kinds, self.arrays, strict=True)
        return tuple(type(kind[0]).start(numbers, now) for kind, numbers in pairs)

    def after(self, m, before, now):
        return tuple(
            type(kind[0]).after(numbers, each, before, now)
            for kind, numbers, each in zip(self.kinds, self.arrays, m, strict=True)
        )

    def along(self, m, grid):
        each = zip(self.kinds, self.arrays, m, strict=True)
        states = [type(kind[0]).along(numbers, m, grid) for kind, numbers, m in each]
        return tuple(zip(*states, strict=True))

    def seen(self, see, path):
        if not path.kinked or {type(kind[0]) for kind in self.kinds} != {Play}:
            return super().seen(see, path)
        (radii,) = self.arrays
        return Plays(radii).seen(_Alone(see), path)

    def values(self, m, now):
        return {
            operator.name: each[i]
            for kind, each in zip(self.kinds, m, strict=True)
            for i, operator in enumerate(kind)
        }


class _Alone(eqx.Module):
    """A view of the memory of which the operators of one kind are all."""

    see: Callable

    def __call__(self, m, now):
        return self.see((m,), now)


def _positive(operator: AbstractOperator, numbers: Mapping[str, Array]) -> Array:
    """The number of an operator without its sign, which has no meaning, and on which a
    fit then needs no bound."""
    key = f"{operator.name}.{operator.what}"
    number = jnp.asarray(numbers.get(key, operator.nominal), jnp.result_type(float))
    # Not `abs`, whose derivative at 0 is 0.
    return jnp.where(number < 0, -number, number)


def _identifier(name: str) -> str:
    """A name as one of Python's."""
    return re.sub(r"\W+", "_", name.replace("-", "m").replace(".", "p")).strip("_")
