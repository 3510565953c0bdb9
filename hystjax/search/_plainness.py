"""Which of two laws is plainer, before any number is looked at."""

from collections.abc import Sequence

from ..library import Kind, Term, kind

Plainness = tuple[int, bool, float]


def plainness(terms: Sequence[Term]) -> Plainness:
    """A key by which the plainest law comes first.

    Fewer terms are plainer. Of as many, what is linear, rate independent or without
    memory is plainer than what is none of these: nonlinear and dependent on the rate.
    Of as many of one sort, those of the lowest degrees are.

    **Source:** Visintin (1994), doi 10.1007/978-3-662-11557-2: hysteresis proper does
    not depend on the rate.
    """
    neither = kind(terms) is Kind.RATE_DEPENDENT
    return len(terms), neither, sum(term.degree for term in terms)
