"""What terms are made of: named signals, and functions of them.

A variable evaluates, names, prints and exports itself, so that these cannot disagree.
What tells one from another is static, and its name; the numbers in it (a radius, a time
constant, a frequency) are leaves of the library that holds it, where `refine` fits
them. A name shows the numbers that a variable was made with.
"""

import math
import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar, NamedTuple, TypeVar

import jax.numpy as jnp
from jaxtyping import Array, Shaped

from .._core.checks import InputError
from .._core.show import Dimension

Self = TypeVar("Self", bound="AbstractVariable")

Nominal = float | str
"""A number as a name shows it, or a stand-in where it was being traced."""


class Values(NamedTuple):
    """What terms are evaluated on.

    **Attributes:**

    - `w`, `u`, `du`: output, input and its derivative, of one shape.
    - `memory`: signals of memory, of that shape, by the name of their variable.
    - `numbers`: of variables, scalars, by the name of the variable and of the number
        in it, such as `play(u,0.1).radius`; those that are not there are as in the
        names.
    """

    w: Shaped[Array, "*s"]
    u: Shaped[Array, "*s"]
    du: Shaped[Array, "*s"]
    memory: Mapping[str, Shaped[Array, "*s"]] = {}
    numbers: Mapping[str, Shaped[Array, ""]] = {}


class AbstractVariable(ABC):
    """One signal that terms are products of powers of. A frozen dataclass, by which
    variables are compared."""

    order: ClassVar[int]
    """Place of its kind in products."""

    @property
    @abstractmethod
    def name(self) -> str:
        """Canonical name, which `parse` of its class reads back."""

    @property
    @abstractmethod
    def text(self) -> str:
        """For equations in plain text."""

    @property
    @abstractmethod
    def latex(self) -> str:
        """For equations in LaTeX."""

    @property
    @abstractmethod
    def python(self) -> str:
        """As source text, of NumPy and `w`, `u`, `du`."""

    @abstractmethod
    def sympy(self) -> Any:
        """As a SymPy expression in the real symbols `w, u, du`."""

    @abstractmethod
    def value(self, values: Values) -> Shaped[Array, "*s"]:
        """The signal."""

    @property
    def whole(self) -> bool:
        """Whether only whole powers from 0 are taken."""
        return True

    @property
    def of_output(self) -> bool:
        """Whether the output is in it, as far as can be seen."""
        return False

    @property
    def kinked(self) -> bool:
        """Whether it has a kink where the output passes 0, as far as can be seen."""
        return False

    @property
    def rate_degree(self) -> int | None:
        """By which power of the input's speed it grows; `None` where it is not a power,
        or not known."""
        return 0

    @property
    def dimension(self) -> Dimension | None:
        """Powers of the units of output, input and second in its unit; `None` where it
        is not known."""
        return 0, 0, 0

    @property
    def numbers(self) -> dict[str, Nominal]:
        """The numbers in it that can be fitted, by what they are."""
        return {}

    @property
    def number_dimensions(self) -> dict[str, Dimension]:
        """Powers of these units in those of its numbers, by what they are."""
        return {}

    @property
    def unnumbered(self) -> str:
        """Its name without the numbers that can be fitted, which no fit changes."""
        return self.name

    @property
    def chain(self) -> "tuple[AbstractVariable, ...]":
        """The variables that it is of, the innermost first, and itself."""
        return (self,)

    def with_numbers(self: Self, numbers: Mapping[str, float]) -> Self:
        """The variable with others."""
        return replace(self, **numbers)  # pyright: ignore[reportArgumentType, reportCallIssue]

    def renamed(self: Self, numbers: Mapping[str, float]) -> Self:
        """The variable with others, some or all, by `name.what`."""
        own = {what: numbers.get(f"{self.name}.{what}") for what in self.numbers}
        known = {what: x for what, x in own.items() if x is not None}
        return self.with_numbers(known) if known else self


_SHOWN = {"w": ("w", "w"), "u": ("u", "u"), "du": ("u'", r"\dot{u}")}


@dataclass(frozen=True)
class Plain(AbstractVariable):
    """The output, the input, its derivative, or the magnitude of one.

    **Attributes:** the `signal`, one of `w`, `u`, `du`; whether its `magnitude` is
    meant; and its place in products, `order`.
    """

    signal: str
    magnitude: bool
    order: int  # pyright: ignore[reportIncompatibleVariableOverride]

    @property
    def name(self):
        return self._written(self.signal)

    @property
    def text(self):
        return self._written(_SHOWN[self.signal][0])

    @property
    def latex(self):
        return self._written(_SHOWN[self.signal][1])

    @property
    def python(self):
        return f"np.abs({self.signal})" if self.magnitude else self.signal

    def _written(self, symbol: str) -> str:
        return f"|{symbol}|" if self.magnitude else symbol

    def sympy(self):
        import sympy

        symbol = sympy.Symbol(self.signal, real=True)
        return sympy.Abs(symbol) if self.magnitude else symbol

    def value(self, values):
        signal = getattr(values, self.signal)
        return jnp.abs(signal) if self.magnitude else signal

    @property
    def whole(self):
        return not self.magnitude

    @property
    def of_output(self):
        return self.signal == "w"

    @property
    def kinked(self):
        return self.of_output and self.magnitude

    @property
    def rate_degree(self):
        return int(self.signal == "du")

    @property
    def dimension(self):
        return {"w": (1, 0, 0), "u": (0, 1, 0), "du": (0, 1, -1)}[self.signal]


