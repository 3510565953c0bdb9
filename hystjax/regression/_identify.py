"""From recordings to the least-squares problem of their derivative, from there to a
law, and what the recordings cannot tell of it."""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from .._core import checks
from .._core.checks import ComputationError, InputError, warn
from .._core.compiling import jit
from .._core.show import Progress, quantity
from .._core.solution import (
    RESULTS,
    AbstractFindings,
    Solution,
    if_sorted,
    outcome,
    raise_unless_successful,
)
from ..least_squares import (
    STLSQ,
    AbstractRegression,
    Alias,
    Fit,
    LeastSquaresProblem,
    aliases as in_words,
    compress,
    merged,
    novelty,
    part,
    root_of,
)
from ..library import Library, Polynomial, Term, at, check_library, sampled
from ..loops._reversals import half_cycles
from ..models import FittedRange, SparseModel
from ..models._base import in_jax
from ..recording import LongRecording, Recording, as_group
from ..recording._as_measured import Weights, weights_of
from ..signals import Linear
from .differentiation import AbstractDifferentiation, FiniteDifference
from .formulation import (
    AbstractFormulation,
    AbstractPointwise,
    Direct,
    Pointwise,
    WeakForm,
)
from .weighting import AbstractWeighting, Even

NEW = 1e-5  # share of a column that must be new for its term to be a candidate
_MUCH = 0.5  # of an output's standard deviation, which a threshold should not drop
_WIDTH = 0.4  # half width of test functions, in distances of turning points


def check(recordings: tuple[Recording, ...], library: Library) -> None:
    """Raise `InputError` when no law can be regressed, warn when precision is lost."""
    check_library(library)
    rows = sum(len(recording) for recording in recordings)
    checks.enough_samples(f"a library of {len(library)} terms", rows, len(library) + 1)
    for recording in recordings:
        checks.not_constant("u", recording.u, "without change there is no hysteresis.")
        checks.not_constant("w", recording.w, "there is no derivative to explain.")
        _check_sizes(recording, library)
        checks.warn_single_precision(recording.t, recording.w)


def _check_equations(
    recordings: Sequence[Recording], library: Library, how: AbstractFormulation
) -> None:
    """Raise `InputError` where there are fewer than terms."""
    made = sum(how.count(len(each)) for each in recordings)
    if made <= len(library):
        raise InputError(
            f"`{type(how).__name__}` makes {made} equations of these samples for "
            f"{len(library)} terms: give longer recordings, fewer terms, or test "
            "functions of a smaller `half_width`."
        )


def _check_weights(
    weights: Sequence[Float[Array, " _n"]], library: Library, how: AbstractFormulation
) -> None:
    """Raise `InputError` where they leave fewer equations than there are terms, or
    count for an estimate of all samples."""
    if not checks.is_concrete(*weights):
        return
    if isinstance(how, Pointwise) and how.differentiation.reach is None:
        name = type(how.differentiation).__name__
        if any(bool(jnp.any(each == 0)) for each in weights):
            raise InputError(
                f"samples with `weights` of 0 have a say in `{name}`, which is fitted "
                "to all: use `SavitzkyGolay` or `WeakForm`, or give what lies between "
                "dropouts as several recordings."
            )
    left = sum(int(jnp.sum(how.weights(each) > 0)) for each in weights)
    if left <= len(library):
        raise InputError(
            f"`weights` leave {left} equations for {len(library)} terms: one counts "
            "where all samples do that it looks at. Give weights to more neighbours, "
            "try fewer terms, or match trajectories with `refine` or `discover`."
        )


def level(group: tuple[Recording, ...]) -> tuple[float, float]:
    """Mean and standard deviation of the outputs, NaN where they are traced."""
    outputs = [recording.w for recording in group]
    if not checks.is_concrete(*outputs):
        return math.nan, math.nan
    w = np.concatenate([np.asarray(each, np.float64) for each in outputs])
    return float(np.mean(w)), float(np.std(w))


