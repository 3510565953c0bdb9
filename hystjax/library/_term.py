"""One candidate term, a monomial over variables; and what kind of law terms make."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from enum import Enum
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Shaped

from .._core.checks import InputError, described, nearest
from .._core.show import Dimension
from ._operators import AbstractOperator, Lag, LogCreep, operator_named
from ._variable import (
    PLAIN,
    VARIABLES,
    AbstractVariable,
    CustomFunction,
    Trigonometric,
    Values,
    is_number,
    symbolic,
)

Factor = tuple[AbstractVariable, float]


class Term:
    """A product of powers of variables.

    Terms are equal when their factors are, in any order.

    **Attributes:**

    - `factors`: variables and their exponents, in the order in which products are
        written; those of one kind, such as two plays of the input, as they were given.
        Exponents of the magnitudes |w| and |u'| may be any number, and a negative power
        of 0 counts as 0: w |w|^-0.5 is continuous. All others are whole.
    - `name`: canonical name, such as `w*|du|`, `u^2` or `1`; `Term.parse` reads it.
    """

    __slots__ = ("_key", "factors", "name")

    def __init__(self, factors: Iterable[Factor] = ()):
        """**Arguments:** pairs of a variable and its exponent, in any order.

        **Raises:** `InputError` for an exponent that the variable does not take.
        """
        powers: dict[AbstractVariable, float] = {}
        for variable, power in factors:
            powers[variable] = powers.get(variable, 0) + power
        for variable, power in powers.items():
            if not math.isfinite(power):
                raise InputError(
                    f"the exponent of {variable.name} must be finite, got {power}."
                )
            if variable.whole and not (power >= 0 and float(power).is_integer()):
                raise InputError(
                    f"the exponent of {variable.name} must be a whole number from 0, "
                    f"got {power}."
                )
        # Factors commute, and are written in one order; not by numbers in them, which
        # fits change: states and numbers of a law would change places.
        ordered = sorted(
            ((v, int(p) if p == int(p) else p) for v, p in powers.items() if p),
            key=lambda factor: (factor[0].order, factor[0].unnumbered),
        )
        self.factors = tuple(ordered)
        self.name = self._joined("name", "*", "^{}")
        self._key = frozenset(ordered)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Term) and self._key == other._key

    def __hash__(self) -> int:
        return hash(self._key)

    def __repr__(self) -> str:
        return f"Term({self.name})"

    def __call__(
        self,
        w: Shaped[ArrayLike, " *s"] | Sequence[ArrayLike],
        u: Shaped[ArrayLike, " *s"] | Sequence[ArrayLike],
        du: Shaped[ArrayLike, " *s"] | Sequence[ArrayLike],
        memory: Mapping[str, Shaped[Array, " *s"]] | None = None,
    ) -> Shaped[Array, " *s"]:
        """The term's value; arguments of one shape, in units of the recording, du in
        input units a second; and signals of memory by name, where it holds some.

        **Raises:** `InputError` where one of these is not given.
        """
        w, u, du = map(jnp.asarray, (w, u, du))
        return self.value(Values(w, u, du, memory or {}))

    def value(self, values: Values) -> Shaped[Array, " *s"]:
        """The term's value."""
        product = jnp.ones_like(values.w)
        for variable, power in self.factors:
            product = product * _raised(variable.value(values), power)
        return product

    def power(self, name: str) -> float:
        """The exponent of a variable, by name."""
        return next((power for v, power in self.factors if v.name == name), 0)

    @property
    def driven(self) -> bool:
        """Whether the input alone decides the term: no w, |w| or function of one's own
        is in it."""
        return not any(variable.of_output for variable, _ in self.factors)

    def __mul__(self, other: "Term") -> "Term":
        return Term(self.factors + other.factors)

    @property
    def degree(self) -> float:
        """Sum of the exponents."""
        return sum(power for _, power in self.factors)

    @property
    def rate_degree(self) -> float | None:
        """By which power of the input's speed the term grows; `None` where that is not
        known, or there is no such power."""
        degrees = [(v.rate_degree, power) for v, power in self.factors]
        if any(degree is None for degree, _ in degrees):
            return None
        return sum(degree * power for degree, power in degrees if degree)

    @property
    def dimension(self) -> Dimension | None:
        """Powers of the units of output, input and second in its unit; `None` where
        that of a function of one's own is not known."""
        total = np.zeros(3)
        for variable, power in self.factors:
            if variable.dimension is None:
                return None
            total += float(power) * np.array(variable.dimension, float)
        w, u, s = map(float, total)
        return w, u, s

    @property
    def text(self) -> str:
        """For equations in plain text, such as `w |u'|`."""
        return self._joined("text", " ", "^{}")

    @property
    def latex(self) -> str:
        r"""For equations in LaTeX, such as `w |\dot{u}|`."""
        return self._joined("latex", r"\,", "^{{{}}}")

    def sympy(self) -> Any:
        """The term as a SymPy expression in the real symbols `w, u, du`: of a factor
        with a negative power one that is 0 where its variable is, as in a law."""
        import sympy

        product = sympy.Integer(1)
        for variable, power in self.factors:
            base = variable.sympy()
            raised = base ** symbolic(power)
            if power < 0:
                raised = sympy.Piecewise((0, sympy.Eq(base, 0)), (raised, True))
            product *= raised
        return product

    def with_numbers(self, numbers: Mapping[str, float]) -> "Term":
        """The term with other numbers in its variables, by `name.what`."""
        return Term((each.renamed(numbers), power) for each, power in self.factors)

    def _joined(self, attribute: str, product: str, exponent: str) -> str:
        parts = []
        for variable, power in self.factors:
            raised = exponent.format(_digits(power, attribute)) if power != 1 else ""
            parts.append(getattr(variable, attribute) + raised)
        return product.join(parts) or "1"

    @classmethod
    def parse(
        cls, name: str, functions: Mapping[str, Callable] | None = None
    ) -> "Term":
        """The term of a canonical name.

        **Arguments:**

        - `name`: such as `w*|du|`, `u^2`, `1`, `sin(2.0*u)` or `play(u,0.1)`.
        - `functions`: the user's functions that may occur, by name.

        **Raises:** `InputError` for anything else; names are never evaluated as code.
        """
        if not isinstance(name, str):
            raise InputError(
                f"a term is known by its name, such as 'w*|du|'; got {described(name)}."
            )
        factors = []
        for part in _parts(name):
            base, hat, exponent = part.rpartition("^")
            base, exponent = (base, exponent) if hat else (part, "1")
            variable = _variable(base, functions or {})
            if variable is not None and _is_power(variable, exponent):
                factors.append((variable, float(exponent)))
            elif part != "1":
                raise InputError(_unknown(part, name))
        return cls(factors)


