"""Laws that were tried, and the criterion that decides between them."""

import math
from collections.abc import Iterable
from dataclasses import dataclass


@dataclass(frozen=True)
class Candidate:
    """A law that was tried.

    **Attributes:**

    - `terms`: coefficients by term.
    - `rmse`: root mean square error of its refined free run, output units, over all
        recordings.
    - `criterion`: the extended Bayesian information criterion; what matters are
        differences.
    - `forgets`: whether it forgets its initial value on every recording; `None` where
        the law's output is hidden.
    """

    terms: dict[str, float]
    rmse: float
    criterion: float
    forgets: bool | None = None

    def __str__(self) -> str:
        names = ", ".join(self.terms)
        return f"{names}: rms {self.rmse:.4g}, criterion {self.criterion:.1f}"


def information_criterion(
    squares: float, samples: int, unknowns: int, terms: int, candidates: int
) -> float:
    """The extended Bayesian information criterion of a fit, the less the better.

    The more laws of a size there are, the better the best of them follows noise; the
    criterion takes that into account, where the ordinary one does not.

    **Arguments:** the sum of `squares` of so many `samples`; the number of fitted
    `unknowns`; and how many `terms` were chosen out of how many `candidates`.

    **Source:** Chen and Chen (2008), doi 10.1093/biomet/asn034, with gamma = 1.
    """
    choices = math.log(math.comb(candidates, terms))
    return samples * math.log(squares / samples) + (
        unknowns * math.log(samples) + 2 * choices
    )


def frontier(found: Iterable[Candidate]) -> dict[int, Candidate]:
    """The best law of each number of terms, of candidates with the best first."""
    best: dict[int, Candidate] = {}
    for candidate in found:
        best.setdefault(len(candidate.terms), candidate)
    return dict(sorted(best.items()))
