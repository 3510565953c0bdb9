"""Say in words which terms an excitation cannot tell apart."""

from collections.abc import Sequence
from dataclasses import dataclass

import equinox as eqx
import numpy as np

from ._recording import Recording
from ._regressors import as_group, check, factor
from .differentiation import AbstractDifferentiation, FiniteDifference
from .library import Library
from .regression import novelty


@dataclass(frozen=True)
class Alias:
    """A term that is nearly a combination of simpler ones on a recording.

    **Attributes:**

    - `term`: its name.
    - `share`: the share of its norm that the combination misses, 0 to 1.
    - `combination`: coefficients by the names of the simpler terms.
    """

    term: str
    share: float
    combination: dict[str, float]

    def __str__(self) -> str:
        *others, last = self.combination or ["nothing (it is zero here)"]
        known = f"a mix of {', '.join(others)} and {last}" if others else last
        new = f"{100 * self.share:.2g} % of it is new"
        return f"{self.term} cannot be told from {known} ({new})"


def aliases(
    recordings: Recording | Sequence[Recording],
    library: Library,
    *,
    differentiation: AbstractDifferentiation = FiniteDifference(),
    tolerance: float = 0.01,
) -> tuple[Alias, ...]:
    """Terms of a library that the excitation of a recording cannot tell apart.

    One sine makes 1, u^2 and du^2 collinear, for example: a law that holds one of them
    could hold another, and only another excitation (a second amplitude, a decaying
    sine, a second frequency) will say.

    **Arguments:**

    - `recordings`, `library`, `differentiation`: as for `identify`.
    - `tolerance`: a term of which a smaller share is new, given the terms before it in
        the library, counts as an alias of those.

    **Returns:** one `Alias` for each such term, in the library's order.

    **Raises:** as `identify`.
    """
    group = as_group(recordings)
    check(group, library)
    triangle, shares, kept = _look(group, library, differentiation, tolerance)
    names = library.names
    return tuple(
        _alias(np.asarray(triangle), names, int(j), max(tolerance, float(shares[j])))
        for j in np.flatnonzero(~kept)
    )


@eqx.filter_jit
def _look(recordings, library, differentiation, tolerance):
    problem = factor(recordings, library, differentiation)
    shares, kept = novelty(problem, tolerance=tolerance)
    return problem.triangle, shares, kept


def _alias(triangle, names, j: int, tolerance: float) -> Alias:
    """The fewest terms before term j that make it up: added greedily, then pruned."""
    target, before = triangle[:, j], triangle[:, :j]
    size = np.linalg.norm(target) or 1.0
    lengths = np.linalg.norm(before, axis=0)

    def explain(chosen):
        if not chosen:
            return np.zeros(0), target
        coefficients, *_ = np.linalg.lstsq(before[:, chosen], target, rcond=None)
        return coefficients, target - before[:, chosen] @ coefficients

    def share(chosen):
        return float(np.linalg.norm(explain(chosen)[1]) / size)

    chosen: list[int] = []
    while share(chosen) > tolerance and len(chosen) < j:
        likeness = np.abs(before.T @ explain(chosen)[1])
        likeness /= np.where(lengths > 0, lengths, np.inf)
        likeness[chosen] = -1
        chosen.append(int(np.argmax(likeness)))
    for i in tuple(chosen):
        fewer = [other for other in chosen if other != i]
        chosen = fewer if share(fewer) <= tolerance else chosen
    coefficients, _ = explain(chosen)
    parts = {names[i]: float(c) for i, c in zip(chosen, coefficients, strict=True)}
    return Alias(names[j], share(chosen), parts)
