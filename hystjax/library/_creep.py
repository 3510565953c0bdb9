"""Creep that goes on with the logarithm of time."""

import math
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from ._operators import AbstractOperator, Lag, signal_of
from ._variable import AbstractVariable, brief, is_number, shown

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
class LogCreep(AbstractVariable):
    """What creeps as much in each decade of time as in the last: lags whose times are
    evenly spread over the logarithm, from the `shortest` to the `longest`.

    After a step of what it is `of` it rises by one step for each decade between the
    two times, to as many steps as there are decades; like lags it starts settled.

    **Attributes:** `of`, the input or a play or stop; `shortest` and `longest`, s.
    """

    of: str | AbstractOperator
    shortest: float
    longest: float

    order: ClassVar[int] = 6

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
    def unit(self):
        return 0, 1, 0

    @property
    def rate_degree(self):
        return None

    @property
    def name(self):
        return f"creep({','.join(self._arguments('name', shown))})"

    @property
    def text(self):
        return f"creep({', '.join(self._arguments('text', brief))})"

    @property
    def latex(self):
        return rf"\mathrm{{creep}}({', '.join(self._arguments('latex', brief))})"

    @property
    def python(self):
        return f"{self.share!r} * ({' + '.join(lag.python for lag in self.lags)})"

    def _arguments(
        self, attribute: str, number: Callable[[float], str]
    ) -> tuple[str, str, str]:
        of = self.of if isinstance(self.of, str) else getattr(self.of, attribute)
        return of, number(self.shortest), number(self.longest)

    def sympy(self):
        import sympy

        of: Any = self.of
        inner = sympy.Symbol(of, real=True) if isinstance(of, str) else of.sympy()
        numbers = (sympy.nsimplify(each) for each in (self.shortest, self.longest))
        return sympy.Function("creep", real=True)(inner, *numbers)

    def value(self, values):
        return self.share * sum(values.memory[lag.name] for lag in self.lags)

    def renamed(self, numbers):
        if isinstance(self.of, str):
            return self
        return LogCreep(self.of.renamed(numbers), self.shortest, self.longest)

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
