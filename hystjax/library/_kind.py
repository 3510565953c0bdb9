"""What kind of law a sum of terms makes, before any number is looked at."""

from collections.abc import Iterable
from enum import Enum

from ._operators import AbstractOperator, Lag
from ._term import Term

_LINEAR = ("1", "w", "u", "du")


class Kind(Enum):
    """What the terms of a law w' = f(w, u, u') make of it.

    **Members:** the value of each says it in words.

    - `MEMORYLESS`: every term is u' times a function of u, so that the output is one.
    - `LINEAR`: no terms but 1, w, u, u' and lags of u.
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
        "left when the input is slow, `hystjax.properties` can tell"
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
    lone = len(term.factors) == 1 and term.degree == 1
    lag = lone and isinstance(term.factors[0][0], Lag)
    return lag or term.name in _LINEAR
