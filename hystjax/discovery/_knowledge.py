"""What is known of a device: candidates that agree with that, signs of their
coefficients, and a part of the law."""

import math
from collections.abc import Mapping

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from .._core.checks import InputError, nearest
from ..library import Library, Term
from ..recording import Recording


def symmetric(
    library: Library,
    recording: Recording,
    rate_independent: bool,
    odd: bool,
    target: str = "rate",
) -> Library:
    """Those whose loops are the same however fast, or symmetric about zero.

    **Raises:** `InputError` where none is left.
    """
    kept = np.ones(len(library), bool)
    if rate_independent:
        kept &= [term.rate_degree == (target == "rate") for term in library.terms]
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


def signs_of(library: Library, signs: Mapping[str, float]) -> dict[str, float]:
    """Signs of coefficients by the names of terms as the library has them.

    **Raises:** `InputError` for a term that it does not have, and for other numbers
    than 1 and -1.
    """
    found = {}
    for name, sign in signs.items():
        term = name if name in library.names else Term.parse(name).name
        if term not in library.names:
            raise InputError(
                f"`signs` names {name!r}, which is no candidate. "
                f"{nearest(name, library.names)}Give signs of terms of `library`."
            )
        if sign not in (1, -1):
            raise InputError(f"`signs` are 1 or -1, got {sign!r} for {name!r}.")
        found[term] = float(sign)
    return found


def agree(terms: Mapping[str, float], signs: Mapping[str, float]) -> bool:
    """Whether no coefficient has another sign than it is to have."""
    return all(terms.get(name, 0.0) * sign >= 0 for name, sign in signs.items())


def with_part(
    library: Library, known: Mapping[str, float]
) -> tuple[Library, dict[str, float]]:
    """The candidates behind the terms of a part of the law that is known, and the
    coefficients of these by name.

    **Raises:** `InputError` for a name that is no term, a coefficient that is not
    finite, and where no candidate is left.
    """
    names = {term.name: term for term in library.terms}
    part, terms = {}, []
    for name, value in known.items():
        term = names.get(name) or Term.parse(name)
        if not math.isfinite(value):
            raise InputError(f"`known` must be finite, got {value} for {name!r}.")
        terms.append(term)
        part[term.name] = float(value)
    if not terms:
        return library, part
    whole = Library(tuple(terms)) + library
    if len(whole) == len(part):
        raise InputError("`known` holds all of `library`, and nothing is left to find.")
    return whole, part


def fixed_part(
    library: Library, known: Mapping[str, float]
) -> Float[Array, " k"] | None:
    """Those of the known part for all terms of a library; `None` of no part."""
    if not known:
        return None
    return jnp.asarray([known.get(name, 0.0) for name in library.names])


def check_part(library: Library, known: Mapping[str, float]) -> None:
    """Raise `InputError` where terms of a known part cannot be tried on a recording."""
    lost = [name for name in known if name not in library.names]
    if lost:
        raise InputError(
            f"`known` holds {lost}, which depend on the rate, and the recording has no "
            "clock: give the times."
        )