_SIGNALS = (("w", False), ("u", False), ("du", False), ("du", True), ("w", True))
PLAIN = {v.name: v for v in (Plain(*each, i) for i, each in enumerate(_SIGNALS))}

VARIABLES = tuple(PLAIN)
"""Names of these variables, in the order in which products are written."""


@dataclass(frozen=True)
class Trigonometric(AbstractVariable):
    """sin(multiple * variable) or cos(multiple * variable).

    **Attributes:** `kind`, sin or cos; the `multiple`, in radians over the unit of the
    `variable`, one of `VARIABLES`.
    """

    kind: str
    multiple: Nominal
    variable: str

    order: ClassVar[int] = 7
    _PATTERN: ClassVar[re.Pattern] = re.compile(r"(sin|cos)\(([^*()]+)\*([^*()]+)\)")

    @property
    def _of(self) -> Plain:
        return PLAIN[self.variable]

    @property
    def name(self):
        return f"{self.kind}({shown(self.multiple)}*{self.variable})"

    @property
    def text(self):
        return f"{self.kind}({brief(self.multiple)} {self._of.text})"

    @property
    def latex(self):
        return rf"\{self.kind}({brief(self.multiple)}\,{self._of.latex})"

    @property
    def python(self):
        return f"np.{self.kind}({self.multiple!r} * {self._of.python})"

    def sympy(self):
        import sympy

        return getattr(sympy, self.kind)(self.multiple * self._of.sympy())

    def value(self, values):
        function = jnp.sin if self.kind == "sin" else jnp.cos
        known: Any = values.numbers.get(f"{self.name}.multiple", self.multiple)
        return function(known * self._of.value(values))

    @property
    def of_output(self):
        return self._of.of_output

    @property
    def kinked(self):
        return self._of.kinked

    @property
    def rate_degree(self):
        return None if self._of.rate_degree else 0  # a sine of u' is no power of it

    @property
    def numbers(self):
        return {"multiple": self.multiple}

    @property
    def unnumbered(self):
        return f"{self.kind}({self.variable})"

    @property
    def number_dimensions(self):
        w, u, s = self._of.dimension
        return {"multiple": (-w, -u, -s)}

    @classmethod
    def parse(cls, text: str) -> "Trigonometric | None":
        """The variable of a canonical name, if it is one."""
        match = cls._PATTERN.fullmatch(text)
        if match is None or match[3] not in PLAIN or not is_number(match[2]):
            return None
        return cls(match[1], float(match[2]), match[3])


@dataclass(frozen=True)
class CustomFunction(AbstractVariable):
    """A signal given by the user: `function(w, u, du)`, written in JAX, under a
    `label`. Nothing is known of it: it may hold the output, and the rate."""

    label: str
    function: Callable

    order: ClassVar[int] = 8

    @property
    def name(self):
        return self.label

    @property
    def text(self):
        return self.label

    @property
    def latex(self):
        escaped = self.label.replace("_", r"\_")
        return rf"\mathrm{{{escaped}}}"

    @property
    def python(self):
        raise InputError(
            f"the law holds {self.label!r}, a function of your own, whose source "
            "hystjax does not have. Write that term by hand (`model.terms()` has its "
            "coefficient), or keep the model with `hystjax.save`."
        )

    def sympy(self):
        import sympy

        symbols = (PLAIN[name].sympy() for name in ("w", "u", "du"))
        return sympy.Function(self.label)(*symbols)

    def value(self, values):
        return self.function(values.w, values.u, values.du)

    @property
    def of_output(self):
        return True

    @property
    def rate_degree(self):
        return None

    @property
    def dimension(self):
        return None


def shown(number: Nominal) -> str:
    """A number as names hold it: to the last bit, to be read back."""
    return number if isinstance(number, str) else repr(float(number))


def brief(number: Nominal) -> str:
    """A number as equations show it."""
    return number if isinstance(number, str) else f"{number:.4g}"


def symbolic(number: Nominal) -> Any:
    """A number as SymPy holds it: a simple one where that is it to the last bit."""
    import sympy

    simple = sympy.nsimplify(number)
    exact = isinstance(number, str) or float(simple) == number
    return simple if exact else sympy.Float(number)


def is_number(text: str) -> bool:
    """Whether a finite number, in decimals, is all there is."""
    digits = r"([0-9]+\.?[0-9]*|\.[0-9]+)"
    decimal = re.fullmatch(rf"[-+]?{digits}(e[-+]?[0-9]+)?", text) is not None
    return decimal and math.isfinite(float(text))
