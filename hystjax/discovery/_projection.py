"""Laws worth trying inside of a model that tells, up to a few numbers of its own, what
the law gives: by variable projection, without luck."""

import itertools
import math
from collections.abc import Iterable, Iterator
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jaxtyping import Array, Bool, Float, Int
from numpy.polynomial import Polynomial

from .._core.compiling import jit
from ..library import Library, Term
from ..refinement import LevenbergMarquardt
from ..regression import LeastSquaresProblem, compress
from . import search
from ._guesses import Rows, Seen, Stage, nested
from ._setting import Setting, free, nothing
from .search import Around, Support, Trial

_SHARES = (0.0, 0.25, 0.5, 0.75, 1.0)  # of the way to where least is hidden
_WIDER = 2  # times the laws wanted, that are fitted one by one
_LANES = 16  # side by side
_SOLVER, _STEPS = LevenbergMarquardt(rtol=1e-4), 20
_ROUNDING = 1e-6  # of shares that are none, and of what a model does not make up for
_RIDGE = 1e-6  # what the law does counts so much beside what it leaves, in squares

Own = dict[str, Float[Array, ""]]
Several = dict[str, Float[Array, " starts"]]


class Lane(NamedTuple):
    """A law of up to s terms by row of the library, and which of these are used."""

    rows: Int[Array | np.ndarray, " s"]
    used: Bool[Array | np.ndarray, " s"]


def problem(
    seen: tuple[Seen, ...], around: Around, library: Library, own: dict[str, float]
) -> LeastSquaresProblem:
    """The law's rate regressed on all terms, half way between the numbers that the
    model around it has and those with which the law has least to do."""
    return _halfway(seen, around, library, _arrays(own))


def projected(setting: Setting, seen: tuple[Seen, ...]) -> tuple[Stage, ...]:
    """The best laws of each size, each with numbers of the model around it.

    What the law gives is known for any numbers of the model, and its rate is linear in
    the coefficients: least squares finds these for each support, so that only the
    numbers are searched for. First with all terms, from several starts; then about what
    that finds, where the equations are linear in both, all supports are ranked; and the
    best are fitted one by one. What is least is the misfit of the rate in its own unit:
    relative to the rate, a law would be best that all but makes the output itself.

    **Source:** Golub and Pereyra (1973), doi 10.1137/0710036, for variable projection;
    Messenger and Bortz (2021), doi 10.1137/20M1343166, for the weak form.
    """
    own = _arrays(setting.own())
    fixed = seen, setting.around, setting.library
    names, stages = setting.library.names, []
    for among in nested(setting.library):
        found, least, linear = _all_terms(*fixed, own, jnp.asarray(among))
        most, count = setting.largest, _WIDER * setting.width
        rankings = search.rankings(linear, most, count)
        supports = [among[row] for each in rankings for row in np.asarray(each.rows)]
        lists: dict[int, list[Trial]] = {}
        fits = _each(fixed, most, supports, found, least)
        for rows, fit in zip(supports, fits, strict=True):
            lists.setdefault(len(rows), []).append(_guess(names, rows, fit))
        best = (sorted(each, key=lambda x: x.squares) for each in lists.values())
        stages.append(Stage(among, tuple(map(tuple, best))))
    return tuple(stages)


def in_other_words(
    setting: Setting, seen: tuple[Seen, ...], law: Trial
) -> Iterator[Trial]:
    """The same device by other laws of no more terms, with other numbers of the model.

    What the law gives, less a share of what drives it that the model makes up for, as a
    stiffness does for a force in proportion to the position, obeys another law: for
    some shares of no more terms. Nothing measured tells which it is, and what is linear
    about one does not show the other.
    """
    if isinstance(setting.around, search.OfValue):
        return
    fixed, known = (seen, setting.around, setting.library), {tuple(law.terms)}
    shifted = _shifted(law.terms, setting.library)
    for share in itertools.chain.from_iterable(p.roots() for p in shifted.values()):
        if abs(share.imag) > _ROUNDING * abs(share):
            continue
        values = {name: _value(p, share.real) for name, p in shifted.items()}
        left = [name for name in values if values[name]]
        terms = {name: values[name] for name in setting.library.names if name in left}
        lost, more = len(terms) < len(left), len(left) > len(law.terms)
        if not terms or lost or more or tuple(terms) in known:
            continue
        known.add(tuple(terms))
        own, misfit = _less_of_driver(*fixed, _arrays(law.own), share.real)
        if misfit < _ROUNDING:
            told = Trial(terms, own={name: float(x) for name, x in own.items()})
            yield free(setting, told, law.numbers) if law.numbers else told


