"""Candidates that agree with what is known of a device."""

import numpy as np
from jaxtyping import Bool

from .._core.errors import InputError
from ..library import Library
from ..recording import Recording


def symmetric(
    library: Library, recording: Recording, rate_independent: bool, odd: bool
) -> Library:
    """Those whose loops are the same however fast, or symmetric about zero.

    **Raises:** `InputError` where none is left.
    """
    kept = np.ones(len(library), bool)
    if rate_independent:
        kept &= [term.rate_degree == 1 for term in library.terms]
    if odd:
        kept &= _odd(library, recording)
    if not np.any(kept):
        raise InputError(
            "no term of `library` is left with "
            f"`rate_independent={rate_independent}, odd={odd}`: give candidates that "
            "are, such as `library.Duhem()`."
        )
    return library.part(np.flatnonzero(kept).tolist())


def _odd(library: Library, recording: Recording) -> Bool[np.ndarray, " k"]:
    """Which terms change their sign with output, input and memory: seen on samples,
    since functions of one's own do not say."""
    u, du = recording.path.samples()
    memory, w = library.signals(recording.path), recording.w
    columns = library(w, u, du, memory)
    mirrored = library(-w, -u, -du, {name: -x for name, x in memory.items()})
    size = np.max(np.abs(np.asarray(columns)), axis=0)
    left = np.max(np.abs(np.asarray(columns + mirrored)), axis=0)
    return left <= 1e-6 * size