def _warn_of_offset(
    offset: tuple[float, float], unit: str, regression: AbstractRegression, how
) -> None:
    """Warn where a threshold that is a share of an output far from zero drops what may
    make that change."""
    if how.target == "rate" or not isinstance(regression, STLSQ):
        return
    if not regression.normalise or not checks.is_concrete(regression.threshold):
        return
    mean, spread = offset
    least = float(np.asarray(regression.threshold)) * math.hypot(mean, spread)
    if not least > _MUCH * spread:
        return
    warn(
        f"the output is about {quantity(mean, unit, 3)} and changes by "
        f"{quantity(spread, unit, 2)} (standard deviation), but terms below "
        f"{quantity(least, unit, 2)} are dropped, a share of its root mean square: "
        "what makes it change may be lost. Take the offset from the output first, or "
        "give `STLSQ` a smaller `threshold`.",
    )


def _check_sizes(recording: Recording, library: Library) -> None:
    """Raise `InputError` where squares of the derivative or of a term leave the floats,
    where these are known."""
    columns = recording.t, recording.u, recording.w
    if checks.is_concrete(*columns):
        t, u, w = (np.asarray(each, np.float64) for each in columns)
        largest = {}
        for name, x in (("w", w), ("u", u)):
            largest[name] = float(np.max(np.abs(x)))
            largest[f"{name}'"] = float(np.max(np.abs(np.diff(x) / np.diff(t))))
        _check_largest(largest, len(t), recording.t.dtype, library)


def _check_largest(
    largest: dict[str, float], rows: int, dtype: np.dtype, library: Library
) -> None:
    """Raise `InputError` where squares of the derivative or of a term leave the floats,
    by the largest magnitudes of signals and of their slopes: regression adds them up,
    and would lose such terms in silence."""
    number = np.finfo(dtype)
    # Of a slope that has left the floats the logarithm is none.
    logs = {
        name: math.log10(min(max(x, float(number.tiny)), float(number.max)))
        for name, x in largest.items()
    }
    parts = [_sizes(term, logs) for term in library.terms]
    sizes = 2 * np.array([*(sum(p.values()) for p in parts), logs["w'"]])
    most = math.log10(number.max) - math.log10(rows)
    bad = np.flatnonzero((sizes <= math.log10(number.tiny)) | (sizes >= most))
    if not bad.size:
        return
    term = bad[0] < len(library)
    found = parts[bad[0]] if term else {}
    cause = max(found, key=lambda signal: abs(found[signal])) if term else "w'"
    square = f"the square of the term {library.names[bad[0]]}" if term else "its square"
    raise InputError(_unheld(cause, logs[cause], square, dtype))


def _sizes(term: Term, logs: dict[str, float]) -> dict[str, float]:
    """What each signal adds to the logarithm of a term's size."""
    sizes: dict[str, float] = {}
    for variable, power in term.factors:
        w, u, s = variable.dimension or (0, 0, 0)
        signal = "w" if w else "u'" if s else "u"
        if w or u:
            sizes[signal] = sizes.get(signal, 0.0) + power * logs[signal]
    return sizes


def _unheld(cause: str, log: float, square: str, dtype: np.dtype) -> str:
    slope = " in a unit of `t`" if cause.endswith("'") else ""
    units = "it or for `t`" if slope else "it"
    hint = " 64-bit numbers, by `jax_enable_x64`, hold more." * (dtype == np.float32)
    return (
        f"`{cause[0]}` {'changes by' if slope else 'is'} about 1e{log:.0f}{slope}, and "
        f"{dtype} numbers do not hold {square}; choose another unit for {units}, in "
        f"which values are nearer to 1.{hint}"
    )


def chosen(
    formulation: AbstractFormulation | None, differentiation: AbstractDifferentiation
) -> AbstractFormulation:
    """A formulation, by default of the derivative at each sample.

    **Raises:** `InputError` for what is none.
    """
    how = Pointwise(differentiation) if formulation is None else formulation
    checks.kind("formulation", how, AbstractFormulation, "formulation.WeakForm(20)")
    checks.kind(
        "differentiation",
        differentiation,
        AbstractDifferentiation,
        "differentiation.SavitzkyGolay(11, 3)",
    )
    return how


