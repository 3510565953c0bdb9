"""How noisy a column is, and over how many samples it may be smoothed for that."""

import numpy as np
from jaxtyping import Float

_NORMAL = 1.4826  # from the median of absolute deviations to a standard deviation
_CUT = 2.0  # standard deviations within which differences count beside corners
_INSIDE = 0.7737  # variance of what of a normal variable of variance 1 is within
_TURNS = 20  # until that hardly changes
_BLOCKS, _BLOCK = 32, 4096  # of a long column, what is looked at
_MOST = 1024  # samples of the widest half window


def noise(x: Float[np.ndarray, " n"], t: Float[np.ndarray, " n"]) -> float:
    """The standard deviation of white noise in a column that is smooth without it, over
    times or numbers `t`, by the median of what parabolas through three samples miss of
    the fourth; corners and glitches are too few to count.

    **Source:** differences as in Rice (1984), doi 10.1214/aos/1176346788; divided, for
    uneven sampling, as in Gasser, Sroka and Jennen-Steinmetz (1986), doi
    10.1093/biomet/73.3.625.
    """
    return _typical(_missed(x, t))


def noise_beside_corners(
    x: Float[np.ndarray, " n"], t: Float[np.ndarray, " n"]
) -> float:
    """What `noise` is, but where few samples a cycle make corners many: the root mean
    square of what is missed, less what is beyond twice that, found in turns.

    **Source:** the trimmed mean of squares of Huber (1981), *Robust Statistics*, 5.
    """
    missed = _missed(x, t)
    sigma = _typical(missed)
    for _ in range(_TURNS):
        inner = missed[missed <= _CUT * sigma]
        sigma = float(np.sqrt(np.mean(inner**2) / _INSIDE)) if inner.size else 0.0
    return sigma


def _missed(
    x: Float[np.ndarray, " n"], t: Float[np.ndarray, " n"]
) -> Float[np.ndarray, " m"]:
    """What parabolas through three samples miss of the fourth, where it is any, divided
    so that it has the standard deviation of the noise; none where most is nothing."""
    if len(x) < 4:
        return np.empty(0)
    times, values = (
        np.lib.stride_tricks.sliding_window_view(_excerpts(each), 4, axis=1)
        for each in (t, x)
    )
    apart = times[..., :, None] - times[..., None, :] + np.eye(4)
    weights = 1 / np.prod(apart / apart[..., :1, 1:2], axis=-1)
    weights /= np.linalg.norm(weights, axis=-1, keepdims=True)
    # From a value near by, so that an offset is not rounded into noise.
    missed = np.abs(np.sum(weights * (values - values[..., :1]), axis=-1))
    # Equally spaced times are not quite equal, nor are then exactly straight lines.
    moved = missed[missed > 1e-12 * np.ptp(x)]
    # Where most differences are exactly zero, what is left are corners of straight
    # lines. Where few are, the column is rounded, and zeros hide its noise.
    return moved if len(moved) >= 0.3 * missed.size else np.empty(0)


def _typical(missed: Float[np.ndarray, " m"]) -> float:
    return float(_NORMAL * np.median(missed)) if missed.size else 0.0


def quantum(x: Float[np.ndarray, " n"]) -> float:
    """The step of a column that was rounded, 0 where neighbours are hardly ever
    equal."""
    steps = np.abs(np.diff(_excerpts(x), axis=1))
    moved = steps[steps > 0]
    if not moved.size or moved.size > 0.9 * steps.size:
        return 0.0
    return float(np.min(moved))


def half_window(x: Float[np.ndarray, " n"], sigma: float, times: float) -> int:
    """Half the samples that a column with noise `sigma` typically takes to move by so
    many `times` that: over them it may be smoothed, and loses little beside noise."""
    if sigma == 0:
        return 0
    block = _excerpts(x)
    lag = 1
    # The fast four fifths decide, so that rests do not.
    while lag < min(2 * _MOST, block.shape[1] // 4):
        moved = np.abs(block[:, lag:] - block[:, :-lag])
        # Noise alone moves as many by less than 1.81 of its standard deviations.
        if np.quantile(moved, 0.8) >= sigma * np.hypot(times, 1.81):
            break
        lag *= 2
    return lag // 2


def glitches(x: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """The column without samples, one or two in a row, that leap out of it: ten times
    as far from the median of the five around them as neighbours typically lie apart."""
    typical = float(np.quantile(np.abs(np.diff(_excerpts(x), axis=1)), 0.95))
    before, after = np.diff(x[:-1]), np.diff(x[1:])
    # A leap is needed to get out: where there is none, medians are not.
    leaps = np.flatnonzero(np.maximum(np.abs(before), np.abs(after)) > 5 * typical) + 1
    if typical == 0 or not leaps.size or len(x) < 5:
        return x
    near = np.unique((leaps[:, None] + np.arange(-1, 2)).clip(0, len(x) - 1))
    start = (near - 2).clip(0, len(x) - 5)
    middle = np.median(x[start[:, None] + np.arange(5)], axis=1)
    far = np.abs(x[near] - middle) > 10 * typical
    mended = x.copy()
    mended[near[far]] = middle[far]
    return mended


def _excerpts(x: Float[np.ndarray, " n"]) -> Float[np.ndarray, "b m"]:
    """Blocks of a column, evenly along it; all of a short one."""
    if len(x) <= _BLOCKS * _BLOCK:
        return x[None]
    starts = np.linspace(0, len(x) - _BLOCK, _BLOCKS).astype(int)
    return np.lib.stride_tricks.sliding_window_view(x, _BLOCK)[starts]
