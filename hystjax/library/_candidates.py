"""Libraries of the terms that laws are usually made of."""

import math
from collections.abc import Callable, Mapping, Sequence
from itertools import combinations_with_replacement, product

import numpy as np
from jaxtyping import Array, ArrayLike, Float

from .._core import checks
from .._core.checks import is_concrete, nearest
from .._core.errors import InputError
from ._library import Library
from ._operators import (
    Lag as LagOf,
    Play as PlayOf,
    Stop as StopOf,
    signal_of,
)
from ._term import Term
from ._variable import (
    PLAIN,
    VARIABLES,
    CustomFunction,
    Nominal,
    Trigonometric,
)

_MOST_TERMS = 100_000


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
    _check_degree(degree, "degree")
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
            terms.append(Term((PLAIN[name], 1) for name in chosen))
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
    _check_degree(n, "n")
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
            Term([(Trigonometric(kind, float(multiple), name), 1)])
            for multiple, kind in pairs
        )
    )


def Play(radii: ArrayLike | Sequence[ArrayLike], of: str = "u") -> Library:
    """Play operators of the input: terms `play(u,r)` with memory.

    Alone, by `formulation.Direct()`, they make a Prandtl-Ishlinskii operator; added to
    or multiplied by others they give any law such a memory. A radius of 0 is the input
    itself.

    **Arguments:**

    - `radii`: shape (k,), input units, from 0, all different.
    - `of`: the signal: `u`, or a play or stop by its name, which then stands before
        these.

    **Returns:** a library of k terms.

    **Raises:** `InputError` for radii that are negative or repeated.

    **Source:** Krasnosel'skii and Pokrovskii (1989), doi 10.1007/978-3-642-61302-9.
    """
    values = _numbers_of("radii", radii)
    checks.positive("radii", values, zero=True)
    return _operator_terms(PlayOf, of, values, radii)


def Stop(radii: ArrayLike | Sequence[ArrayLike], of: str = "u") -> Library:
    """Stop operators of the input: terms `stop(u,r)`, the input less a play.

    Springs that slide when they are drawn further than their radius: friction forces
    over a position. Behind a backlash, `of="play(u,0.1)"`.

    **Arguments:**

    - `radii`: shape (k,), input units, positive, all different.
    - `of`: the signal: `u`, or a play or stop by its name.

    **Returns:** a library of k terms.

    **Raises:** `InputError` for radii that are not positive, or repeated.

    **Source:** Krasnosel'skii and Pokrovskii (1989), doi 10.1007/978-3-642-61302-9.
    """
    values = _numbers_of("radii", radii)
    checks.positive("radii", values)
    return _operator_terms(StopOf, of, values, radii)


def Lag(times: ArrayLike | Sequence[ArrayLike], of: str = "u") -> Library:
    """First-order lags of the input: terms `lag(u,time)` that creep.

    **Arguments:**

    - `times`: time constants, shape (k,), s, positive, all different.
    - `of`: the signal: `u`, or a play or stop by its name.

    **Returns:** a library of k terms.

    **Raises:** `InputError` for times that are not positive, or repeated.
    """
    values = _numbers_of("times", times)
    checks.positive("times", values)
    return _operator_terms(LagOf, of, values, times)


def _numbers_of(name: str, values) -> Float[Array, " k"]:
    array = checks.vector(name, values)
    checks.finite(name, array)
    return array


def _operator_terms(
    kind: Callable, of: str, values: Float[Array, " k"], given
) -> Library:
    """A term for each number; names show it as it was given, or where it is being
    traced its place."""
    signal = signal_of(of)
    if signal is None:
        raise InputError(
            f"operators are of the input, `of='u'`; got {of!r}, which is no play or "
            "stop of it either, such as 'play(u,0.1)'. (Lags need no other inside: a "
            "lag of a lag is a difference of both.)"
        )
    nominal: list[Nominal] = [f"n{i}" for i in range(len(values))]
    if is_concrete(values):
        nominal = np.asarray(given, np.float64).tolist()
    operators = [kind(signal, number) for number in nominal]
    numbers = {f"{o.name}.{o.what}": values[i] for i, o in enumerate(operators)}
    return Library(tuple(Term([(o, 1)]) for o in operators), numbers)


def Custom(functions: Mapping[str, Callable]) -> Library:
    """The user's own terms: functions of `(w, u, du)` written in JAX, by name."""
    for name in functions:
        if not name.isidentifier() or name in VARIABLES:
            raise InputError(
                f"the name {name!r} of a custom term must be a Python identifier and "
                f"none of {', '.join(VARIABLES)}."
            )
    return Library(
        tuple(Term([(CustomFunction(*item), 1)]) for item in functions.items())
    )


def _check_degree(degree: int, name: str) -> None:
    if not isinstance(degree, int) or degree < 1:
        raise InputError(f"`{name}` must be a whole number from 1, got {degree!r}.")


def _checked(variables: Sequence[str]) -> Sequence[str]:
    if isinstance(variables, str):
        raise InputError(f"`variables` must be a tuple of names, got {variables!r}.")
    unknown = [name for name in variables if name not in VARIABLES]
    if unknown or not variables or len(set(variables)) < len(variables):
        near = nearest(unknown[0], VARIABLES) if unknown else ""
        raise InputError(
            f"`variables` must be different names out of {', '.join(VARIABLES)}; got "
            f"{tuple(variables)!r}. {near}".rstrip()
        )
    return variables
