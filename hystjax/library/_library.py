"""Candidate libraries: the terms a law may be made of."""

import functools
from collections import Counter
from collections.abc import Mapping, Sequence
from itertools import product
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from .._core import checks
from .._core.checks import is_concrete
from .._core.errors import InputError
from .._core.jit import jit
from ..saving import Storable, check_candidates
from ..signals import AbstractInputPath
from ._joint import Operators
from ._memory import AbstractMemory, NoMemory, Track
from ._operators import (
    AbstractOperator,
)
from ._term import Term
from ._variable import (
    AbstractVariable,
    Nominal,
    Values,
)


class Library(Storable):
    """An ordered set of candidate terms.

    Libraries are made by `Polynomial`, `Duhem`, `BoucWen`, `Fourier`, `Play`, `Stop`,
    `Lag` and `Custom`, and combined by `+` (union, each term once) and `*` (all
    products of two terms).

    **Attributes:**

    - `terms`: the candidates, k of them.
    - `numbers`: those in the variables of the terms, scalars, such as
        `play(u,0.1).radius`; each is there once, in however many terms its variable is.
        Names of terms show the numbers that they were made with; `settled` renames.
    """

    terms: tuple[Term, ...] = eqx.field(static=True)
    numbers: dict[str, Float[Array, ""]]

    def __init__(
        self,
        terms: Sequence[Term],
        numbers: Mapping[str, Float[ArrayLike, ""]] | None = None,
    ):
        """**Arguments:** the terms; and numbers that are not as their names show.

        **Raises:** `InputError` for no terms, or one that is there twice.
        """
        self.terms = tuple(terms)
        given, kind = numbers or {}, jnp.result_type(float)
        self.numbers = {
            name: jnp.asarray(given.get(name, nominal), kind)
            for name, nominal in _nominal(self.terms).items()
        }

    def __check_init__(self):
        if not self.terms:
            raise InputError("a library needs at least one term, got none.")
        counts = Counter(self.names)
        twice = sorted(name for name, count in counts.items() if count > 1)
        if twice:
            raise InputError(f"a library holds each term once, got twice: {twice}.")

    def __call__(
        self,
        w: Float[Array, " *s"],
        u: Float[Array, " *s"],
        du: Float[Array, " *s"],
        memory: Mapping[str, Float[Array, " *s"]] | None = None,
    ) -> Float[Array, "*s k"]:
        """The regressors: the last axis has one entry a term; of samples, one row each.

        **Arguments:** output, input and its derivative; and the signals of `memory` by
        name, where terms hold some.
        """
        values = Values(w, u, du, memory or {}, self.numbers)
        return jnp.stack([term.value(values) for term in self.terms], axis=-1)

    @jit
    def weighted(
        self,
        coefficients: Float[Array, " k"],
        w: Float[Array, "*s"],
        u: Float[Array, "*s"],
        du: Float[Array, "*s"],
        memory: Mapping[str, Float[Array, " *s"]],
    ) -> Float[Array, "*s"]:
        """The sum of the terms, each times its coefficient."""
        values = Values(w, u, du, memory, self.numbers)
        # Plain sums: inside a scan, XLA fuses them where a matrix product would not;
        # and what the input alone decides need not wait for w.
        driven = response = jnp.zeros_like(w)
        for i, term in enumerate(self.terms):
            addend = coefficients[i] * term.value(values)
            if term.driven:
                driven += addend
            else:
                response += addend
        return driven + response

    def __len__(self) -> int:
        return len(self.terms)

    def __add__(self, other: "Library") -> "Library":
        return self._joined(other, self.terms + other.terms)

    def __mul__(self, other: "Library") -> "Library":
        products = (a * b for a, b in product(self.terms, other.terms))
        return self._joined(other, products)

    def _joined(self, other: "Library", terms) -> "Library":
        both = set(self.numbers) & set(other.numbers)
        apart = [n for n in both if not _same(self.numbers[n], other.numbers[n])]
        if apart:
            raise InputError(
                f"two libraries have other numbers under one name: {sorted(apart)}. "
                "Give all radii, or all times, to one call."
            )
        unique = tuple(dict.fromkeys(terms))
        return Library(unique, self.numbers | other.numbers)

    def part(self, rows: Sequence[int]) -> "Library":
        """Some of its terms, at least one, by number."""
        return Library(tuple(self.terms[i] for i in rows), self.numbers)

    @jit
    def signals(
        self, path: AbstractInputPath, times: Float[Array, " m"] | None = None
    ) -> Mapping[str, Float[Array, " m"]]:
        """What the terms remember of an input, by name, at some times (s), by default
        those of the path's samples."""
        track = Track(self.memory, path)
        return track.values(path.t if times is None else times)

    @property
    def names(self) -> tuple[str, ...]:
        """Canonical names of the terms, in order."""
        return tuple(term.name for term in self.terms)

    @property
    def memory(self) -> AbstractMemory:
        """What the terms need to remember of the input."""
        operators = operators_of(self.terms)
        return Operators(operators, self.numbers) if operators else NoMemory()

    def to_fields(self):
        return {"terms": self.settled().names}  # which show the numbers, to the bit

    @classmethod
    def from_fields(cls, fields, context):
        names = fields.get("terms")
        if not isinstance(names, tuple) or not all(isinstance(n, str) for n in names):
            raise InputError(
                f"the names of candidate terms must be a list of text, got {names!r}."
            )
        check_candidates(len(names))
        return cls(tuple(Term.parse(name, context.functions) for name in names))

    def settled(self) -> "Library":
        """The same library, its terms named by the numbers that are in it now; while
        these are being traced, the library as it is.

        **Raises:** `InputError` where two terms have become one.
        """
        if not is_concrete(*self.numbers.values()):
            return self
        named = Library(self.terms).numbers  # rounded as they are
        changed = {
            name: float(number)
            for name, number in self.numbers.items()
            if float(number) != float(named[name])
        }
        if not changed:
            return self
        return Library([term.with_numbers(changed) for term in self.terms])

    def with_numbers(self, numbers: Mapping[str, Float[ArrayLike, ""]]) -> "Library":
        """The library with other numbers, some or all, under the names of before."""
        return Library(self.terms, self.numbers | dict(numbers))


