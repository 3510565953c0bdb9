"""How the output goes on while the input rests."""

import numpy as np

from .._core import checks
from .._core.errors import InputError
from ..recording import Recording
from ._fits import Fit, least_squares

_LEAST = 4  # samples of a rest
_STILL = 0.01  # of the input, by which it may move


def creep(recording: Recording, *, settle: float = 0.0) -> Fit:
    """The creep of a record whose input rests, a part of a longer one by `window`: by
    least squares w = start + rate log10(t / t1), t from its first sample on and t1 the
    first time that counts.

    **Arguments:** the record; `settle`, s after its first sample that do not count,
    such as a step that rings.

    **Returns:** `start`, output units, and `rate`, output units a decade of time; their
    standard errors hold for white noise.

    **Raises:** `InputError` for a record without a clock, an input that moves by more
    than 1 % of what it is, or fewer than four samples.

    **Source:** the logarithmic law as in Vieira (1986), IBM Journal of Research and
    Development 30.
    """
    checks.concrete("`hystjax.loops.creep`", recording)
    if not recording.clocked:
        raise InputError("creep is over time, and the record has no clock.")
    t, u, w = (
        np.asarray(x, np.float64) for x in (recording.t, recording.u, recording.w)
    )
    if np.ptp(u) > _STILL * np.max(np.abs(u)):
        raise InputError(
            f"the input moves by {np.ptp(u):.4g} over these rows; creep is what the "
            "output does while it rests. Choose rows of a rest by `window`."
        )
    since = t - t[0]
    counts = (since > 0) & (since >= settle)
    if counts.sum() < _LEAST:
        raise InputError(
            f"{counts.sum()} samples are left after `settle={settle:g}` s; a straight "
            f"line and its errors need {_LEAST} or more."
        )
    since = since[counts]
    decades = np.log10(since / since[0])
    columns = np.stack([np.ones_like(decades), decades], axis=1)
    return least_squares(["start", "rate"], columns, w[counts])
