"""Refinement of noisy records, over many seeds, against the Cramer-Rao bound."""

from collections.abc import Sequence
from dataclasses import dataclass

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PRNGKeyArray

from .._core.solution import RESULTS
from ..models import AbstractModel, BoucWen, Duhem
from ..recording import Recording
from ..refinement import refine
from ..signals.excitation import Sine
from ..simulation import FixedStep, generate, simulate
from ._document import AbstractDocument

NOISES = (0.01, 0.05, 0.1, 0.2)  # relative to the output's standard deviation
_HEADINGS = ("law", "noise, %", "", "truth", "bound", "std / bound", "coverage, %")
_INTERVAL = 1.96  # standard errors either side: 95 % of a normal distribution
_ONE_RADIAN = 1 / (2 * np.pi)  # Hz: sin t


@dataclass(frozen=True)
class Case:
    """A law whose parameters are estimated from noisy records of sin t.

    **Attributes:** a `name`; the `law`; the `fixed` parameters; `duration`, s, of 1000
    samples from w = 0.
    """

    name: str
    law: AbstractModel
    fixed: tuple[str, ...]
    duration: float

    def record(self) -> Recording:
        """The record without noise."""
        t = np.linspace(0, self.duration, 1000)
        return generate(self.law, Sine(1.0, _ONE_RADIAN), t)

    def free(self) -> dict[str, Array]:
        """The true values of what is estimated."""
        parameters = self.law.parameters().items()
        return {name: value for name, value in parameters if name not in self.fixed}

    def start(self) -> AbstractModel:
        """Where the fits start: every parameter too large by a fifth."""
        return self.law.with_parameters({k: 1.2 * v for k, v in self.free().items()})


CASES = (
    Case("Bouc-Wen, experiment 2", BoucWen(5.0, 0.25, 0.5), ("n",), 10 * np.pi),
    Case("Bouc-Wen, experiment 3", BoucWen(1.0, 0.5, 2.0), ("n",), 20 * np.pi),
    Case("Duhem, experiment 4", Duhem(0.4, 0.5, 0.25), (), 20 * np.pi),
)


@dataclass(frozen=True)
class Scatter:
    """Estimates of one parameter at one level of noise.

    **Attributes:**

    - `case`, `noise`, `parameter`: which; noise relative to the output's standard
        deviation.
    - `truth`, `bound`: true value, and the Cramer-Rao bound of its standard deviation.
    - `estimates`, `standard_errors`: of each seed, shape (seeds,).
    """

    case: str
    noise: float
    parameter: str
    truth: float
    bound: float
    estimates: np.ndarray
    standard_errors: np.ndarray

    @property
    def deviation(self) -> float:
        """Standard deviation over the seeds."""
        return float(np.std(self.estimates, ddof=1))

    @property
    def coverage(self) -> float:
        """Share of the seeds whose 95 % interval holds the truth."""
        miss = np.abs(self.estimates - self.truth)
        return float(np.mean(miss < _INTERVAL * self.standard_errors))


@dataclass(frozen=True)
class ScatterTable(AbstractDocument):
    """Estimates of all parameters at all levels of noise."""

    rows: tuple[Scatter, ...]

    def cells(self):
        """Headings, and a line a parameter."""
        return [_HEADINGS, *map(_cells, self.rows)]

    def entry(self, row):
        """Without the seeds, but with what they come to."""
        which = {"case": row.case, "noise": row.noise, "parameter": row.parameter}
        known = {"truth": row.truth, "bound": row.bound}
        return which | known | {"deviation": row.deviation, "coverage": row.coverage}


def certainty(
    seeds: int = 200,
    *,
    cases: Sequence[Case] = CASES,
    noises: Sequence[float] = NOISES,
    key: PRNGKeyArray | None = None,
) -> ScatterTable:
    """Refine many noisy copies of simulated records and see how the estimates scatter.

    The noise is white and additive; the first output is estimated too.

    **Arguments:**

    - `seeds`: noisy copies of each record at each level, fitted in one batch.
    - `cases`: the laws and their records.
    - `noises`: levels, relative to the output's standard deviation.
    - `key`: a `jax.random` key, the same every time by default.
    """
    key = jax.random.key(0) if key is None else key
    rows = []
    for case, one in zip(cases, jax.random.split(key, len(cases)), strict=True):
        rows += _rows(case, noises, seeds, one)
    note = (
        f"{seeds} seeds of additive white noise, in one batch a level: a standard "
        f"deviation is itself known to {100 / (2 * seeds) ** 0.5:.1f} %, a coverage "
        f"near 95 % to {100 * (0.05 * 0.95 / seeds) ** 0.5:.1f} %."
    )
    return ScatterTable("Refinement against the Cramer-Rao bound", tuple(rows), (note,))


def _rows(case: Case, noises: Sequence[float], seeds: int, key) -> list[Scatter]:
    record, free = case.record(), case.free()
    size = jnp.std(record.w)
    unit = size * _bounds(case, record)
    rows = []
    for noise, one in zip(noises, jax.random.split(key, len(noises)), strict=True):
        keys = jax.random.split(one, seeds)
        estimates, errors = _fits(case.start(), case.fixed, record, noise * size, keys)
        for i, (name, truth) in enumerate(free.items()):
            best, found = float(noise * unit[i]), np.asarray(estimates[name])
            error = np.asarray(errors[name])
            rows.append(
                Scatter(case.name, noise, name, float(truth), best, found, error)
            )
    return rows


@eqx.filter_jit
def _fits(law, fixed, record, noise, keys):
    """Estimates and standard errors by parameter, each of shape (seeds,); where a fit
    does not converge the standard errors are NaN, and cover nothing."""

    def fit(key):
        error = noise * jax.random.normal(key, record.w.shape, record.w.dtype)
        noisy = eqx.tree_at(lambda recording: recording.w, record, record.w + error)
        solution = refine(law, noisy, fixed=fixed, throw=False)
        errors = solution.stats["standard_errors"]
        converged = solution.result == RESULTS.successful
        errors = {name: jnp.where(converged, x, jnp.nan) for name, x in errors.items()}
        return solution.value.parameters(), errors

    return jax.vmap(fit)(keys)


def _bounds(case: Case, record: Recording) -> Float[Array, " q"]:
    """Cramer-Rao bounds of standard deviations for noise of size 1: of the parameters,
    then of the first output.

    **Source:** Rao (1945), Bull. Calcutta Math. Soc. 37, 81; Seber and Wild (2003),
    doi 10.1002/0471725315.
    """
    names = list(case.free())

    def output(x):
        law = case.law.with_parameters(dict(zip(names, x, strict=False)))
        return simulate(law, record, w0=x[-1], method=FixedStep(2)).w

    truth = jnp.stack([*case.free().values(), record.w[0]])
    jacobian = jax.jacfwd(output)(truth)
    return jnp.sqrt(jnp.diag(jnp.linalg.inv(jacobian.T @ jacobian)))


def _cells(row: Scatter) -> list[str]:
    return [
        row.case,
        f"{100 * row.noise:g}",
        row.parameter,
        f"{row.truth:g}",
        f"{row.bound:.3g}",
        f"{row.deviation / row.bound:.3f}",
        f"{100 * row.coverage:.1f}",
    ]
