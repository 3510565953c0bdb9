"""From a recording to a law, by regression on the derivative, and what the recording
cannot tell of it."""

from collections.abc import Sequence
from dataclasses import replace

import jax.numpy as jnp

from .._core import checks
from .._core.errors import InputError
from .._core.jit import jit
from .._core.solution import (
    RESULTS,
    Solution,
    if_sorted,
    outcome,
    raise_unless_successful,
)
from ..least_squares import (
    STLSQ,
    AbstractRegression,
    Alias,
    aliases as in_words,
    novelty,
)
from ..library import Library
from ..models import FittedRange, SparseModel
from ..recording import LongRecording, Recording
from ..recording._weights import Weights, weights_of
from ._long import factor_long
from ._regressors import admitted, as_group, check, chosen, factor
from .differentiation import AbstractDifferentiation, FiniteDifference
from .formulation import AbstractFormulation
from .weighting import AbstractWeighting, Even


def identify(
    recordings: Recording | Sequence[Recording] | LongRecording,
    library: Library,
    regression: AbstractRegression = STLSQ(),
    *,
    formulation: AbstractFormulation | None = None,
    differentiation: AbstractDifferentiation = FiniteDifference(),
    weights: Weights | None = None,
    weighting: AbstractWeighting = Even(),
    throw: bool = True,
) -> Solution:
    """Find a sparse law w' = sum of terms by regressing the output's derivative, or w =
    sum of terms by regressing the output itself.

    **Arguments:**

    - `recordings`: one recording, or several of one device, which give one law; or a
        `LongRecording`, which is read from disk in chunks (with `FiniteDifference` or
        `SavitzkyGolay`, and all rows counting the same; not under `jit`).
    - `library`: the candidate terms, k of them. On recordings without a clock those
        that do not depend on the rate are tried, and the law is over these.
    - `regression`: `regression.STLSQ(...)`, `Ridge(...)`, `LeastSquares()` or
        `NonNegative()`.
    - `formulation`: what is regressed: by default the derivative at each sample;
        `formulation.WeakForm(...)`, which needs none; or `formulation.Direct()`, the
        output itself.
    - `differentiation`: how that derivative is estimated, of output and input alike.
    - `weights`: of the samples, one array for each recording, shape (n,), by the least
        of which an equation counts that it looks at: by a 0 it does not, so that
        nothing is made of dropouts that were `bridged`. Or by what to weigh whole
        recordings, so that the largest does not rule: their `"range"`, or the `"noise"`
        on them. Their scale is no matter.
    - `weighting`: how much each equation counts beside that; `weighting.Bisquare()`
        leaves out those that the others contradict.
    - `throw`: whether to raise when no term survives, or to say so in `result`.

    **Returns:** a `Solution` whose `value` is a `SparseModel` and whose `stats` hold

    - `num_steps`: regressions solved;
    - `residual`: misfit of the derivative, relative to its norm (not a free-run error);
    - `novelty`: for each term the share that the excitation can tell from the terms
        before it, shape (k,);
    - `problem`: the factored `regression.LeastSquaresProblem`, for further regressions
        and for `regression.aliases`, which puts novelty in words.

    **Raises:** `InputError` for constant input or output, fewer samples than terms,
    weights of another length or negative ones, recordings of different units or names,
    and values so large or small that their squares leave the floating-point numbers;
    `ComputationError` for an empty support, and for candidates that are not finite.

    **Source:** Brunton, Proctor and Kutz (2016), doi 10.1073/pnas.1517384113; for
    hysteresis Chandra et al. (2023), doi 10.1063/5.0146134.
    """
    how = chosen(formulation, differentiation)
    if isinstance(recordings, LongRecording):
        if not isinstance(weighting, Even) or weights is not None:
            raise InputError(
                "`weighting` and `weights` need all rows at once, and a long recording "
                "is read in chunks; leave them out, or use a `window` of the recording."
            )
        problem, reached = factor_long(recordings, library, how)
        named = recordings.names, recordings.units
        solution = _solved(problem, library, regression, *named, how.target)
    else:
        group = as_group(recordings)
        known = None if weights is None else weights_of(group, weights)
        library, group = admitted(library, group, how)
        check(group, library)
        solution = _identify(group, library, regression, how, weighting, known)
        reached = FittedRange.of(group)
    solution = replace(solution, value=solution.value.fitted_on(reached))
    return raise_unless_successful(solution) if throw else solution


@jit
def _identify(recordings, library, regression, how, weighting, weights):
    problem = factor(recordings, library, how, weighting, weights)
    first = recordings[0]
    named = first.names, first.units
    solution = _solved(problem, library, regression, *named, how.target)
    result = if_sorted(solution.result, *(each.t for each in recordings))
    return Solution(solution.value, result, solution.stats)


@jit
def _solved(problem, library, regression, names, units, target):
    """The law of a factored problem."""
    fit = regression.fit(problem)
    model = SparseModel(
        library, fit.coefficients, fit.support, names=names, units=units, target=target
    )
    result = outcome(jnp.any(fit.support), RESULTS.empty_support)
    result = RESULTS.where(problem.finite(), result, RESULTS.not_finite)  # pyright: ignore
    stats = {
        "num_steps": fit.num_steps,
        "residual": problem.residual(fit.coefficients),
        "novelty": novelty(problem)[0],
        "problem": problem,
    }
    return Solution(model, result, stats)


def aliases(
    recordings: Recording | Sequence[Recording],
    library: Library,
    *,
    formulation: AbstractFormulation | None = None,
    differentiation: AbstractDifferentiation = FiniteDifference(),
    tolerance: float = 0.01,
) -> tuple[Alias, ...]:
    """Terms of a library that the excitation of a recording cannot tell apart.

    One sine makes 1, u^2 and du^2 collinear, for example: a law that holds one of them
    could hold another, and only another excitation (a second amplitude, a decaying
    sine, a second frequency) will say.

    **Arguments:**

    - `recordings`, `library`, `formulation`, `differentiation`: as for `identify`.
    - `tolerance`: a term of which a smaller share is new, given the terms before it in
        the library, counts as an alias of those.

    **Returns:** one `Alias` for each such term, in the library's order.

    **Raises:** as `identify`.
    """
    checks.concrete("`aliases`", recordings)
    how = chosen(formulation, differentiation)
    library, group = admitted(library, as_group(recordings), how)
    check(group, library)
    problem = factor(group, library, how)
    return in_words(problem, library.names, tolerance)
