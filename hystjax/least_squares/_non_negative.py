"""Least squares with coefficients that are not negative."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from .._core import checks
from ._problem import LeastSquaresProblem, rank_tolerance
from ._regressions import AbstractRegression, Fit, scaled


class NonNegative(AbstractRegression):
    """Least squares over all coefficients that are zero or more.

    What a sum of plays or relays with positive weights asks for, such as the model of
    Prandtl and Ishlinskii. Most coefficients come out as exactly 0, and their terms are
    off the support: near copies of one term, to which least squares gives large
    coefficients of both signs, do no harm, and no threshold is needed. Units of terms
    do not matter.

    Where terms depend on each other, several solutions may fit equally well; this is
    one of them, and of equal terms the first.

    Derivatives with respect to the problem are those of least squares on the support
    that was found.

    **Attributes:**

    - `max_steps`: most least-squares problems that are solved; by default 10 more than
        10 for each term, where 1 or 2 for each are usual. A fit whose `num_steps` comes
        to it may have been cut short: its coefficients are zero or more and those of
        least squares on their support, but not the best.

    **Source:** Lawson and Hanson, *Solving Least Squares Problems* (1995), chapter 23,
    doi 10.1137/1.9781611971217.
    """

    max_steps: int | None = eqx.field(static=True, default=None)

    def __check_init__(self):
        if self.max_steps is not None:
            checks.positive("max_steps", self.max_steps)

    def fit(self, problem):
        inner, unit = scaled(problem, True)
        bound = self.max_steps or 10 * (len(problem.target) + 1)
        found, num_steps = _active_set(jax.lax.stop_gradient(inner), bound)
        # The numbers of the search, which are not negative whatever the rounding, with
        # the derivative of least squares on their support.
        smooth = inner.solve(found > 0)
        solution = found + (smooth - jax.lax.stop_gradient(smooth))
        return Fit(solution * unit, found > 0, num_steps)


class _Search(NamedTuple):
    """Between two least-squares problems of the search.

    **Attributes:**

    - `best`: coefficients of least squares on their support, zero or more.
    - `misfit`: their |R x - q|.
    - `slopes`: how fast the misfit falls along each further term, times the misfit; 0
        for terms that may not enter.
    - `trial`: the support to be tried next: that of `best`, and the term `entering`,
        less those that had to leave for it.
    - `path`: coefficients on the way from `best` to least squares on `trial`.
    - `going`: whether there is a trial.
    - `steps`: problems solved.
    """

    best: Float[Array, " k"]
    misfit: Float[Array, ""]
    slopes: Float[Array, " k"]
    trial: Bool[Array, " k"]
    entering: Bool[Array, " k"]
    path: Float[Array, " k"]
    going: Bool[Array, ""]
    steps: Int[Array, ""]


def _active_set(
    problem: LeastSquaresProblem, max_steps: int
) -> tuple[Float[Array, " k"], Int[Array, ""]]:
    """The solution for normalised columns, and how many problems it took.

    Terms enter one by one, the one first along which the misfit falls fastest. Where
    least squares on the terms let in turns some negative, coefficients move towards it
    only until the first of them is 0, which leaves.
    """
    # In exact arithmetic a term that enters always lessens the misfit, so that no
    # support comes twice. Rounding can break that where little is left to be gained;
    # so a support is accepted only if the misfit has really fallen, and a term that
    # entered in vain is left alone until it has. That is why the search ends, and why
    # the method's two nested loops can be one, which suits `vmap` better.
    nothing = jnp.zeros_like(problem.target)
    no_term = jnp.zeros(len(nothing), bool)
    infinite = jnp.full((), jnp.inf, nothing.dtype)
    start = _Search(
        best=nothing,
        misfit=infinite,
        slopes=nothing,
        trial=no_term,
        entering=no_term,
        path=nothing,
        going=jnp.array(True),
        steps=jnp.array(0),
    )

    def unfinished(now):
        return now.going & (now.steps < max_steps)

    end = jax.lax.while_loop(unfinished, lambda now: _step(problem, now), start)
    return end.best, end.steps


def _step(problem: LeastSquaresProblem, now: _Search) -> _Search:
    """One least-squares problem further."""
    aim, misfit, slopes = _least_squares(problem, now.trial)
    moved, leaving = _towards(aim, now)
    arrived = ~jnp.any(leaving)
    better = arrived & (misfit < now.misfit)
    in_vain = arrived & ~better

    best = jnp.where(better, aim, now.best)
    others = jnp.where(in_vain & now.entering, 0.0, now.slopes)
    slopes = jnp.where(better, slopes, others)
    entering = _first_largest(slopes)
    anew = better | in_vain
    return _Search(
        best=best,
        misfit=jnp.where(better, misfit, now.misfit),
        slopes=slopes,
        trial=jnp.where(anew, (best > 0) | entering, now.trial & ~leaving),
        entering=jnp.where(anew, entering, now.entering),
        path=jnp.where(anew, best, moved),
        going=~anew | jnp.any(entering),
        steps=now.steps + 1,
    )


def _least_squares(problem: LeastSquaresProblem, support: Bool[Array, " k"]):
    """Coefficients on a support, their misfit, and the slopes of the other terms."""
    # The columns of the support come first and are made triangular, and everything is
    # rotated with them. What is below their rows is what they leave of the target and
    # of each term: with slopes of these parts alone, what is nearly explained does not
    # drown in the rounding of what is.
    k = len(support)
    order = jnp.argsort(~support)
    columns = (problem.triangle * support)[:, order]
    both = [columns, problem.target[:, None], problem.triangle]
    rotated = jnp.linalg.qr(jnp.column_stack(both), mode="r")
    triangle, target, terms = rotated[:, :k], rotated[:, k], rotated[:, k + 1 :]

    taken = support[order]
    triangle = jnp.where(taken, triangle, jnp.eye(k, dtype=triangle.dtype))
    solution = jax.scipy.linalg.solve_triangular(triangle, jnp.where(taken, target, 0))
    solution = jnp.zeros_like(target).at[order].set(solution)

    left = jnp.where(taken, 0.0, target)
    new = jnp.where(taken[:, None], 0.0, terms)
    share, slopes = jnp.linalg.norm(new, axis=0), left @ new
    epsilon = jnp.finfo(target.dtype).eps
    size = jnp.linalg.norm(problem.target) + jnp.sum(jnp.abs(solution))
    may_enter = (
        ~support
        & (share > rank_tolerance(target.dtype))
        & (slopes > 2 * k**0.5 * epsilon * size * share)
    )
    return solution, jnp.linalg.norm(left), jnp.where(may_enter, slopes, 0.0)


def _towards(aim, now: _Search) -> tuple[Float[Array, " k"], Bool[Array, " k"]]:
    """As far from `path` towards `aim` as no coefficient turns negative, and the terms
    that come to 0 there; none if `aim` has no such term."""
    falling = now.trial & (aim <= 0)
    slope = jnp.where(falling, now.path - aim, 0.0)
    reach = jnp.where(slope > 0, now.path / jnp.where(slope > 0, slope, 1.0), 0.0)
    share = jnp.min(reach, where=falling, initial=1.0)
    moved = now.path + share * (aim - now.path)
    leaving = falling & ((reach <= share) | (moved <= 0))
    return jnp.where(now.trial & ~leaving, moved, 0.0), leaving


def _first_largest(slopes: Float[Array, " k"]) -> Bool[Array, " k"]:
    """The largest if it is positive; the first of those equal but for rounding."""
    most = jnp.max(slopes)
    alike = slopes >= (1 - rank_tolerance(slopes.dtype)) * most
    return (jnp.arange(len(slopes)) == jnp.argmax(alike)) & (most > 0)
