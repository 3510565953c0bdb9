"""The least-squares problem of a record that does not fit into memory."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from . import _checks
from ._errors import InputError
from ._long_recording import LongRecording
from ._progress import Meter
from .differentiation import AbstractDifferentiation
from .library import Library
from .regression import LeastSquaresProblem, compress, merged

_ROWS = 8192  # that are regressors at a time, in the cache of a core


def factor_long(
    record: LongRecording, library: Library, differentiation: Any
) -> LeastSquaresProblem:
    """As `_regressors.factor`, chunk by chunk: each is factored and joined to the
    triangle of those before.

    Chunks overlap by what the differentiation looks at, so that every row is the same
    as if the record were in memory.

    **Raises:** `InputError` for a differentiation that needs the whole record, or
    columns that make no recording.
    """
    reach = _reach(differentiation)
    n, size = len(record), min(record.chunk, len(record))
    if size < n and size <= 2 * reach:
        raise InputError(
            f"`chunk` must be more than {2 * reach} samples for this differentiation, "
            f"got {size}."
        )
    _checks.enough_samples(f"a library of {len(library)} terms", n, len(library) + 1)
    problem, extremes = _nothing(len(library)), []
    meter, done = Meter("samples", n), 0
    while done < n:
        start = max(0, min(done - reach, n - size))  # all of one size, for one program
        until = n if start + size == n else start + size - reach
        columns = record.read(start, start + size)
        rows = np.array([done - start, until - start])
        problem, sound, found = _joined(
            problem,
            [jnp.asarray(c, float) for c in columns],
            rows,
            library,
            differentiation,
        )
        if not sound:
            _explain(columns, start)
        extremes.append(found)
        done = until
        meter.show(done)
    _check_changes(np.array(extremes))
    _checks.warn_single_precision(*(jnp.asarray(columns[i], float) for i in (0, 2)))
    return replace(problem, rows=n)


def _reach(differentiation: Any) -> int:
    known = isinstance(differentiation, AbstractDifferentiation)
    if not known or differentiation.reach is None:
        raise InputError(
            "a long recording is read in chunks, and "
            f"`{type(differentiation).__name__}` needs all of it at once; use "
            "`FiniteDifference` or `SavitzkyGolay`."
        )
    return differentiation.reach


def _nothing(terms: int) -> LeastSquaresProblem:
    """The problem of no rows."""
    zeros = jnp.zeros((terms + 1, terms))
    return LeastSquaresProblem(zeros[:terms], zeros[terms], jnp.zeros(()), 0)


@eqx.filter_jit
def _joined(problem, columns, rows, library: Library, differentiation):
    """The problem with some rows of a chunk more; whether the chunk is as a recording
    must be; and the least and greatest input and output in it."""
    t, u, w = columns
    sound = jnp.all(jnp.isfinite(jnp.stack(columns))) & jnp.all(jnp.diff(t) > 0)
    places = jnp.arange(t.shape[0])
    wanted = (places >= rows[0]) & (places < rows[1])
    signals = *differentiation.estimate(t, w), *differentiation.estimate(t, u)
    part = merged(
        jax.lax.map(lambda some: _part(library, *some), _cut(wanted, *signals))
    )
    both = jax.tree.map(lambda *x: jnp.stack(x), replace(part, rows=0), problem)
    extremes = jnp.array([f(x) for x in (u, w) for f in (jnp.min, jnp.max)])
    return merged(both), sound, extremes


def _part(library: Library, wanted, w, dw, u, du) -> LeastSquaresProblem:
    regressors = jnp.where(wanted[:, None], library(w, u, du), 0.0)
    return compress(regressors, jnp.where(wanted, dw, 0.0))


def _cut(*columns):
    """Columns as rows of equal length, filled up with zeros."""
    length = columns[0].shape[0]
    rows = min(_ROWS, length)
    return [jnp.pad(c, (0, -length % rows)).reshape(-1, rows) for c in columns]


def _explain(columns: Sequence[np.ndarray], start: int) -> None:
    """Say what is wrong with a chunk."""
    try:
        for name, column in zip(("t", "u", "w"), columns, strict=True):
            _checks.finite(name, jnp.asarray(column, float))
        _checks.increasing("t", jnp.asarray(columns[0], float))
    except InputError as error:
        raise InputError(f"{error} (Rows are counted from row {start}.)") from None


def _check_changes(extremes: np.ndarray) -> None:
    low, high = extremes.min(axis=0), extremes.max(axis=0)
    for name, first in (("u", 0), ("w", 2)):
        ends = jnp.array([low[first], high[first + 1]])
        _checks.not_constant(name, ends, "there is nothing to learn from.")
