"""Candidate libraries: terms a law may be made of, and those laws usually are."""

import functools
import math
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import combinations_with_replacement, product
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from .._core import checks
from .._core.checks import InputError, is_concrete, nearest
from .._core.compiling import jit
from .._core.show import Dimension
from ..saving import Storable, check_candidates, check_known
from ..signals import AbstractInputPath, check_within
from ._joint import Operators
from ._memory import AbstractMemory, NoMemory, Track
from ._operators import (
    DEEPEST,
    MOST_DECADES,
    AbstractOperator,
    Lag as LagOf,
    LogCreep as LogCreepOf,
    Play as PlayOf,
    Stop as StopOf,
    is_range,
    signal_of,
)
from ._term import Term
from ._variable import (
    PLAIN,
    VARIABLES,
    AbstractVariable,
    CustomFunction,
    Nominal,
    Trigonometric,
    Values,
)


class Library(Storable):
    """An ordered set of candidate terms.

    Libraries are made by `Polynomial`, `Duhem`, `BoucWen`, `Fourier`, `Play`, `Stop`,
    `Lag`, `LogCreep` and `Custom`, and combined by `+` (union, each term once) and `*`
    (all products of two terms).

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

        **Raises:** `InputError` for no terms, one that is there twice, and for what is
        no term.
        """
        self.terms = tuple(terms) if isinstance(terms, Iterable) else (terms,)
        for term in self.terms:
            checks.kind("terms", term, Term, "library.Term.parse('u*|du|')")
        given, kind = numbers or {}, jnp.result_type(float)
        self.numbers = {
            name: jnp.asarray(given.get(name, nominal), kind)
            # Sorted, as JAX hands them on: places among them are the same everywhere.
            for name, nominal in sorted(_nominal(self.terms).items())
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
        w: Float[ArrayLike, " *s"] | Sequence[ArrayLike],
        u: Float[ArrayLike, " *s"] | Sequence[ArrayLike],
        du: Float[ArrayLike, " *s"] | Sequence[ArrayLike],
        memory: Mapping[str, Float[Array, " *s"]] | None = None,
    ) -> Float[Array, "*s k"]:
        """The regressors: the last axis has one entry a term; of samples, one row each.

        **Arguments:** output, input and its derivative; and the signals of `memory` by
        name, where terms hold some, as `signals` gives them.

        **Raises:** `InputError` where a signal that terms hold is not given.
        """
        w, u, du = map(jnp.asarray, (w, u, du))
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
        check_library(other)
        return self._joined(other, self.terms + other.terms)

    def __mul__(self, other: "Library") -> "Library":
        check_library(other)
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

    def signals(
        self,
        path: AbstractInputPath,
        times: Float[ArrayLike, " m"] | Sequence[ArrayLike] | None = None,
    ) -> Mapping[str, Float[Array, " m"]]:
        """What the terms remember of an input, by name, at some times (s), by default
        those of the path's samples.

        **Raises:** `InputError` for times beyond these samples.
        """
        checks.kind("path", path, AbstractInputPath, "recording.path")
        if times is None:
            return self._signals(path, path.t)
        times = checks.vector("times", times)
        check_within("times", times, path.t, "the path")
        return self._signals(path, times)

    @jit
    def _signals(
        self, path: AbstractInputPath, times: Float[Array, " m"]
    ) -> Mapping[str, Float[Array, " m"]]:
        return Track(self.memory, path).values(times)

    @property
    def names(self) -> tuple[str, ...]:
        """Canonical names of the terms, in order."""
        return tuple(term.name for term in self.terms)

    @property
    def memory(self) -> AbstractMemory:
        """What the terms need to remember of the input."""
        operators = operators_of(self.terms)
        return Operators(operators, self.numbers) if operators else NoMemory()

    @property
    def number_dimensions(self) -> dict[str, Dimension]:
        """Powers of the units of output, input and second in those of `numbers`."""
        return {
            f"{variable.name}.{what}": dimension
            for variable in variables_of(self.terms)
            for what, dimension in variable.number_dimensions.items()
            if what in variable.numbers
        }

    def to_fields(self):
        return {"terms": self.settled().names}  # which show the numbers, to the bit

    @classmethod
    def from_fields(cls, fields, context):
        check_known(cls, fields, ("terms",))
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
        terms = self.settled_terms()
        return self if terms is None else Library(terms)

    def settled_terms(self) -> tuple[Term, ...] | None:
        """The terms of `settled`, of which two may be one; `None` where the library is
        as it would be."""
        if not is_concrete(*self.numbers.values()):
            return None
        # Rounded as they are; text stands for what was traced when it was named.
        named = _nominal(self.terms)
        changed = {
            name: float(number)
            for name, number in self.numbers.items()
            if isinstance(named[name], str)
            or float(number) != float(jnp.asarray(named[name], number.dtype))
        }
        if not changed:
            return None
        return tuple(term.with_numbers(changed) for term in self.terms)

    def with_numbers(self, numbers: Mapping[str, Float[ArrayLike, ""]]) -> "Library":
        """The library with other numbers, some or all, under the names of before.

        **Raises:** `InputError` for a name that is none of these.
        """
        unknown = [name for name in numbers if name not in self.numbers]
        if unknown:
            raise InputError(
                f"there is no number {unknown[0]!r} in this library. "
                f"{nearest(unknown[0], self.numbers)}Its numbers are "
                f"{', '.join(self.numbers) or 'none'}."
            )
        return Library(self.terms, self.numbers | dict(numbers))


