"""How noisy a column is."""

import numpy as np
from jaxtyping import Float

_NORMAL = 1.4826  # from the median of absolute deviations to a standard deviation


def noise(x: Float[np.ndarray, " n"]) -> float:
    """The standard deviation of white noise in a column that is smooth without it, by
    the median of its third differences: corners and glitches are too few to count.

    **Source:** differences as in Rice (1984), doi 10.1214/aos/1176346788.
    """
    third = np.abs(np.diff(x, 3))
    return float(_NORMAL * np.median(third) / np.sqrt(20.0)) if len(third) else 0.0