def admitted(
    library: Library, group: tuple[Recording, ...], how: AbstractFormulation
) -> tuple[Library, tuple[Recording, ...]]:
    """The terms that can be tried on these recordings, without a clock those that do
    not depend on the rate; and the recordings with no more than these need.

    **Raises:** `InputError` when there is no such term, or a law of the value would
    hold the output.
    """
    check_library(library)
    library = of_clocks(library, group, how.target)
    _check_target(library, how)
    keep = not library.memory.empty
    return library, group if keep else tuple(each.afresh() for each in group)


def of_clocks(library: Library, group: tuple[Recording, ...], target: str) -> Library:
    """The terms, without a clock those by which a law of this target does not depend on
    the rate.

    **Raises:** `InputError` when there is none.
    """
    if all(recording.clocked for recording in group):
        return library
    degree = int(target == "rate")
    kept = [i for i, t in enumerate(library.terms) if t.rate_degree == degree]
    if not kept:
        raise InputError(
            "the recording has no clock, and every term of `library` depends on the "
            "rate of the input, or may. Use rate-independent terms, such as "
            "`library.Duhem()`, or give the times."
        )
    return library.part(kept)


def _check_target(library: Library, how: AbstractFormulation) -> None:
    """Raise `InputError` where a law of the value would hold the output."""
    looped = [term.name for term in library.terms if not term.driven]
    if how.target == "value" and looped:
        raise InputError(
            f"a law of the value w cannot hold w: leave out {looped} of `library`, and "
            "functions of your own, which might. Use terms of the input alone, such as "
            "`library.Play(radii)`."
        )


@jit
def factor(
    recordings: tuple[Recording, ...],
    library: Library,
    how: AbstractFormulation,
    weighting: AbstractWeighting = Even(),
    weights: Sequence[Float[Array, " _n"]] | None = None,
) -> LeastSquaresProblem:
    """The factored problem of the output's derivative regressed on the library."""
    counted = isinstance(weighting, Even) and weights is None
    long = sum(len(each) for each in recordings) >= _LONG
    if counted and long and isinstance(how, AbstractPointwise):
        return _by_blocks(recordings, library, how)
    each = equations(recordings, library, how)
    rows, targets = map(jnp.concatenate, zip(*each, strict=True))
    if weights is not None:
        known = jnp.concatenate([how.weights(each) for each in weights])
        if known.shape != targets.shape:
            name = type(how).__name__
            raise InputError(
                f"`{name}` makes {len(targets)} equations of these samples, and its "
                f"`weights` tells {len(known)}: override `weights` in {name}."
            )
        # Of mean 1, as without: ridges add to squares.
        known = root_of(known * jnp.sum(known > 0) / jnp.sum(known))
        rows = known[:, None] * jnp.where(known[:, None] > 0, rows, 0)
        targets = known * jnp.where(known > 0, targets, 0)
    # What is gross is told by misfits that are of one size.
    root = root_of(weighting.weights(rows, targets))
    return compress(root[:, None] * rows, root * targets)


def _by_blocks(
    recordings: tuple[Recording, ...], library: Library, how: AbstractPointwise
) -> LeastSquaresProblem:
    """The same of one equation a sample, whose terms are made for some rows at a time:
    those of all would take many times the memory of the record."""
    problems = []
    for each in recordings:
        path, wanted = each.path, jnp.ones(len(each), bool)
        rows = wanted, library.signals(path), how.samples(path, each.w)
        problem = merged(jax.lax.map(lambda some: _part(library, *some), _cut(rows)))
        problems.append(replace(problem, rows=0))
    every = merged(jax.tree.map(lambda *x: jnp.stack(x), *problems))
    return replace(every, rows=sum(len(each) for each in recordings))


def equations(
    recordings: tuple[Recording, ...],
    library: Library,
    how: AbstractFormulation,
) -> list[tuple[Float[Array, "_m k"], Float[Array, " _m"]]]:
    """Of each recording the equations for the coefficients."""
    return [how.equations(library, each.path, each.w) for each in recordings]