def _shifted(terms: dict[str, float], library: Library) -> dict[str, Polynomial]:
    """The coefficients of the law of what a law gives less a share of u, as polynomials
    in that share; none of laws that this makes no sum of terms."""
    known = dict(zip(library.names, library.terms, strict=True))
    (w, _), (u, _), (du, _) = (Term.parse(name).factors[0] for name in ("w", "u", "du"))
    found = {Term([(du, 1)]).name: Polynomial([0.0, -1.0])}
    for name, x in terms.items():
        power = int(known[name].power("w"))
        rest = [each for each in known[name].factors if each[0] != w]
        if any(variable.of_output for variable, _ in rest):
            return {}
        for k in range(power + 1):
            new = Term([*rest, (w, power - k), (u, k)]).name
            share = x * math.comb(power, k) * Polynomial([0.0, 1.0]) ** k
            found[new] = found.get(new, Polynomial([0.0])) + share
    return found


def _value(polynomial: Polynomial, x: float) -> float:
    """Of a polynomial, 0 where that is all that rounding leaves of its parts."""
    value, parts = polynomial(x), Polynomial(np.abs(polynomial.coef))(abs(x))
    return float(value) if abs(value) > _ROUNDING * parts else 0.0


def _guess(names: Support, rows: Rows, fit: "_Fit") -> Trial:
    values = fit.coefficients[: len(rows)].tolist()
    terms = dict(zip((names[row] for row in rows), values, strict=True))
    numbers = {name: float(x) for name, x in fit.own.items()}
    return Trial(terms, own=numbers, squares=float(fit.squares))


class _Fit(NamedTuple):
    """The numbers of the model, the coefficients, and the squares that they leave."""

    own: Own
    coefficients: Float[Array, " s"]
    squares: Float[Array, ""]


def _each(
    fixed, most: int, supports: list[Int[np.ndarray, " _s"]], *starts: Own
) -> Iterable[_Fit]:
    """The best fits of some supports, in portions of one size."""
    seen, around, library = fixed
    for first in range(0, len(supports), _LANES):
        portion = supports[first : first + _LANES]
        filled = [*portion, *[portion[0]] * (_LANES - len(portion))]
        used = np.arange(most) < np.array([len(row) for row in filled])[:, None]
        rows = np.zeros(used.shape, int)
        rows[used] = np.concatenate(filled)
        fits = jax.device_get(_fits(seen, around, library, Lane(rows, used), starts))
        for i in range(len(portion)):
            yield jax.tree.map(lambda leaf, i=i: leaf[i], fits)


@jit
def _less_of_driver(seen, around, library, own: Own, share):
    """The numbers of the model with which the law does less by a share of what drives
    it, and how much of that no numbers make up for, over all of it."""
    return _less(seen, around, library, own, lambda driver, made: share * driver)


@jit
def _halfway(seen, around, library, own: Own) -> LeastSquaresProblem:
    numbers = _on_the_way(own, _least(seen, around, library, own), 0.5)
    everything = np.arange(len(library))
    return compress(*_equations(seen, around, library, everything, numbers))


@jit
def _all_terms(seen, around, library, own: Own, among):
    """The numbers of the model that all terms lead to; those with which the law has
    least to do; and the equations about the first, linear in coefficients and numbers,
    as a problem in the coefficients alone."""
    least = _least(seen, around, library, own)
    shares = jnp.array(_SHARES)
    starts = jax.vmap(_on_the_way, (None, None, 0))(own, least, shares)
    lane = Lane(among, jnp.ones(len(among), bool))
    best = _best(seen, around, library, lane, starts)

    def misfit(numbers):
        left, right = _equations(seen, around, library, among, numbers)
        return right - left @ best.coefficients

    columns = jax.jacfwd(misfit)(best.own)
    others = -jnp.column_stack([columns[name] for name in own])
    terms, target = _equations(seen, around, library, among, best.own)
    both = compress(jnp.column_stack([others, terms]), target)
    return best.own, least, both.beyond(len(own))


