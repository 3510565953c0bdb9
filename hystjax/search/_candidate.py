"""Laws that were tried, and the criterion that decides between them."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

# Kass and Raftery (1995), doi 10.1080/01621459.1995.10476572: evidence of 6 or more
# is strong.
_HARDLY = 6.0


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


def alike(found: Sequence[Candidate]) -> tuple[Candidate, ...]:
    """Candidates, the best first, that are hardly worse than the first one."""
    limit = found[0].criterion + _HARDLY if found else 0.0
    return tuple(other for other in found[1:] if other.criterion < limit)


def frontier(found: Iterable[Candidate]) -> dict[int, Candidate]:
    """The best law of each number of terms, of candidates with the best first."""
    best: dict[int, Candidate] = {}
    for candidate in found:
        best.setdefault(len(candidate.terms), candidate)
    return dict(sorted(best.items()))
