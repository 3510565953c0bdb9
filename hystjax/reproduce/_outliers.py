"""Records with gross errors, of which the paper only warns."""

from dataclasses import dataclass
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..library import VARIABLES, Library, Polynomial
from ..recording import Recording, outliers as find
from ..refinement import Cauchy, refine
from ..regression import STLSQ, LeastSquares, identify
from ..regression.formulation import WeakForm
from ..regression.weighting import Bisquare
from ..simulation import FixedStep, metrics, simulate
from ._document import AbstractDocument, shown_share
from ._published import (
    EXPERIMENT_1,
    EXPERIMENT_2,
    EXPERIMENT_4,
    published_settings,
    with_output,
)

_SHARE, _SIZE = 0.05, 5.0  # of samples; in standard deviations of the output
_METHOD = FixedStep(4)
_HEADINGS = (
    *("experiment", "route", "true terms"),
    *("coefficients, %", "worst", "free run, %", "worst"),
)
_CASES = {
    "1": (EXPERIMENT_1, VARIABLES[:4]),
    "2": (EXPERIMENT_2, VARIABLES),
    "4": (EXPERIMENT_4, VARIABLES),
}
_NOTES = (
    "Bad samples: 5 % of the outputs, at random, moved by up to five standard "
    "deviations of the output either way. Repaired: by hystjax.outliers. Errors "
    "are those of the seed at the middle and of the worst: of coefficients, the "
    "largest of a law; of free runs, relative to the clean record.",
    "A bad sample spoils two derivatives and the regressors of a third equation, "
    "and a library of 15 or 21 terms bends to it: weights alone do not save a "
    "regression, except under the growing sine (1). Judging samples before they "
    "are differentiated does, but for small errors close to the limit; weights "
    "take care of what they spoil.",
)


@dataclass(frozen=True)
class Spoiled:
    """What one route makes of many spoiled copies of a record.

    **Attributes:**

    - `experiment`, `route`: which.
    - `right`: whether the support is the true one, shape (seeds,); `None` where it was
        given.
    - `coefficients`: largest relative error of a true coefficient, shape (seeds,).
    - `free_run`: relative error against the clean record, shape (seeds,).
    """

    experiment: str
    route: str
    right: np.ndarray | None
    coefficients: np.ndarray
    free_run: np.ndarray


@dataclass(frozen=True)
class OutlierTable(AbstractDocument):
    """All routes for all experiments."""

    rows: tuple[Spoiled, ...]

    def cells(self):
        """Headings, and a line a route."""
        return [_HEADINGS, *map(_cells, self.rows)]


def outliers(seeds: int = 20) -> OutlierTable:
    """Identify and refine the laws of experiments 1, 2 and 4 from spoiled records."""
    keys = jax.random.split(jax.random.key(0), seeds)
    rows = [row for name in _CASES for row in _rows(name, keys)]
    title = f"Laws from records with 5 % of gross errors, {seeds} seeds"
    return OutlierTable(title, tuple(rows), _NOTES)


def spoiled(clean: Recording, key) -> Recording:
    """The record with gross errors in its output."""
    where, size = jax.random.split(key)
    n = len(clean)
    bad = jax.random.permutation(where, n) < round(_SHARE * n)
    limit = _SIZE * jnp.std(clean.w)
    error = jax.random.uniform(size, (n,), clean.w.dtype, -limit, limit)
    return with_output(clean, clean.w + jnp.where(bad, error, 0.0))


def _rows(name: str, keys):
    setup, variables = _CASES[name]
    library, clean = Polynomial(2, variables), setup.record()
    terms = setup.law.terms()  # pyright: ignore[reportAttributeAccessIssue]
    given = Library(tuple(term for term in library.terms if term.name in terms))
    copies = _copies(clean, keys)
    # One program a route: XLA was seen to wait for ever in one of all of them.
    for route, learn in _ROUTES.items():
        values, runs = _learned(learn, copies, library, given, clean)
        names = (given if route == _REFINED else library).names
        true = np.array([terms.get(name, 0.0) for name in names])
        right = np.all((values != 0) == (true != 0), axis=-1)
        part = np.flatnonzero(true)
        worst = np.max(np.abs(values[:, part] / true[part] - 1), axis=1)
        yield Spoiled(name, route, None if route == _REFINED else right, worst, runs)


class Copy(NamedTuple):
    """A spoiled record, the repaired one, and the limit of errors that were found."""

    bad: Recording
    repaired: Recording
    limit: Float[Array, ""]


@eqx.filter_jit
def _copies(clean: Recording, keys) -> Copy:
    """One for each key, along a leading axis."""

    def one(key):
        bad = spoiled(clean, key)
        found = find(bad)
        return Copy(bad, found.repaired, found.limit)

    return jax.vmap(one)(keys)


def _learned(learn, copies, library, given, clean):
    """Of each copy the coefficients, and the relative error of the free run."""

    def one(copy):
        law = learn(copy, library, given)
        w = simulate(law, clean, method=_METHOD, throw=False).w
        return law.coefficients * law.support, metrics.relative_error(clean.w, w)

    return map(np.asarray, eqx.filter_jit(jax.vmap(one))(copies))


def _law(record, library, regression=None, **how):
    regression = published_settings() if regression is None else regression
    return identify(record, library, regression, throw=False, **how).value


def _refined(copy: Copy, given):
    """From a regression on the repaired record."""
    start = _law(copy.repaired, given, LeastSquares())
    return refine(start, copy.bad, loss=Cauchy(copy.limit), throw=False).value


_REFINED = "the true terms refined on the bad record, Cauchy loss"
# Of a copy, the whole library, and the true terms.
_ROUTES = {
    "STLSQ, as published": lambda copy, whole, _: _law(copy.bad, whole),
    "  weighed by bisquare": lambda copy, whole, _: _law(
        copy.bad, whole, weighting=Bisquare()
    ),
    "  on the repaired record": lambda copy, whole, _: _law(copy.repaired, whole),
    "  on the repaired record, weighed": lambda copy, whole, _: _law(
        copy.repaired, whole, weighting=Bisquare()
    ),
    "weak form, on the repaired record, weighed": lambda copy, whole, _: _law(
        copy.repaired,
        whole,
        STLSQ(0.02),
        formulation=WeakForm(10),
        weighting=Bisquare(),
    ),
    _REFINED: lambda copy, _, given: _refined(copy, given),
}


def _cells(row: Spoiled) -> list[str]:
    share = "given"
    if row.right is not None:
        share = f"{np.sum(row.right)} of {len(row.right)}"
    errors = (row.coefficients, row.free_run)
    return [row.experiment, row.route, share, *(x for e in errors for x in _spread(e))]


def _spread(errors: np.ndarray) -> list[str]:
    """The middle one and the largest, in per cent."""
    ordered = np.sort(np.where(np.isfinite(errors), errors, np.inf))
    return [shown_share(x) for x in (ordered[(len(ordered) - 1) // 2], ordered[-1])]