@jit
def _fits(seen, around, library, lanes: Lane, starts: tuple[Own, ...]) -> _Fit:
    each = jax.tree.map(lambda *leaves: jnp.stack(leaves), *starts)
    # One after the other: each stays in the processor's cache, and ends when it may.
    return jax.lax.map(lambda lane: _best(seen, around, library, lane, each), lanes)


def _best(seen, around, library, lane: Lane, starts: Several) -> _Fit:
    """The fit of a support that leaves least, of those from several starts."""
    fits = jax.lax.map(lambda own: _fit(seen, around, library, lane, own), starts)
    squares = jnp.where(jnp.isfinite(fits.squares), fits.squares, jnp.inf)
    return jax.tree.map(lambda leaf: leaf[jnp.argmin(squares)], fits)


def _fit(seen, around, library, lane: Lane, own: Own) -> _Fit:
    origin = jnp.stack(list(own.values()))

    def at(numbers):
        values = dict(zip(own, numbers, strict=True))
        return _left(seen, around, library, lane, values)

    # In coordinates in which each number changes the misfit by its own size.
    columns = jax.jacfwd(lambda x: at(x)[0])(origin)
    lengths = jnp.linalg.norm(columns, axis=0)
    unit = jnp.where(lengths > 0, jnp.linalg.norm(at(origin)[0]) / lengths, 1.0)
    solution = optx.least_squares(
        lambda z, args: at(args[0] + args[1] * z)[0],
        _SOLVER,
        jnp.zeros_like(origin),
        (origin, unit),
        max_steps=_STEPS,
        throw=False,
    )
    numbers = origin + unit * solution.value
    left, coefficients = at(numbers)
    values = dict(zip(own, numbers, strict=True))
    return _Fit(values, coefficients, jnp.sum(left**2))


def _left(seen, around, library, lane: Lane, own: Own):
    """What a support leaves of the law's rate, followed by what its terms do, which
    hardly counts, and its coefficients of least squares, for some numbers of the model.

    Where terms and numbers can do the same, as u' and a stiffness, equations do not
    tell them apart: the law then is to have least to do.
    """
    terms, target = _equations(seen, around, library, lane.rows, own)
    lengths = jax.lax.stop_gradient(jnp.linalg.norm(terms, axis=0))
    lengths = jnp.where(lengths > 0, lengths, 1.0)
    columns = jnp.where(lane.used, terms / lengths, 0.0)
    ridge = jnp.diag(jnp.where(lane.used, _RIDGE, 1.0))
    chosen = jnp.linalg.solve(columns.T @ columns + ridge, columns.T @ target)
    done = _RIDGE**0.5 * chosen
    return jnp.concatenate([target - columns @ chosen, done]), chosen / lengths


def _equations(seen, around, library, rows, own: Own):
    """Of all records those of some terms, for some numbers of the model."""
    model = around(nothing(library)).with_parameters(own)
    each = [record.equations(model, library, rows) for record in seen]
    return tuple(map(jnp.concatenate, zip(*each, strict=True)))


def _least(seen, around, library, own: Own) -> Own:
    """The numbers of the model with which the law has least to do."""
    return _less(seen, around, library, own, lambda driver, made: made)[0]


def _less(seen, around, library, own: Own, part) -> tuple[Own, Float[Array, ""]]:
    """The numbers of the model with which the law does less by a part, of its driver
    and what it makes, where that is linear in these, as forces are in a mass and a
    stiffness; and what is left of the part, over all of it."""
    law = around(nothing(library))

    def signals(numbers):
        model = law.with_parameters(numbers)
        each = [model.hidden_signals(each.u, each.w, each.rate) for each in seen]
        return tuple(map(jnp.concatenate, zip(*each, strict=True)))

    columns = jax.jacfwd(lambda numbers: signals(numbers)[1])(own)
    rows = jnp.column_stack(list(columns.values()))
    # What it does not depend on stays.
    told = jnp.any(rows != 0, axis=0)
    problem = compress(rows, -part(*signals(own)))
    change = problem.solve(told)
    numbers = {name: x + change[i] for i, (name, x) in enumerate(own.items())}
    return numbers, problem.residual(change)


def _on_the_way(own: Own, end: Own, share) -> Own:
    return {name: x + share * (end[name] - x) for name, x in own.items()}


def _arrays(own: dict[str, float]) -> Own:
    return {name: jnp.asarray(x) for name, x in own.items()}