def told_apart(problem: LeastSquaresProblem) -> Bool[Array, " k"]:
    """The terms that are candidates: of those that are almost equal the first."""
    # As `aliases` calls it, for one compiled program.
    return novelty(problem, tolerance=jnp.asarray(NEW))[1]


def weak_form(recordings: tuple[Recording, ...]) -> WeakForm:
    """With test functions for the turning points of these inputs."""
    between = []
    for recording in recordings:
        checks.enough_samples("The weak form", len(recording), 9)
        between.append(len(recording) / half_cycles(recording))
    return WeakForm(max(2, round(_WIDTH * min(between))))


class Identified(AbstractFindings):
    """A regressed law. **Attributes:** the law, the `value`, and the `result`; all
    others are what `identify` tells in `stats`, by the same names."""

    value: SparseModel
    result: RESULTS
    num_steps: Int[Array, ""]
    residual: Float[Array, ""]
    novelty: Float[Array, " k"]
    problem: LeastSquaresProblem


def identify(
    recordings: Recording | Sequence[Recording] | LongRecording,
    library: Library | None = None,
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
    - `library`: the candidate terms, k of them; `library.Polynomial(2)` by default. On
        recordings without a clock those that do not depend on the rate are tried, and
        the law is over these.
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

    **Raises:** `InputError` for constant input or output, fewer samples or equations of
    positive weight than terms, weights of another length or negative ones, recordings
    of different units or names, and values so large or small that their squares leave
    the floating-point numbers;
    `ComputationError` for an empty support, and for candidates that are not finite.
    Warns where laws of the value are sought of an output so far from zero that a
    threshold, as a share of it, drops most of what makes it change.

    **Source:** Brunton, Proctor and Kutz (2016), doi 10.1073/pnas.1517384113; for
    hysteresis Chandra et al. (2023), doi 10.1063/5.0146134.
    """
    library = Polynomial(2) if library is None else library
    how = chosen(formulation, differentiation)
    checks.kind("regression", regression, AbstractRegression, "regression.STLSQ()")
    checks.kind("weighting", weighting, AbstractWeighting, "weighting.Bisquare()")
    checks.answers(throw=throw)
    if isinstance(recordings, LongRecording):
        if not isinstance(weighting, Even) or weights is not None:
            raise InputError(
                "`weighting` and `weights` need all rows at once, and a long recording "
                "is read in chunks; leave them out, or use a `window` of the recording."
            )
        check_library(library)
        _check_target(library, how)
        problem, reached, offset = factor_long(recordings, library, how)
        named = recordings.names, recordings.units
        _warn_of_offset(offset, recordings.units[1], regression, how)
        found = _solved(problem, library, regression, *named, how.target, reached)
    else:
        group = as_group(recordings)
        known = None if weights is None else weights_of(group, weights)
        library, group = admitted(library, group, how)
        check(group, library)
        _check_equations(group, library, how)
        if known is not None:
            _check_weights(known, library, how)
        _warn_of_offset(level(group), group[0].units[1], regression, how)
        found = _identify(group, library, regression, how, weighting, known)
    solution = found.solution()
    return raise_unless_successful(solution) if throw else solution


@jit
def _identify(recordings, library, regression, how, weighting, weights) -> Identified:
    problem = factor(recordings, library, how, weighting, weights)
    first = recordings[0]
    named = first.names, first.units
    reached = FittedRange.of(recordings)
    found = _solved(problem, library, regression, *named, how.target, reached)
    result = if_sorted(found.result, *(each.t for each in recordings))
    return replace(found, result=result)


@jit
def _solved(problem, library, regression, names, units, target, reached) -> Identified:
    """The law of a factored problem, and how far the inputs went behind it."""
    answer = f"`fit` of {type(regression).__name__}"
    with in_jax(answer):
        fit = regression.fit(problem)
    if not isinstance(fit, Fit):
        raise InputError(
            f"{answer} must return a `regression.Fit`, of coefficients, support and "
            f"number of steps; got {checks.described(fit)}."
        )
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
    return Identified(
        value=model,
        result=result,
        num_steps=fit.num_steps,
        residual=problem.residual(fit.coefficients),
        novelty=novelty(problem)[0],
        problem=problem,
    )


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
    group = as_group(recordings, "aliases(recordings, library)")
    library, group = admitted(library, group, how)
    check(group, library)
    problem = factor(group, library, how)
    if not problem.finite():
        raise ComputationError(RESULTS[RESULTS.not_finite], RESULTS.not_finite)
    return in_words(problem, library.names, tolerance)


_ROWS = 8192  # that are regressors at a time, in the cache of a core
_LONG = 2**16  # samples, from which on they are: of fewer all stay in the cache


def factor_long(
    record: LongRecording, library: Library, how: AbstractFormulation
) -> tuple[LeastSquaresProblem, FittedRange, tuple[float, float]]:
    """As `factor`, chunk by chunk: each is factored and joined to the triangle of those
    before; how far the input went; and the output's mean and standard deviation, in
    which rows that chunks share count twice.

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
    problem, extremes, levels, memory = _nothing(len(library)), [], [], None
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
            levels.append((np.mean(columns[2]), np.var(columns[2])))
            done, start = until, following
            progress.show(done)
    known = _checked_range(np.array(extremes), record, library)
    checks.warn_single_precision(*(jnp.asarray(columns[i], float) for i in (0, 2)))
    checks.warn_rounded_times(jnp.asarray(columns[0], float))
    means, variances = np.array(levels, np.float64).T
    spread = math.sqrt(np.mean(variances) + np.var(means))
    return replace(problem, rows=n), known, (float(np.mean(means)), spread)


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


@jit
def _first(library: Library, columns) -> Any:
    """What the terms remember at the first sample."""
    t, u, _ = columns
    return library.memory.start(at(Linear().path(t[:2], u[:2]).signals(), 0))


@jit
def _joined(problem, memory, columns, rows, library: Library, how):
    """The problem with some rows of a chunk more; what terms remember at the first
    sample of the next; whether the chunk is as a recording must be; and the least and
    greatest input and output in it, and how fast they changed."""
    t, u, w = columns
    sound = jnp.all(jnp.isfinite(jnp.stack(columns))) & jnp.all(jnp.diff(t) > 0)
    places = jnp.arange(t.shape[0])
    wanted = (places >= rows[0]) & (places < rows[1])
    path = Linear().path(t, u)
    held = sampled(library.memory.along(memory, path.grid(1)), 1)
    signals = jax.vmap(library.memory.values)(held, path.signals())
    estimated = how.samples(path, w)
    blocks = _cut((wanted, signals, estimated))
    chunk = merged(jax.lax.map(lambda some: _part(library, *some), blocks))
    both = jax.tree.map(lambda *x: jnp.stack(x), replace(chunk, rows=0), problem)
    speeds = [jnp.max(jnp.abs(jnp.diff(x) / jnp.diff(t))) for x in (u, w)]
    ends = [f(x) for x in (u, w) for f in (jnp.min, jnp.max)]
    extremes = jnp.array([*ends, *speeds])
    return merged(both), at(held, rows[2]), sound, extremes


def _part(library: Library, wanted, signals, estimated) -> LeastSquaresProblem:
    w, u, du, target = estimated
    regressors = jnp.where(wanted[:, None], library(w, u, du, signals), 0.0)
    return part(regressors, jnp.where(wanted, target, 0.0))


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


def _checked_range(
    extremes: np.ndarray, record: LongRecording, library: Library
) -> FittedRange:
    """How far the input went, which as the output must change, and be of a size that
    can be squared."""
    low, high = extremes.min(axis=0), extremes.max(axis=0)
    largest = {}
    for i, name in enumerate(("u", "w")):
        least, most = low[2 * i], high[2 * i + 1]
        checks.not_constant(
            name, jnp.array([least, most]), "there is nothing to learn from."
        )
        largest[name] = float(max(-least, most))
        largest[f"{name}'"] = float(high[4 + i])
    _check_largest(largest, len(record), extremes.dtype, library)
    return FittedRange(low[0], high[1], high[4])
