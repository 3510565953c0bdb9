"""From a recording to a law, by regression on the derivative, and what the recording
cannot tell of it."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .._core import checks
from .._core.checks import InputError
from .._core.compiling import jit
from .._core.progress import Progress
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
    LeastSquaresProblem,
    aliases as in_words,
    compress,
    merged,
    novelty,
)
from ..library import Library, at
from ..models import FittedRange, SparseModel
from ..recording import LongRecording, Recording
from ..recording._as_measured import Weights, weights_of
from ..signals import Linear
from ._regressors import admitted, as_group, check, chosen, factor
from .differentiation import AbstractDifferentiation, FiniteDifference
from .formulation import AbstractFormulation, Direct, Pointwise
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
        solution = _solved(problem, library, regression, *named, how.target, reached)
    else:
        group = as_group(recordings)
        known = None if weights is None else weights_of(group, weights)
        library, group = admitted(library, group, how)
        check(group, library)
        solution = _identify(group, library, regression, how, weighting, known)
    return raise_unless_successful(solution) if throw else solution


@jit
def _identify(recordings, library, regression, how, weighting, weights):
    problem = factor(recordings, library, how, weighting, weights)
    first = recordings[0]
    named = first.names, first.units
    reached = FittedRange.of(recordings)
    solution = _solved(problem, library, regression, *named, how.target, reached)
    result = if_sorted(solution.result, *(each.t for each in recordings))
    return Solution(solution.value, result, solution.stats)


@jit
def _solved(problem, library, regression, names, units, target, reached):
    """The law of a factored problem, and how far the inputs went behind it."""
    fit = regression.fit(problem)
    model = SparseModel(
        library,
        fit.coefficients,
        fit.support,
        target=target,
        fitted_range=reached,
        names=names,
        units=units,
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


_ROWS = 8192  # that are regressors at a time, in the cache of a core


def factor_long(
    record: LongRecording, library: Library, how: AbstractFormulation
) -> tuple[LeastSquaresProblem, FittedRange]:
    """As `_regressors.factor`, chunk by chunk: each is factored and joined to the
    triangle of those before; and how far the input went.

    Chunks overlap by what the differentiation looks at, and what terms remember goes on
    from one to the next, so that every row is the same as if the record were in memory.

    **Raises:** `InputError` for a differentiation that needs the whole record, or
    columns that make no recording.
    """
    checks.concrete("`identify` of a `LongRecording`")
    reach = _reach(how)
    n, size = len(record), min(record.chunk, len(record))
    if size < n and size <= 2 * reach:
        raise InputError(
            f"`chunk` must be more than {2 * reach} samples for this differentiation, "
            f"got {size}."
        )
    checks.enough_samples(f"a library of {len(library)} terms", n, len(library) + 1)
    problem, extremes, memory = _nothing(len(library)), [], None
    done = start = 0
    with Progress("samples", n) as progress:
        while done < n:
            until = n if start + size == n else start + size - reach
            following = max(0, min(until - reach, n - size))  # all of one size
            columns = record.read(start, start + size)
            arrays = [jnp.asarray(c, float) for c in columns]
            if memory is None:
                memory = _first(library, arrays)
            rows = np.array([done - start, until - start, following - start])
            problem, memory, sound, found = _joined(
                problem, memory, arrays, rows, library, how
            )
            if not sound:
                _explain(columns, start)
            extremes.append(found)
            done, start = until, following
            progress.show(done)
    known = _checked_range(np.array(extremes))
    checks.warn_single_precision(*(jnp.asarray(columns[i], float) for i in (0, 2)))
    return replace(problem, rows=n), known


def _reach(how: AbstractFormulation) -> int:
    """How many samples to either side an equation looks at."""
    if isinstance(how, Direct):
        return 1  # at a sample, the slope of the input is that of what follows
    reach = how.differentiation.reach if isinstance(how, Pointwise) else None
    if reach is None:
        what = how.differentiation if isinstance(how, Pointwise) else how
        raise InputError(
            "a long recording is read in chunks, and "
            f"`{type(what).__name__}` needs all of it at once; use `FiniteDifference` "
            "or `SavitzkyGolay`."
        )
    return reach


def _nothing(terms: int) -> LeastSquaresProblem:
    """The problem of no rows."""
    zeros = jnp.zeros((terms + 1, terms))
    return LeastSquaresProblem(zeros[:terms], zeros[terms], jnp.zeros(()), 0)


@eqx.filter_jit
def _first(library: Library, columns) -> Any:
    """What the terms remember at the first sample."""
    t, u, _ = columns
    return library.memory.start(at(Linear().path(t[:2], u[:2]).signals(), 0))


@eqx.filter_jit
def _joined(problem, memory, columns, rows, library: Library, how):
    """The problem with some rows of a chunk more; what terms remember at the first
    sample of the next; whether the chunk is as a recording must be; and the least and
    greatest input and output in it, and how fast the input changed."""
    t, u, w = columns
    sound = jnp.all(jnp.isfinite(jnp.stack(columns))) & jnp.all(jnp.diff(t) > 0)
    places = jnp.arange(t.shape[0])
    wanted = (places >= rows[0]) & (places < rows[1])
    path = Linear().path(t, u)
    starts, _, ends = library.memory.along(memory, path.grid(1))
    held = jax.tree.map(lambda a, b: jnp.concatenate([a, b[-1:]]), starts, ends)
    signals = jax.vmap(library.memory.values)(held, path.signals())
    estimated = how.samples(path, w)
    blocks = _cut((wanted, signals, estimated))
    part = merged(jax.lax.map(lambda some: _part(library, *some), blocks))
    both = jax.tree.map(lambda *x: jnp.stack(x), replace(part, rows=0), problem)
    speeds = jnp.abs(jnp.diff(u) / jnp.diff(t))
    ends = [f(x) for x in (u, w) for f in (jnp.min, jnp.max)]
    extremes = jnp.array([*ends, jnp.max(speeds)])
    return merged(both), at(held, rows[2]), sound, extremes


def _part(library: Library, wanted, signals, estimated) -> LeastSquaresProblem:
    w, u, du, target = estimated
    regressors = jnp.where(wanted[:, None], library(w, u, du, signals), 0.0)
    return compress(regressors, jnp.where(wanted, target, 0.0))


def _cut(columns):
    """Columns as rows of equal length, filled up with zeros."""
    length = len(columns[0])
    rows = min(_ROWS, length)
    return jax.tree.map(
        lambda c: jnp.pad(c, (0, -length % rows)).reshape(-1, rows), columns
    )


def _explain(columns: Sequence[np.ndarray], start: int) -> None:
    """Say what is wrong with a chunk."""
    try:
        for name, column in zip(("t", "u", "w"), columns, strict=True):
            checks.finite(name, jnp.asarray(column, float))
        checks.increasing("t", jnp.asarray(columns[0], float))
    except InputError as error:
        raise InputError(f"{error} (Rows are counted from row {start}.)") from None


def _checked_range(extremes: np.ndarray) -> FittedRange:
    """How far the input went, which as the output must change."""
    low, high = extremes.min(axis=0), extremes.max(axis=0)
    for name, first in (("u", 0), ("w", 2)):
        ends = jnp.array([low[first], high[first + 1]])
        checks.not_constant(name, ends, "there is nothing to learn from.")
    return FittedRange(low[0], high[1], high[4])
