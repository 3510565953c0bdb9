"""Candidate libraries: the terms a law may be made of."""

import math
from collections.abc import Callable, Mapping, Sequence
from itertools import combinations_with_replacement, product

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._errors import InputError
from .._jit import jit
from ._term import VARIABLES, CustomFunction, Term, Trigonometric

_MOST_TERMS = 100_000


class Library(eqx.Module):
    """An ordered set of candidate terms.

    Libraries are made by `Polynomial`, `Duhem`, `BoucWen`, `Fourier` and `Custom`, and
    combined by `+` (union, each term once) and `*` (all products of two terms).

    **Attributes:**

    - `terms`: the candidates, k of them.
    """

    terms: tuple[Term, ...] = eqx.field(static=True)

    def __check_init__(self):
        if not self.terms:
            raise InputError("a library needs at least one term, got none.")
        names = self.names
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise InputError(f"a library holds each term once, got twice: {twice}.")

    def __call__(
        self, w: Float[Array, " *s"], u: Float[Array, " *s"], du: Float[Array, " *s"]
    ) -> Float[Array, "*s k"]:
        """The regressors: the last axis has one entry a term; of samples, one row
        each."""
        return jnp.stack([term(w, u, du) for term in self.terms], axis=-1)

    @jit
    def weighted(
        self,
        coefficients: Float[Array, " k"],
        w: Float[Array, "*s"],
        u: Float[Array, "*s"],
        du: Float[Array, "*s"],
    ) -> Float[Array, "*s"]:
        """The sum of the terms, each times its coefficient."""
        # Plain sums: inside a scan, XLA fuses them where a matrix product would not;
        # and what the input alone decides need not wait for w.
        driven = response = jnp.zeros_like(w)
        for i, term in enumerate(self.terms):
            addend = coefficients[i] * term(w, u, du)
            if term.driven:
                driven += addend
            else:
                response += addend
        return driven + response

    def __len__(self) -> int:
        return len(self.terms)

    def __add__(self, other: "Library") -> "Library":
        return Library(tuple(dict.fromkeys(self.terms + other.terms)))

    def __mul__(self, other: "Library") -> "Library":
        products = (a * b for a, b in product(self.terms, other.terms))
        return Library(tuple(dict.fromkeys(products)))

    @property
    def names(self) -> tuple[str, ...]:
        """Canonical names of the terms, in order."""
        return tuple(term.name for term in self.terms)


def Polynomial(
    degree: int, variables: Sequence[str] = VARIABLES, *, constant: bool = True
) -> Library:
    """All products of up to `degree` of the variables.

    **Arguments:**

    - `degree`: highest total degree, at least 1.
    - `variables`: any of `w, u, du, |du|, |w|`.
    - `constant`: whether the term 1 is among them.

    **Returns:** a library of C(v + degree, degree) terms for v variables, lowest degree
    first; 21 for degree 2 and all five.

    **Raises:** `InputError` for another degree, an unknown or repeated variable, or
    more than 100 000 terms.
    """
    _check_degree(degree)
    ordered = [name for name in VARIABLES if name in _checked(variables)]
    count = math.comb(len(ordered) + degree, degree)
    if count > _MOST_TERMS:
        raise InputError(
            f"a polynomial of degree {degree} in {len(ordered)} variables has {count} "
            f"terms, and at most {_MOST_TERMS} are built; use a lower degree or fewer "
            "variables."
        )
    terms = []
    for size in range(0 if constant else 1, degree + 1):
        for chosen in combinations_with_replacement(ordered, size):
            terms.append(Term(tuple(chosen.count(name) for name in VARIABLES)))
    return Library(tuple(terms))


def Duhem(degree: int = 1) -> Library:
    """Terms of a Duhem law: du, and |du| times a polynomial in w and u.

    For degree 1 these hold `w' = alpha |u'| u - beta |u'| w + gamma u'`.

    **Source:** Coleman and Hodgdon, *A constitutive relation for rate-independent
    hysteresis in ferromagnetically soft materials* (1986),
    doi 10.1016/0020-7225(86)90064-0.
    """
    magnitude = Library((Term.parse("|du|"),))
    driven = Polynomial(degree, ("w", "u")) * magnitude
    return Library((Term.parse("du"),)) + driven


def BoucWen(n: int = 1) -> Library:
    """Terms of a Bouc-Wen law of exponent `n`: du, w |w|^(n-1) |du| and du |w|^n.

    **Source:** Wen, *Method for random vibration of hysteretic systems* (1976),
    doi 10.1061/JMCEA3.0002106.
    """
    _check_degree(n)
    names = ("du", f"w*|du|*|w|^{n - 1}" if n > 1 else "w*|du|", f"du*|w|^{n}")
    return Library(tuple(Term.parse(name) for name in names))


def Fourier(multiples: Sequence[float], variable: str = "u") -> Library:
    """Sines and cosines of multiples of one variable.

    **Arguments:**

    - `multiples`: factors in front of the variable, in radians over its unit.
    - `variable`: one of `w, u, du, |du|, |w|`.
    """
    (name,) = _checked((variable,))
    pairs = product(multiples, ("sin", "cos"))
    return Library(
        tuple(
            Term(factors=(Trigonometric(kind, float(multiple), name),))
            for multiple, kind in pairs
        )
    )


def Custom(functions: Mapping[str, Callable]) -> Library:
    """The user's own terms: functions of `(w, u, du)` written in JAX, by name."""
    for name in functions:
        if not name.isidentifier() or name in VARIABLES:
            raise InputError(
                f"the name {name!r} of a custom term must be a Python identifier and "
                f"none of {', '.join(VARIABLES)}."
            )
    return Library(
        tuple(Term(factors=(CustomFunction(*item),)) for item in functions.items())
    )


def _check_degree(degree: int) -> None:
    if not isinstance(degree, int) or degree < 1:
        raise InputError(f"the degree must be a whole number from 1, got {degree!r}.")


def _checked(variables: Sequence[str]) -> Sequence[str]:
    if isinstance(variables, str):
        raise InputError(f"`variables` must be a tuple of names, got {variables!r}.")
    unknown = [name for name in variables if name not in VARIABLES]
    if unknown or not variables or len(set(variables)) < len(variables):
        raise InputError(
            f"`variables` must be different names out of {', '.join(VARIABLES)}; got "
            f"{tuple(variables)!r}."
        )
    return variables
