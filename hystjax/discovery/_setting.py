"""What laws are tried on, the same for all that one search tries; what is known of
the device; numbers in terms, such as radii, given on a grid and then set free; and
what a search has found."""

import inspect
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from types import MappingProxyType
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Bool, Float

from .._core.checks import InputError, described, nearest
from .._core.solution import RESULTS, AbstractFindings, Solution
from ..library import AbstractVariable, Library, Term, variables_of
from ..models import AbstractModel, SparseModel
from ..recording import Recording
from ..refinement import Refined, free_of
from ..regression import Alias
from . import search
from ._layout import Layout
from .search import Around, Trial

FEW = 4  # terms, of which laws are always looked for

Weights = list[Float[Array, " _n"]]


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
    known = _by_name(library)
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


def check_part(library: Library, known: Mapping[str, float]) -> None:
    """Raise `InputError` where terms of a known part cannot be tried on a recording."""
    lost = [name for name in known if name not in library.names]
    if lost:
        raise InputError(
            f"`known` holds {lost}, which depend on the rate, and the recording has no "
            "clock: give the times."
        )


class Setting(NamedTuple):
    """What laws are tried on: recordings, also laid out; the candidate terms; the most
    terms of a law; how many laws of each size are tried at first; how much of a
    difference a law may keep, 0 for any; how far its output may get outside of what was
    recorded, over half of the recorded range; the model `around` a law, with which its
    output is compared; which signs coefficients are to have; those of a known part,
    whose terms come first in the library; the terms that a program has room for, where
    laws of more are tried later: one compiled program then serves both; and the weights
    of the samples of each recording, `None` where all are as good."""

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


def off_grid(setting: Setting, law: Trial) -> Iterator[Trial]:
    """What a law on the grid may stand for: laws with one operator between the places
    of two neighbours; and the law itself, where its own numbers lead."""
    if free_numbers(setting, law.terms):
        for guess in (*_merged(setting, law), law):
            yield free(setting, guess, law.numbers | guess.numbers)


def free(setting: Setting, law: Trial, start: Mapping[str, float]) -> Trial:
    """A law whose numbers are fitted with its coefficients, from those given or else
    from the grid; as it is, where it has none, or more than there is room for."""
    names = free_numbers(setting, law.terms)
    if len(names) > setting.numbers:
        return law
    grid = setting.library.numbers
    return replace(law, numbers={n: start.get(n, float(grid[n])) for n in names})


def free_numbers(setting: Setting, names: Iterable[str]) -> list[str]:
    """The numbers in some terms, by name, but for those in the known part."""
    fixed = {name for name, _ in _numbered(setting.library, setting.known)}
    return [name for name, _ in _numbered(setting.library, names) if name not in fixed]


def _numbered(
    library: Library, names: Iterable[str]
) -> list[tuple[str, AbstractVariable]]:
    """The numbers in some terms by name, and the variable that each is in."""
    terms = _by_name(library)
    every = variables_of(tuple(terms[name] for name in names))
    return [(f"{v.name}.{what}", v) for v in every for what in v.numbers]


def _by_name(library: Library) -> dict[str, Term]:
    return dict(zip(library.names, library.terms, strict=True))


def _merged(setting: Setting, law: Trial) -> Iterator[Trial]:
    """Of every two neighbours on the grid that do the same in a law, the law with one
    number half way between them."""
    grids = _grids(setting.library)
    inside: dict[AbstractVariable, dict[float, str]] = {}
    for name in free_numbers(setting, law.terms):
        kind, number = grids[name]
        inside.setdefault(kind, {})[number] = name
    for kind, names in inside.items():
        every = sorted(number for each, number in grids.values() if each == kind)
        for low, high in pairwise(every):
            if low not in names or high not in names:
                continue
            merged = _renamed(setting, law, {names[low]: high})
            if merged is None or len(merged.terms) == len(law.terms):
                continue
            between = sum(law.numbers.get(names[x], x) for x in (low, high)) / 2
            yield replace(merged, numbers=merged.numbers | {names[high]: between})


def on_grid(setting: Setting, law: Trial) -> Trial:
    """A law under the names of the numbers on the grid that its own have come closest
    to, if each is there once: then it is the same law, whatever it was found from."""
    grids = _grids(setting.library)
    closest = {}
    for name, number in law.numbers.items():
        kind, _ = grids[name]
        every = [x for each, x in grids.values() if each == kind]
        closest[name] = min(every, key=lambda x, number=number: abs(x - abs(number)))
    renamed = _renamed(setting, law, closest)
    return law if renamed is None or renamed.size != law.size else renamed


def _grids(library: Library) -> dict[str, tuple[AbstractVariable, float]]:
    """What numbers are of, but for themselves, and what their names show."""
    return {
        f"{v.name}.{what}": (v.with_numbers({what: 1.0}), float(number))
        for v in variables_of(library.terms)
        for what, number in v.numbers.items()
    }


def _renamed(setting: Setting, law: Trial, grid: Mapping[str, float]) -> Trial | None:
    """A law in terms with other numbers of the grid, the coefficients of those that
    become one added up; `None` where these are no candidates."""
    library, terms, found = setting.library, _by_name(setting.library), {}
    for name, x in law.terms.items():
        new = terms[name].with_numbers(grid).name
        found[new] = found.get(new, 0.0) + x
    if not found.keys() <= terms.keys() - setting.known.keys():
        return None
    numbers = {
        f"{variable.renamed(grid).name}.{name.rpartition('.')[2]}": law.numbers[name]
        for name, variable in _numbered(library, law.terms)
        if name in law.numbers
    }
    ordered = {new: found[new] for new in terms if new in found}
    return replace(law, terms=ordered, numbers=numbers)


class Discovered(AbstractFindings):
    """A law that was found, and what else was tried.

    **Attributes:** the law, or the model around it, the `value`; how its refinement
    ended, or that there is none, the `result`; all others are what `discover` tells in
    `stats`, by the same names; and how it was `refined`, told among them.
    """

    value: AbstractModel
    result: RESULTS
    candidates: tuple[Trial, ...]
    frontier: dict[int, Trial]
    alike: tuple[Trial, ...]
    apart: float
    marked: bool
    noise_floor: float
    why: str
    weights: Sequence[Float[ArrayLike, " _n"]] | None
    aliases: tuple[Alias, ...]
    signs: Mapping[str, float] | None = None
    refined: Refined | None = None

    def stats(self) -> dict[str, Any]:
        """What is known of the search, and of the fit of the law."""
        known = super().stats()
        fit = known.pop("refined", None)
        return known if fit is None else fit.stats() | known

    @classmethod
    def of(cls, solution: Solution) -> "Discovered":
        """What such a `Solution` tells."""
        known = super().of(solution)
        if not Refined.told_by(solution):
            return known
        return replace(known, refined=Refined.of(solution))
