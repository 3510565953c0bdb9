"""One candidate term: its function and its symbol, kept together.

A term is a product of powers of the five variables of a first-order hysteresis law and
of further factors such as sines. It evaluates, names, prints and exports itself, so
that these cannot disagree.
"""

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Shaped

from .._errors import InputError

VARIABLES = ("w", "u", "du", "|du|", "|w|")
"""Names of the variables, in the order in which products are written."""

_OUTPUTS = ("w", "|w|")
_TEXT = ("w", "u", "u'", "|u'|", "|w|")
_LATEX = ("w", "u", r"\dot{u}", r"|\dot{u}|", "|w|")


@dataclass(frozen=True)
class Trigonometric:
    """The factor sin(multiple * variable) or cos(multiple * variable)."""

    kind: str
    multiple: float
    variable: str

    _PATTERN: ClassVar[re.Pattern] = re.compile(r"(sin|cos)\(([^*()]+)\*(.+)\)")

    @property
    def name(self) -> str:
        return f"{self.kind}({self.multiple!r}*{self.variable})"

    @property
    def text(self) -> str:
        return f"{self.kind}({self.multiple:g} {_shown(self.variable, _TEXT)})"

    @property
    def latex(self) -> str:
        shown = _shown(self.variable, _LATEX)
        return rf"\{self.kind}({self.multiple:g}\,{shown})"

    def __call__(self, values):
        function = jnp.sin if self.kind == "sin" else jnp.cos
        return function(self.multiple * values[VARIABLES.index(self.variable)])

    def sympy(self, symbols):
        import sympy

        argument = self.multiple * symbols[VARIABLES.index(self.variable)]
        return getattr(sympy, self.kind)(argument)

    @classmethod
    def parse(cls, text: str) -> "Trigonometric | None":
        match = cls._PATTERN.fullmatch(text)
        if match is None or match[3] not in VARIABLES or not _is_number(match[2]):
            return None
        return cls(match[1], float(match[2]), match[3])


@dataclass(frozen=True)
class CustomFunction:
    """A factor given by the user: `function(w, u, du)`, written in JAX."""

    name: str
    function: Callable

    @property
    def text(self) -> str:
        return self.name

    @property
    def latex(self) -> str:
        escaped = self.name.replace("_", r"\_")
        return rf"\mathrm{{{escaped}}}"

    def __call__(self, values):
        w, u, du = values[:3]
        return self.function(w, u, du)

    def sympy(self, symbols):
        import sympy

        return sympy.Function(self.name)(*symbols[:3])


Factor = Trigonometric | CustomFunction