def _same(a: Array, b: Array) -> bool:
    if a is b:
        return True
    return is_concrete(a, b) and bool(np.array_equal(a, b))


@functools.lru_cache(maxsize=256)
def _variables(terms: tuple[Term, ...]) -> tuple[AbstractVariable, ...]:
    """All that the terms are of, each once."""
    every = {
        each: None
        for term in terms
        for v, _ in term.factors
        for each in (v.chain if isinstance(v, AbstractOperator) else (v,))
    }
    return tuple(sorted(every, key=lambda v: v.order))


def operators_of(terms: Sequence[Term]) -> tuple[AbstractOperator, ...]:
    """The variables of some terms that have memory, each once."""
    every = _variables(tuple(terms))
    return tuple(v for v in every if isinstance(v, AbstractOperator))


def _nominal(terms: tuple[Term, ...]) -> dict[str, Nominal]:
    """Numbers as the names show them, by `name.what`."""
    return {
        f"{variable.name}.{what}": nominal
        for variable in _variables(terms)
        for what, nominal in variable.numbers.items()
    }


_FAMILIES = (
    *("Polynomial", "Duhem", "BoucWen", "Fourier"),
    *("Play", "Stop", "Lag", "Custom"),
)


def check_library(given: Any) -> None:
    """Raise `InputError` for what is no library, with what is likely to be meant."""
    if isinstance(given, Library):
        return
    near = checks.nearest(given, _FAMILIES) if isinstance(given, str) else ""
    swapped = "Were the arguments swapped? " if isinstance(given, eqx.Module) else ""
    raise InputError(
        f"`library` must be candidate terms, got {checks.described(given)}. {near}"
        f"{swapped}Make them by one of hystjax.library, such as `Polynomial(2)`: "
        f"{', '.join(_FAMILIES)}."
    )
