"""What laws are tried on, the same for all that one search tries: recordings, and
candidates as what is known of the device leaves them."""

import inspect
import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from .._core.checks import InputError, described, nearest
from ..library import Library, Term
from ..models import AbstractModel, SparseModel
from ..recording import Recording
from ..refinement import free_of
from . import search
from ._layout import Layout
from .search import Around

FEW = 4  # terms, of which laws are always looked for

Weights = list[Float[Array, " _n"]]


def symmetric(
    library: Library,
    group: tuple[Recording, ...],
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
        kept &= changes_sign(library, group)
    if not np.any(kept):
        raise InputError(
            "no term of `library` is left with "
            f"`rate_independent={rate_independent}, odd={odd}`: give candidates that "
            "are, such as `library.Duhem()`."
        )
    return library.part(np.flatnonzero(kept).tolist())


def changes_sign(
    library: Library, group: tuple[Recording, ...]
) -> Bool[np.ndarray, " k"]:
    """Which terms change their sign with output, input and memory: seen on samples of
    all recordings, since functions of one's own do not say. One that is zero on all of
    them is in no law anyway."""
    size, left = np.max([_both_ways(library, each) for each in group], axis=0)
    return left <= 1e-6 * size


def _both_ways(library: Library, recording: Recording) -> Float[np.ndarray, "2 k"]:
    """The largest of each term along a recording, and of its sum with what it is where
    all signs are changed."""
    u, du = recording.path.samples()
    memory, w = library.signals(recording.path), recording.w
    columns = library(w, u, du, memory)
    mirrored = library(-w, -u, -du, {name: -x for name, x in memory.items()})
    both = np.asarray([columns, columns + mirrored])
    return np.max(np.abs(both), axis=1)


def signs_of(library: Library, signs: Mapping[str, float]) -> dict[str, float]:
    """Signs of coefficients by the names of terms as the library has them.

    **Raises:** `InputError` for a term that it does not have, and for other numbers
    than 1 and -1.
    """
    found = {}
    for name, term in _terms_of("signs", signs, library).items():
        sign = signs[name]
        if term.name not in library.names:
            raise InputError(
                f"`signs` names {name!r}, which is no candidate. "
                f"{nearest(name, library.names)}Give signs of terms of `library`."
            )
        if np.ndim(sign) or sign not in (1, -1):
            raise InputError(f"`signs` are 1 or -1, got {sign!r} for {name!r}.")
        found[term.name] = float(sign)
    return found


def _terms_of(
    what: str, given: Mapping[str, float], library: Library
) -> dict[str, Term]:
    """The terms that numbers are given for, of a library or not, by the names given.

    **Raises:** `InputError` for what is not given by the names of terms, each once.
    """
    named = isinstance(given, Mapping) and all(isinstance(name, str) for name in given)
    if not named:
        raise InputError(
            f"`{what}` must hold numbers by the names of terms, such as "
            f"{{'du': 1.0}}; got {given!r}."
        )
    known = search.by_name(library)
    terms = {name: known.get(name) or Term.parse(name) for name in given}
    if len({term.name for term in terms.values()}) < len(terms):
        raise InputError(f"`{what}` names a term twice: {', '.join(given)}.")
    return terms


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
    part, terms = {}, []
    for name, term in _terms_of("known", known, library).items():
        value = known[name]
        number = np.asarray(value)
        if number.dtype.kind not in "biuf" or number.ndim or not np.isfinite(number):
            raise InputError(
                f"`known` must hold finite numbers, got {value!r} for {name!r}."
            )
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


class Setting(NamedTuple):
    """What laws are tried on: recordings, also laid out; the candidate terms; the most
    terms of a law; how many laws of each size are tried at first; how much of a
    difference a law may keep, 0 for any; how far its output may get outside of what was
    recorded, over half of the recorded range; the model `around` a law, with which its
    output is compared; which signs coefficients are to have; those of a known part,
    whose terms come first in the library; the terms that a program has room for, where
    laws of more are tried later: one compiled program then serves both; the weights of
    the samples of each recording, `None` where all are as good; and the names of terms
    that change their sign with input and output, where laws of these alone were looked
    for too."""

    group: tuple[Recording, ...]
    layout: Layout
    library: Library
    largest: int
    width: int
    fading: float
    reach: float = math.inf
    around: Around = search.itself
    signs: Mapping[str, float] = MappingProxyType({})
    known: Mapping[str, float] = MappingProxyType({})
    room: int = 0
    weights: Weights | None = None
    odd: frozenset[str] = frozenset()

    @property
    def candidates(self) -> Library:
        """What is chosen from: the terms behind those of the known part."""
        return self.library.part(range(len(self.known), len(self.library)))

    @property
    def recorded(self) -> bool:
        """Whether the law's own output was recorded."""
        return search.alone(self.around)

    @property
    def hidden(self) -> bool:
        """Whether the output of the model around the law does not tell the law's."""
        return self.around(nothing(self.library)).hidden

    @property
    def places(self) -> int:
        """Places that a program has for terms."""
        return max(self.room, self.largest)

    @property
    def numbers(self) -> int:
        """Places for numbers in the terms, such as radii, that are fitted too."""
        return min(self.places, len(self.library.numbers))

    def own(self) -> dict[str, float]:
        """Those of the model around a law, by name."""
        return own(self.around, self.library)

    def others(self) -> int:
        """How many numbers are fitted besides the coefficients of a law."""
        free = free_of(self.around(nothing(self.library)))
        # Of first outputs without weight nothing is fitted.
        first = np.sum(np.asarray(self.layout.samples.weight[:, 0]) > 0)
        starts = {"state": len(self.group), "output": int(first), "nothing": 0}
        return len(self.own()) + starts[free]


def own(around: Around, library: Library) -> dict[str, float]:
    """The numbers of the model around a law, by name, as `around` gives them.

    **Raises:** `InputError` where it gives no model with a law's parameters.
    """
    law = nothing(library)
    try:
        inspect.signature(around).bind(law)
    except TypeError as error:
        raise InputError(
            "`around` must take a law alone, as `lambda law: models.Oscillator(mass, "
            f"damping, stiffness, law)` does; got {described(around)} ({error})."
        ) from None
    model = around(law)
    if not isinstance(model, AbstractModel):
        raise InputError(
            "`around` must make a model of a law, such as `models.Butterfly`; it made "
            f"{described(model)}."
        )
    inside, every = law.parameters(), model.parameters()
    lost = [name for name in inside if name not in every]
    if lost:
        raise InputError(
            f"the model that `around` makes has no parameter {lost[0]!r}, though "
            "its law has: let its `parameters` and `with_parameters` pass on those "
            "of the law, by the same names, as `models.Butterfly` does."
        )
    return {name: float(x) for name, x in every.items() if name not in inside}


def nothing(library: Library) -> SparseModel:
    """The law w' = 0."""
    return SparseModel(library, jnp.zeros(len(library)), np.ones(len(library), bool))
