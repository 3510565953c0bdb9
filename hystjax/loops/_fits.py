"""Fits that are linear in their numbers."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float


class Fit(NamedTuple):
    """Numbers of a fit by name, their standard errors, and the root mean square of what
    it leaves, in the unit of what was fitted, for `steinmetz` relative."""

    value: dict[str, float]
    error: dict[str, float]
    rmse: float


def least_squares(
    names: Sequence[str], columns: Float[np.ndarray, "n k"], y: Float[np.ndarray, " n"]
) -> Fit:
    """Linear least squares, with errors by what it leaves, NaN where nothing is."""
    # Columns of one size, so that their rank does not depend on units.
    scale = np.linalg.norm(columns, axis=0)
    inverse = np.linalg.pinv(columns / scale) / scale[:, None]
    found = inverse @ y
    left = y - columns @ found
    free = len(y) - len(names)
    deviation = np.sqrt(left @ left / free) if free else np.nan
    errors = deviation * np.linalg.norm(inverse, axis=1)
    return Fit(
        dict(zip(names, found.tolist(), strict=True)),
        dict(zip(names, errors.tolist(), strict=True)),
        float(np.sqrt(np.mean(left**2))),
    )