@dataclass(frozen=True)
class Term:
    """A product of powers of `w, u, du, |du|, |w|` and of further factors.

    **Attributes:**

    - `powers`: the five exponents, in the order of `VARIABLES`. Those of `w, u, du`
        are whole numbers; those of the magnitudes may be any number, and a negative
        power of 0 counts as 0: w |w|^-0.5 is continuous.
    - `factors`: further factors.
    """

    powers: tuple[float, ...] = (0, 0, 0, 0, 0)
    factors: tuple[Factor, ...] = ()

    def __post_init__(self):
        if len(self.powers) != len(VARIABLES) or not all(
            name.startswith("|") or (power >= 0 and float(power).is_integer())
            for name, power in zip(VARIABLES, self.powers, strict=True)
        ):
            raise InputError(
                f"`powers` must be an exponent for each of {', '.join(VARIABLES)}, a "
                f"whole number from 0 for the first three; got {self.powers}."
            )
        # Factors commute: in one order, equal terms are equal and have one name.
        ordered = tuple(sorted(self.factors, key=lambda factor: factor.name))
        object.__setattr__(self, "factors", ordered)

    def __call__(
        self,
        w: Shaped[Array, " *s"],
        u: Shaped[Array, " *s"],
        du: Shaped[Array, " *s"],
    ) -> Shaped[Array, " *s"]:
        """The term's value; arguments of one shape, in units of the recording, du in
        input units a second."""
        values = (w, u, du, jnp.abs(du), jnp.abs(w))
        product = jnp.ones_like(w)
        for value, power in zip(values, self.powers, strict=True):
            if power:
                product = product * _raised(value, power)
        for factor in self.factors:
            product = product * factor(values)
        return product

    @property
    def driven(self) -> bool:
        """Whether the input alone decides the term: no w, |w| or function of one's own
        is in it."""
        of_input = (
            isinstance(factor, Trigonometric) and factor.variable not in _OUTPUTS
            for factor in self.factors
        )
        powers = dict(zip(VARIABLES, self.powers, strict=True))
        return not any(powers[name] for name in _OUTPUTS) and all(of_input)

    def __mul__(self, other: "Term") -> "Term":
        powers = tuple(a + b for a, b in zip(self.powers, other.powers, strict=True))
        return Term(powers, self.factors + other.factors)

    @property
    def degree(self) -> float:
        """Sum of the exponents, each further factor counting as one."""
        return sum(self.powers) + len(self.factors)

    @property
    def name(self) -> str:
        """Canonical name, such as `w*|du|`, `u^2` or `1`; `Term.parse` reads it."""
        return self._joined(VARIABLES, "^{}", "*", "name")

    @property
    def text(self) -> str:
        """For equations in plain text, such as `w |u'|`."""
        return self._joined(_TEXT, "^{}", " ", "text")

    @property
    def latex(self) -> str:
        r"""For equations in LaTeX, such as `w |\dot{u}|`."""
        return self._joined(_LATEX, "^{{{}}}", r"\,", "latex")

    def sympy(self) -> Any:
        """The term as a SymPy expression in the real symbols `w, u, du`."""
        import sympy

        w, u, du = sympy.symbols("w u du", real=True)
        symbols = (w, u, du, sympy.Abs(du), sympy.Abs(w))
        product = sympy.Integer(1)
        for symbol, power in zip(symbols, self.powers, strict=True):
            product *= symbol ** sympy.nsimplify(power)
        for factor in self.factors:
            product *= factor.sympy(symbols)
        return product

    def _joined(self, symbols, exponent, product, attribute) -> str:
        parts = [
            symbol
            if power == 1
            else symbol + exponent.format(_digits(power, attribute))
            for symbol, power in zip(symbols, self.powers, strict=True)
            if power
        ]
        parts += [getattr(factor, attribute) for factor in self.factors]
        return product.join(parts) or "1"

    @classmethod
    def parse(
        cls, name: str, functions: Mapping[str, Callable] | None = None
    ) -> "Term":
        """The term of a canonical name.

        **Arguments:**

        - `name`: such as `w*|du|`, `u^2`, `1` or `sin(2.0*u)`.
        - `functions`: the user's functions that may occur, by name.

        **Raises:** `InputError` for anything else; names are never evaluated as code.
        """
        powers, factors = [0.0] * len(VARIABLES), []
        for part in re.split(r"\*(?![^()]*\))", name):
            base, exponent = part.split("^", 1) if "^" in part else (part, "1")
            if base in VARIABLES and _is_power(base, exponent):
                powers[VARIABLES.index(base)] += float(exponent)
            elif part != "1":
                factors.append(_parse_factor(part, name, functions or {}))
        whole = tuple(int(p) if p == int(p) else p for p in powers)
        return cls(whole, tuple(factors))


def _raised(value, power: float):
    """`value**power`; roots with the derivative 0 at 0, as w |w|^0.5 has it there."""
    if power >= 1:
        return value**power
    return jnp.where(value == 0, 0.0, jnp.where(value == 0, 1.0, value) ** power)


def _parse_factor(part: str, name: str, functions: Mapping[str, Callable]) -> Factor:
    factor = Trigonometric.parse(part)
    if factor is not None:
        return factor
    if part in functions:
        return CustomFunction(part, functions[part])
    raise InputError(
        f"{part!r} in the term {name!r} is neither a variable ({', '.join(VARIABLES)}) "
        "nor a known function. Pass your own functions by name: "
        f"`functions={{{part!r}: ...}}`."
    )


def _digits(power: float, attribute: str) -> str:
    """An exponent: to the last bit in names, which are read back; short elsewhere."""
    short = f"{power:g}"
    exact = attribute == "name" and float(short) != power
    return repr(float(power)) if exact else short


def _is_power(base: str, exponent: str) -> bool:
    """Whole numbers for w, u, du; any number for magnitudes."""
    return exponent.isdecimal() or (base.startswith("|") and _is_number(exponent))


def _is_number(text: str) -> bool:
    return re.fullmatch(r"[-+]?\d+(\.\d*)?(e[-+]?\d+)?", text) is not None


def _shown(variable: str, symbols: tuple[str, ...]) -> str:
    return symbols[VARIABLES.index(variable)]
