"""What kind of law a sum of terms makes, before any number is looked at."""

from collections.abc import Iterable
from enum import Enum

from ._term import Term, Trigonometric

_LINEAR = ("1", "w", "u", "du")


class Kind(Enum):
    """What the terms of a law w' = f(w, u, u') make of it.

    **Members:** the value of each says it in words.

    - `MEMORYLESS`: every term is u' times a function of u, so that the output is one.
    - `LINEAR`: no terms but 1, w, u, u'.
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


def kind(terms: Iterable[Term]) -> Kind:
    """The kind of the law that is a sum of these terms, whatever their coefficients."""
    terms = tuple(terms)
    if all(_of_degree_one(term) for term in terms):
        without_memory = all(term.driven and term.powers[2] == 1 for term in terms)
        return Kind.MEMORYLESS if without_memory else Kind.RATE_INDEPENDENT
    if all(term.name in _LINEAR for term in terms):
        return Kind.LINEAR
    return Kind.RATE_DEPENDENT


def _of_degree_one(term: Term) -> bool:
    """Whether the term grows in proportion to the rate, as far as can be seen: what a
    function of one's own makes of u' cannot."""
    still = (
        isinstance(factor, Trigonometric) and factor.variable in ("w", "u", "|w|")
        for factor in term.factors
    )
    return term.powers[2] + term.powers[3] == 1 and all(still)
