"""Say in words which terms an excitation cannot tell apart."""

from collections.abc import Sequence
from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np

from ._novelty import novelty
from ._problem import LeastSquaresProblem


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
    problem: LeastSquaresProblem, names: Sequence[str], tolerance: float = 0.01
) -> tuple[Alias, ...]:
    """Columns of a factored problem that are nearly combinations of columns before
    them.

    **Arguments:** the problem of k columns; the names of its terms; and the share of a
    column that must be new.

    **Returns:** one `Alias` for each that is not, in the order of the columns.
    """
    found = novelty(problem, tolerance=jnp.asarray(tolerance))
    shares, kept, triangle = map(np.asarray, (*found, problem.triangle))
    return tuple(
        _alias(triangle, names, int(j), max(tolerance, float(shares[j])))
        for j in np.flatnonzero(~kept)
    )


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
