"""Values and slopes of a sampled column anywhere between its samples, and what noise
does to them."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int


class Local(NamedTuple):
    """What local cubics say at m places: `value`; `slope`, a sample; and by how much
    each of them multiplies the standard deviation of white noise."""

    value: Float[np.ndarray, " m"]
    slope: Float[np.ndarray, " m"]
    gain: Float[np.ndarray, " m"]
    slope_gain: Float[np.ndarray, " m"]


def local(
    x: Float[np.ndarray, " n"],
    places: Float[np.ndarray, " m"],
    half: int,
    first: Int[np.ndarray, " m"] | int,
    last: Int[np.ndarray, " m"] | int,
    order: int = 3,
) -> Local:
    """Cubics by least squares over `half` samples before and after each place, but
    within the rows `first` to `last`: at the end of a branch all lie on its side. With
    `half` 1 they pass through four samples. NaN where a place is; `order` 2 is for
    parabolas.

    **Source:** Savitzky and Golay (1964), doi 10.1021/ac60214a047; at ends Gorry
    (1990), doi 10.1021/ac00205a007.
    """
    count = min(2 * half + 2, len(x))
    known = np.isfinite(places)
    at = np.where(known, places, 0.0)
    start = np.floor(at).astype(int) - half
    start = np.clip(start, first, np.maximum(first, np.asarray(last) - count + 1))
    start = np.clip(start, 0, len(x) - count)
    # All windows are alike but for where in them the place lies, so that one inverse
    # serves all. Around their middle and of size one, for the sake of the powers.
    inner = (np.arange(count) - (count - 1) / 2) / count
    exponents = np.arange(min(order + 1, count))
    inverse = np.linalg.pinv(inner[:, None] ** exponents)
    coefficients = x[start[:, None] + np.arange(count)] @ inverse.T
    away = ((at - start - (count - 1) / 2) / count)[:, None]
    value = away**exponents
    slope = exponents * away ** np.maximum(exponents - 1, 0) / count
    found = [np.sum(coefficients * each, axis=1) for each in (value, slope)]
    gains = [np.linalg.norm(each @ inverse, axis=1) for each in (value, slope)]
    return Local(*(np.where(known, each, np.nan) for each in (*found, *gains)))


def crossings(
    x: Float[np.ndarray, " n"],
    smooth: Float[np.ndarray, " n"],
    levels: Float[np.ndarray, " m"],
    first: Int[np.ndarray, " m"],
    last: Int[np.ndarray, " m"],
    half: int,
) -> tuple[Float[np.ndarray, " m"], Local]:
    """Where a column passes levels, each between two rows, and the local cubics there;
    NaN where it does not. Of several passages, which noise makes, the middle one
    counts."""
    places = np.full(len(levels), np.nan)
    for i, (level, a, b) in enumerate(zip(levels, first, last, strict=True)):
        if not np.isfinite(level):
            continue
        piece = smooth[a : b + 1] - level
        above = piece > 0
        passed = np.flatnonzero(above[1:] != above[:-1])
        if passed.size:
            row = passed[(len(passed) - 1) // 2]
            share = piece[row] / (piece[row] - piece[row + 1])
            places[i] = a + row + share
    begun = places
    for _ in range(4):  # Newton's steps, in the window of each place
        found = local(x, places, half, first, last)
        with np.errstate(divide="ignore", invalid="ignore"):
            step = (levels - found.value) / found.slope
        # No farther than the window that the cubic was fitted over.
        places = np.clip(
            places + np.where(np.isfinite(step), step, 0.0), begun - half, begun + half
        )
        places = np.clip(places, first, last)
    return places, local(x, places, half, first, last)
