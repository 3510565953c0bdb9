"""Laws that were tried, and the criterion that decides between them."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from ..library import Library
from ._plainness import plainness

HARDLY = 6.0
"""Difference of criteria from which evidence is strong.

**Source:** Kass and Raftery (1995), doi 10.1080/01621459.1995.10476572.
"""


@dataclass(frozen=True)
class Candidate:
    """A law that was tried.

    **Attributes:**

    - `terms`: coefficients by term.
    - `rmse`: root mean square error of its refined free run, output units, over all
        recordings.
    - `criterion`: the extended Bayesian information criterion; what matters are
        differences.
    - `kept`: share of a difference between initial values that is left at the end of
        the recording that keeps most; `None` where the law's output is hidden.
    """

    terms: dict[str, float]
    rmse: float
    criterion: float
    kept: float | None = None

    def __str__(self) -> str:
        names = ", ".join(self.terms)
        return f"{names}: rms {self.rmse:.4g}, criterion {self.criterion:.1f}"


def information_criterion(
    variance: float, samples: float, unknowns: int, terms: int, candidates: int
) -> float:
    """The extended Bayesian information criterion of a fit, the less the better.

    The more laws of a size there are, the better the best of them follows noise; the
    criterion takes that into account, where the ordinary one does not.

    **Arguments:** the mean square of the residuals of so many independent `samples`;
    the number of fitted `unknowns`; and how many `terms` were chosen out of how many
    `candidates`.

    **Source:** Chen and Chen (2008), doi 10.1093/biomet/asn034, with gamma = 1.
    """
    choices = math.log(math.comb(candidates, terms))
    return samples * math.log(variance) + unknowns * math.log(samples) + 2 * choices


def ordered(found: Iterable[Candidate], library: Library) -> tuple[Candidate, ...]:
    """Candidates, the chosen one first, the others by their criterion.

    Of those that are hardly told from the one of the least criterion the plainest is
    chosen. Out of many candidates one or the other follows noise by chance, so what a
    law claims beyond a plainer one has to be worth more than its share of the
    criterion.
    """
    by_name = dict(zip(library.names, library.terms, strict=True))

    def rank(candidate):
        return plainness([by_name[name] for name in candidate.terms])

    ranked = sorted(found, key=lambda candidate: candidate.criterion)
    if not ranked:
        return ()
    chosen = min(_near(ranked), key=rank)
    return chosen, *(other for other in ranked if other is not chosen)


def alike(found: Sequence[Candidate]) -> tuple[Candidate, ...]:
    """Candidates, after the chosen one, that are hardly told from the best."""
    return tuple(other for other in _near(found) if other is not found[0])


def _near(found: Sequence[Candidate]) -> list[Candidate]:
    least = min((candidate.criterion for candidate in found), default=math.inf)
    return [candidate for candidate in found if candidate.criterion < least + HARDLY]


def frontier(found: Iterable[Candidate]) -> dict[int, Candidate]:
    """The best law of each number of terms, of candidates with the best first."""
    best: dict[int, Candidate] = {}
    for candidate in found:
        best.setdefault(len(candidate.terms), candidate)
    return dict(sorted(best.items()))
