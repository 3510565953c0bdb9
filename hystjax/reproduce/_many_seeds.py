"""One draw of the noise proves little: many, in one batch."""

from typing import NamedTuple

import equinox as eqx
import jax
import numpy as np

from .. import metrics
from .._identify import identify
from .._recording import Recording
from .._refine import refine
from .._simulate import simulate
from ..library import VARIABLES, Library, Polynomial
from ..regression import LeastSquares
from ..simulation import FixedStep
from ._comparison import Row
from ._published import error_row, published_settings
from ._records import with_output

_METHOD = FixedStep(4)
_METHODS = ("SINDy", "regression on the true terms", "refined")
_SHARES = (50, 90)  # of the seeds, %


class Seeds(NamedTuple):
    """Laws from many draws of the noise.

    **Attributes:**

    - `right`: share of the seeds in which SINDy finds the true terms, %.
    - `errors`: squared errors against the clean record, ratios, by method, each of
        shape (seeds,), in order; infinite for a law that diverges.
    """

    right: float
    errors: dict[str, np.ndarray]


def many_seeds(
    clean: Recording, given: Library, level: float, seeds: int = 200
) -> Seeds:
    """How SINDy, regression on the given terms and their refinement do over many draws
    of multiplicative noise.

    **Arguments:** the `clean` record; the `given` terms, which are the true ones; the
    `level` of the noise; the number of `seeds`.
    """
    keys = jax.random.split(jax.random.key(0), seeds)
    supports, errors = _batch(clean, given, level, keys)
    true = np.array([term in given.terms for term in _library().terms])
    right = 100 * float(np.mean(np.all(np.asarray(supports) == true, axis=1)))
    ordered = [np.sort(np.where(np.isfinite(x), x, np.inf)) for x in errors]
    return Seeds(right, dict(zip(_METHODS, ordered, strict=True)))


def seed_rows(label: str, found: Seeds) -> list[Row]:
    """Rows with a `label`: what half and most of the seeds stay below."""
    rows = [Row(f"{label}SINDy, seeds with the true terms, %", None, None, found.right)]
    for method, ordered in found.errors.items():
        for share in _SHARES:
            name = f"{label}{method}, truth, {share} % of the seeds below"
            rows.append(error_row(name, ordered[share * len(ordered) // 100 - 1]))
    return rows


@eqx.filter_jit
def _batch(clean, given, level, keys):
    def one(key):
        noise = level * jax.random.normal(key, clean.w.shape, clean.w.dtype)
        noisy = with_output(clean, clean.w * (1 + noise))
        sparse = identify(noisy, _library(), published_settings(), throw=False).value
        plain = identify(noisy, given, LeastSquares(), throw=False).value
        better = refine(plain, noisy, throw=False).value
        return sparse.support, [error(law) for law in (sparse, plain, better)]

    def error(law):
        w = simulate(law, clean, method=_METHOD, throw=False).w
        return metrics.relative_squared_error(clean.w, w)

    return jax.vmap(one)(keys)


def _library() -> Library:
    return Polynomial(2, VARIABLES)
