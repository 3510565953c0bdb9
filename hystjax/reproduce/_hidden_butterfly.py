"""Butterflies from input and output alone, which the paper does not do."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PRNGKeyArray

from .. import metrics
from .._discover_hidden import discover_hidden
from .._recording import Recording
from .._refine import refine
from .._simulate import simulate
from .._solution import Solution
from ..library import VARIABLES, Polynomial
from ..models import AbstractModel, Butterfly
from ..simulation import FixedStep
from ._comparison import Comparison, Row
from ._published import MEASURES, error_row
from ._records import ASYMMETRIC, EXPERIMENT_7, Setup, with_output

NOISE = (0.0, 0.01, 0.05)  # over the output's standard deviation
STARTS = 40
OFFSET = -1.0  # of the asymmetric butterfly, whose hidden device is biased
_METHOD = FixedStep(8)
DIRECT = (
    "Directly: y is hidden; the law of y, the offset c of z = y^2 + c and y(0) are "
    "fitted to z by trajectory matching, from 40 random starts. The worst of them is "
    "shown, and errors are against z without noise.",
    "The asymmetric butterfly is z = y^2 - 1 with y' = (0.6 + 0.4 u - 0.85 y) |u'| + "
    "0.2 u': the constant times |u'| biases y, and the wings differ.",
)
_STRUCTURE = (
    "All laws of up to four terms of the library of degree 2 with |w| are fitted, y "
    "being hidden. Equal ones, such as with du^2 for u^2, are tried once.",
    "The criterion is the extended BIC of the free run; less is better. z = y^2 does "
    "not tell y from -y, so of the signs of y's terms even in y only those relative to "
    "each other are known.",
)


def direct_rows() -> list[Row]:
    """Errors of the worst of many fits with y hidden."""
    rows = []
    for name, setup, offset in _BUTTERFLIES:
        seen = butterfly(setup.record(), offset)
        for noise in NOISE:
            errors = distances(seen, setup.law, noise, jax.random.key(7))
            row = f"z directly, {name}, noise {100 * noise:g} %"
            rows.append(error_row(row, float(jnp.max(errors)) ** 2))
    return rows


def butterflies() -> Comparison:
    """Butterflies with y hidden: coefficients, and the choice of terms under noise."""
    rows, laws = direct_rows(), []
    for name, setup, offset in _BUTTERFLIES:
        clean = butterfly(setup.record(), offset)
        found = structure(_noisy(clean, 0.05, jax.random.key(29)))
        rows += _structure_rows(name, found, clean)
        laws.append(f"{name}: {found.value}")
    title = "Butterflies with their polarisation hidden, squared errors in %"
    return Comparison(title, tuple(rows), (*laws, MEASURES, *DIRECT, *_STRUCTURE))


def _structure_rows(name: str, found: Solution, clean: Recording) -> list[Row]:
    best, second = found.stats["candidates"][:2]
    error = float(metrics.relative_error(clean.w, simulate(found.value, clean).w))
    ahead = second.criterion - best.criterion
    return [
        Row(f"terms chosen, {name}, noise 5 %", None, None, ", ".join(best.terms)),
        Row("  next best terms", None, None, ", ".join(second.terms)),
        Row("  by which the criterion is better", None, None, ahead),
        error_row("  error of z", error**2),
    ]


def butterfly(record: Recording, offset: float) -> Recording:
    """The record of z = y^2 + offset, from that of y."""
    return with_output(record, record.w**2 + offset)


def distances(
    clean: Recording, law: AbstractModel, noise: float, key: PRNGKeyArray
) -> Float[Array, " 40"]:
    """Relative errors of fits to noisy records of z from random starts, with laws of
    the `law`'s kind."""
    return _distances(clean, law, noise, jax.random.split(key, STARTS))


@eqx.filter_jit
def _distances(clean: Recording, law: AbstractModel, noise, keys):
    def distance(key):
        noise_key, start_key = jax.random.split(key)
        record = _noisy(clean, noise, noise_key)
        fit = refine(_random(law, record, start_key), record, throw=False, substeps=8)
        run = simulate(fit.value, clean, method=_METHOD, throw=False)
        return metrics.relative_error(clean.w, run.w)

    return jax.lax.map(distance, keys, batch_size=STARTS)


def _random(law: AbstractModel, record: Recording, key) -> Butterfly:
    """A butterfly whose numbers are random: all of either sign but beta, without which
    no law forgets."""
    start = Butterfly(law)
    names = start.parameters()
    draws = jax.random.uniform(key, (len(names),), minval=-1.0, maxval=1.0)
    values = dict(zip(names, draws, strict=True))
    values["beta"] = jnp.abs(values["beta"])
    values["offset"] += jnp.min(record.w)
    return start.with_parameters(values)


def structure(record: Recording) -> Solution:
    """The terms of the hidden law."""
    low = float(np.min(record.w))
    return discover_hidden(
        record,
        Polynomial(2, VARIABLES),
        lambda law: Butterfly(law, low),
        size=float(np.ptp(record.w)) ** 0.5,
        largest=4,
        key=jax.random.key(0),
    )


def _noisy(record: Recording, noise, key) -> Recording:
    errors = jax.random.normal(key, record.w.shape)
    return with_output(record, record.w + noise * jnp.std(record.w) * errors)


_BUTTERFLIES: tuple[tuple[str, Setup, float], ...] = (
    ("experiment 7", EXPERIMENT_7, 0.0),
    ("asymmetric", ASYMMETRIC, OFFSET),
)
