"""The least-squares problem of a record that does not fit into memory."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .._core import checks
from .._core.errors import InputError
from .._core.progress import Progress
from ..least_squares import LeastSquaresProblem, compress, merged
from ..library import Library, at
from ..models import FittedRange
from ..recording import LongRecording
from ..signals import Linear
from .formulation import AbstractFormulation, Direct, Pointwise

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
