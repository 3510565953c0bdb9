"""What another experiment would tell that this one cannot."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._core import checks
from .._core.jit import jit
from .._core.solution import Solution
from ..library import Library
from ..models import AbstractLaw, as_model
from ..recording import Recording, as_recording
from ..regression import compress, novelty
from ..regression._regressors import check
from ..signals import Linear
from ..simulation import FixedStep, simulate

_HIGHER = 5**0.5  # over the frequency: of no common period
_DECAY = 3.0  # time constants in a recording

# Of the phase of the recording's main frequency and the share of its duration: shapes
# from -1 to 1.
_SHAPES: Mapping[str, Callable] = {
    "a sine of half the amplitude after the first half of the time": (
        lambda phase, share: jnp.where(share < 0.5, 1.0, 0.5) * jnp.sin(phase)
    ),
    "a sine that decays to a twentieth": (
        lambda phase, share: jnp.exp(-_DECAY * share) * jnp.sin(phase)
    ),
    "half the amplitude, and as much at 2.24 times the frequency": (
        lambda phase, share: (jnp.sin(phase) + jnp.sin(_HIGHER * phase)) / 2
    ),
}


@dataclass(frozen=True)
class Suggestion:
    """An input to try.

    **Attributes:**

    - `excitation`: in words.
    - `u`: at the recording's sample times, within its range, shape (n,).
    - `resolved`: the terms that it tells from simpler ones where the recording does
        not.
    """

    excitation: str
    u: Float[Array, " n"]
    resolved: tuple[str, ...]


def suggest_excitation(
    law: AbstractLaw | Solution,
    recording: Recording,
    library: Library,
    *,
    tolerance: float = 0.01,
) -> tuple[Suggestion, ...]:
    """Inputs under which a library's terms would differ that are equal in a recording.

    The law is simulated under each, at the recording's sample times and about its mean
    and main frequency, and within its range: nothing that the device was not exposed
    to.

    **Arguments:**

    - `law`: the best known one.
    - `recording`: what was measured.
    - `library`: the candidate terms.
    - `tolerance`: a term of which a smaller share is new, given the terms before it,
        cannot be told from those.

    **Returns:** one `Suggestion` for each input that resolves anything, the one that
    resolves most first.

    **Raises:** `InputError` as `aliases` does.
    """
    checks.concrete("`suggest_excitation`", law, recording)
    order = "suggest_excitation(law, recording, library)"
    law = as_model(law, order)
    check((as_recording(recording, order),), library)
    u, _ = recording.path.samples()
    start = recording.w[0]
    now = _told_apart(law, library, recording.path, start, tolerance)
    centre, half = (jnp.max(u) + jnp.min(u)) / 2, jnp.ptp(u) / 2
    share = (recording.t - recording.t[0]) / (recording.t[-1] - recording.t[0])
    turns = len(recording.path.turning_points()[0])
    phase = jnp.pi * max(turns, 1) * share
    found = []
    for words, shape in _SHAPES.items():
        path = Linear().path(recording.t, centre + half * shape(phase, share))
        new = _told_apart(law, library, path, start, tolerance) - now
        if new:
            resolved = tuple(name for name in library.names if name in new)
            found.append(Suggestion(words, path.samples()[0], resolved))
    return tuple(sorted(found, key=lambda each: -len(each.resolved)))


def _told_apart(law, library: Library, path, start, tolerance: float) -> set[str]:
    """Terms that along an input are not a mix of terms before them; none where the law
    diverges."""
    w = simulate(law, path, w0=start, method=FixedStep(2), throw=False).w
    if not bool(jnp.all(jnp.isfinite(w))):
        return set()
    new = np.asarray(_new(library, w, path, tolerance))
    return {name for name, is_new in zip(library.names, new, strict=True) if is_new}


@jit
def _new(library: Library, w, path, tolerance: float):
    u, du = path.samples()
    problem = compress(library(w, u, du, library.signals(path)), jnp.zeros_like(w))
    return novelty(problem, tolerance=tolerance)[1]