PARSERS: tuple[Callable[[str], AbstractVariable | None], ...] = (
    PLAIN.get,
    operator_named,
    LogCreep.parse,
    Trigonometric.parse,
)


def _variable(name: str, functions: Mapping[str, Callable]) -> AbstractVariable | None:
    known = (parse(name) for parse in PARSERS)
    variable = next((each for each in known if each is not None), None)
    if variable is None and name in functions:
        return CustomFunction(name, functions[name])
    return variable


def _parts(name: str) -> list[str]:
    """A name, cut at the stars that are outside of parentheses."""
    parts, depth, start = [], 0, 0
    for place, letter in enumerate(name):
        depth += (letter == "(") - (letter == ")")
        if letter == "*" and depth == 0:
            parts.append(name[start:place])
            start = place + 1
    return [*parts, name[start:]]


def _unknown(part: str, name: str) -> str:
    operators = "play(u,r), stop(u,r), lag(u,time), creep(u,shortest,longest)"
    known = f"{', '.join(VARIABLES)}, {operators}, sin(a*u), ..."
    plain = "".join(part.split()).replace("u'", "du")
    near = "" if _variable(plain, {}) is None else f"Write {_cut(plain)!r}. "
    near = near or nearest(part, VARIABLES)
    return (
        f"{_cut(part)!r} in the term {_cut(name)!r} is neither a variable ({known}) "
        f"nor a known function. {near}Functions of your own make terms by "
        "`hystjax.library.Custom`; a file that holds some is read by "
        f"`hystjax.load(path, functions={{{_cut(part)!r}: ...}})`."
    )


