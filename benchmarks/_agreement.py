"""Contestants must compute the same before their times are compared."""

import numpy as np


class Disagreement(Exception):
    """Contestants computed different things."""


def agreed(what: str, error: float, limit: float) -> str:
    """A sentence for the results.

    **Raises:** `Disagreement` unless `error` is at most `limit`.
    """
    if not error <= limit:
        raise Disagreement(f"{what} differ by {error:.2g}, more than {limit:.2g}")
    return f"{what} differ by {error:.1g} (at most {limit:.0g} allowed)"


def relative_difference(values, reference) -> float:
    """Largest difference of two arrays, each relative to the reference's value; where
    that is zero, as it is."""
    values, reference = np.asarray(values), np.asarray(reference)
    scale = np.where(reference == 0, 1.0, np.abs(reference))
    return float(np.max(np.abs(values - reference) / scale))