def _same(a: Array, b: Array) -> bool:
    if a is b:
        return True
    return is_concrete(a, b) and bool(np.array_equal(a, b))


@functools.lru_cache(maxsize=256)
def variables_of(terms: tuple[Term, ...]) -> tuple[AbstractVariable, ...]:
    """All that the terms are of, each once."""
    every = {each: None for term in terms for v, _ in term.factors for each in v.chain}
    return tuple(sorted(every, key=lambda v: v.order))


def operators_of(terms: Sequence[Term]) -> tuple[AbstractOperator, ...]:
    """The variables of some terms that have memory, each once."""
    every = variables_of(tuple(terms))
    return tuple(v for v in every if isinstance(v, AbstractOperator))


def _nominal(terms: tuple[Term, ...]) -> dict[str, Nominal]:
    """Numbers as the names show them, by `name.what`."""
    return {
        f"{variable.name}.{what}": nominal
        for variable in variables_of(terms)
        for what, nominal in variable.numbers.items()
    }


_FAMILIES = (
    *("Polynomial", "Duhem", "BoucWen", "Fourier"),
    *("Play", "Stop", "Lag", "LogCreep", "Custom"),
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
    degree = checks.count("degree", degree)
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
    n = checks.count("n", n)
    names = ("du", f"w*|du|*|w|^{n - 1}" if n > 1 else "w*|du|", f"du*|w|^{n}")
    return Library(tuple(Term.parse(name) for name in names))


def Fourier(multiples: Sequence[float], variable: str = "u") -> Library:
    """Sines and cosines of multiples of one variable.

    **Arguments:**

    - `multiples`: factors in front of the variable, in radians over its unit.
    - `variable`: one of `w, u, du, |du|, |w|`.

    **Returns:** a library of two terms for each multiple.

    **Raises:** `InputError` for another variable, and multiples that are no numbers,
    repeated, or none.
    """
    (name,) = _checked((variable,))
    _numbers_of("multiples", multiples)
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

    **Raises:** `InputError` for radii that are negative or repeated, or none.

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

    **Raises:** `InputError` for radii that are not positive, or repeated, or none.

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

    **Raises:** `InputError` for times that are not positive, or repeated, or none.
    """
    values = _numbers_of("times", times)
    checks.positive("times", values)
    return _operator_terms(LagOf, of, values, times)


def LogCreep(shortest: float, longest: float, of: str = "u") -> Library:
    """Creep with the logarithm of time: one term `creep(u,shortest,longest)`, whose
    coefficient is what a step of the input of 1 adds in each decade between two times.

    It is a sum of lags, two a decade, whose time constants are evenly spread over the
    logarithm: at most 0.011 of a decade, near both times, off the integral over these.
    Long before the shortest and after the longest time nothing creeps.

    **Arguments:**

    - `shortest`, `longest`: the times, s, positive and rising; no fit changes them.
    - `of`: the signal: `u`, or a play or stop by its name.

    **Returns:** a library of one term.

    **Raises:** `InputError` for other times or signals.

    **Source:** Vieira (1986), doi 10.1147/rd.305.0553, of piezo actuators; as lags
    Krejčí and Kuhnen (2001), doi 10.1049/ip-cta:20010375.
    """
    for name, time in (("shortest", shortest), ("longest", longest)):
        checks.number(name, time)
        checks.positive(name, time)
    if not is_range(shortest, longest):
        raise InputError(
            f"`longest` must be more than `shortest`, by {MOST_DECADES} decades at "
            f"most, got {longest} and {shortest} s."
        )
    operand = LogCreepOf(_signal(of), float(shortest), float(longest))
    return Library((Term([(operand, 1)]),))


def _numbers_of(name: str, values) -> Float[Array, " k"]:
    array = checks.vector(name, values)
    if not array.size:
        raise InputError(f"`{name}` is empty: give one number for each candidate.")
    checks.finite(name, array)
    return array


def _operator_terms(
    kind: Callable, of: str, values: Float[Array, " k"], given
) -> Library:
    """A term for each number; names show it as it was given, or where it is being
    traced its place."""
    signal = _signal(of)
    nominal: list[Nominal] = [f"n{i}" for i in range(len(values))]
    if is_concrete(values):
        nominal = np.asarray(given, np.float64).tolist()
    operators = [kind(signal, number) for number in nominal]
    numbers = {f"{o.name}.{o.what}": values[i] for i, o in enumerate(operators)}
    return Library(tuple(Term([(o, 1)]) for o in operators), numbers)


def _signal(of: str) -> str | AbstractOperator:
    signal = signal_of(of)
    if signal is None:
        raise InputError(
            f"operators are of the input, `of='u'`; got {of!r}, which is no play or "
            "stop of it either, such as 'play(u,0.1)'. (Lags need no other inside: a "
            "lag of a lag is a difference of both.)"
        )
    if of.count("(") >= DEEPEST:
        raise InputError(
            f"no more than {DEEPEST} operators stand inside of each other; got {of!r} "
            "for another one."
        )
    return signal


def Custom(functions: Mapping[str, Callable]) -> Library:
    """The user's own terms: functions of `(w, u, du)` written in JAX, by name.

    **Raises:** `InputError` for a name that is no identifier, or that of a variable,
    and for what is no function.
    """
    check_functions(functions)
    return Library(
        tuple(Term([(CustomFunction(*item), 1)]) for item in functions.items())
    )


def check_functions(functions: Any) -> None:
    """Raise `InputError` for what are no functions of one's own by name."""
    odd = [functions]
    if isinstance(functions, Mapping):
        odd = [each for each in functions.values() if not callable(each)]
    if odd:
        raise InputError(
            "`functions` must be functions of (w, u, du) by name, such as `{'knee': "
            f"lambda w, u, du: jnp.tanh(u)}}`; got {checks.described(odd[0])}."
        )
    for name in functions:
        sound = isinstance(name, str) and name.isidentifier()
        if not sound or name in VARIABLES:
            raise InputError(
                f"the name {name!r} of a custom term must be a Python identifier and "
                f"none of {', '.join(VARIABLES)}."
            )


def _checked(variables: Sequence[str]) -> Sequence[str]:
    if isinstance(variables, str) or not isinstance(variables, Iterable):
        raise InputError(f"`variables` must be a tuple of names, got {variables!r}.")
    variables = tuple(variables)
    unknown = [x for x in variables if not isinstance(x, str) or x not in VARIABLES]
    if unknown or not variables or len(set(variables)) < len(variables):
        near = nearest(unknown[0], VARIABLES) if unknown else ""
        raise InputError(
            f"`variables` must be different names out of {', '.join(VARIABLES)}; got "
            f"{variables!r}. {near}".rstrip()
        )
    return variables