def _cut(text: str) -> str:
    """Text that is short enough for a message."""
    return text if len(text) <= 60 else f"{text[:57]}..."


def _raised(value, power: float):
    """`value**power`; roots with the derivative 0 at 0, as w |w|^0.5 has it there."""
    if power == 1:
        return value
    if power >= 1:
        return value**power
    return jnp.where(value == 0, 0.0, jnp.where(value == 0, 1.0, value) ** power)


def _digits(power: float, attribute: str) -> str:
    """An exponent: to the last bit in names, which are read back; short elsewhere."""
    short = f"{power:g}"
    exact = attribute == "name" and float(short) != power
    return repr(float(power)) if exact else short


def _is_power(variable: AbstractVariable, exponent: str) -> bool:
    """Whole numbers, but any number for magnitudes."""
    if not (exponent.isascii() and exponent.isdecimal()):
        return not variable.whole and is_number(exponent)
    return is_number(exponent)


_LINEAR = ("1", "w", "u", "du")


class Kind(Enum):
    """What the terms of a law w' = f(w, u, u') make of it.

    **Members:** the value of each says it in words.

    - `MEMORYLESS`: every term is u' times a function of u, so that the output is one.
    - `LINEAR`: no terms but 1, w, u, u', and lags and creep of u.
    - `RATE_INDEPENDENT`: every term is of degree one in u' and |u'| together.
    - `RATE_DEPENDENT`: all others.

    **Source:** Visintin (1994), doi 10.1007/978-3-662-11557-2: hysteresis proper is
    memory that does not depend on the rate.
    """

    MEMORYLESS = (
        "the law has no memory: its output is a function of the input and a first "
        "value; there is no hysteresis in it"
    )
    LINEAR = (
        "the law is linear: its lag depends on the rate of the input, and vanishes "
        "when that is slow if the law forgets; there is no hysteresis in it"
    )
    RATE_INDEPENDENT = (
        "the law is rate independent: its loop is the same however fast it is traversed"
    )
    RATE_DEPENDENT = (
        "the law is nonlinear and depends on the rate of the input: whether a loop is "
        "left when the input is slow `hystjax.properties.rate_dependence` tells"
    )

    @property
    def hysteretic(self) -> bool:
        """Whether there may be hysteresis in such a law."""
        return self not in (Kind.MEMORYLESS, Kind.LINEAR)

    def __str__(self) -> str:
        return self.value


def kind(terms: Iterable[Term], of_rate: bool = True) -> Kind:
    """The kind of the law that is a sum of these terms, whatever their coefficients.

    **Arguments:** the terms; and whether the law gives the output's rate, or else the
    output itself, which may hold memory of its own.
    """
    terms = tuple(terms)
    # What grows in proportion to the rate makes a rate of the same course, however
    # fast; what does not depend on the rate an output.
    if all(term.rate_degree == of_rate for term in terms):
        memoryless = all(_memoryless(term, of_rate) for term in terms)
        return Kind.MEMORYLESS if memoryless else Kind.RATE_INDEPENDENT
    if all(_linear(term) for term in terms):
        return Kind.LINEAR
    return Kind.RATE_DEPENDENT


def _memoryless(term: Term, of_rate: bool) -> bool:
    """Whether the input of now alone decides the output, or its slope over the input;
    of functions of one's own that is not known."""
    still = not any(isinstance(v, AbstractOperator) for v, _ in term.factors)
    return term.driven and still and term.power("du") == of_rate


def _linear(term: Term) -> bool:
    if term.name in _LINEAR:
        return True
    lone = term.factors[0][0] if term.degree == 1 and len(term.factors) == 1 else None
    return isinstance(lone, (Lag, LogCreep)) and lone.of == "u"
