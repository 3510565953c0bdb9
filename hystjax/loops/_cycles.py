"""Recordings of single cycles, and cycles in histories whose loops do not close."""

import itertools
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from ..recording import Recording
from ._reversals import Reversals, reversals


def cycles(
    recording: Recording,
    *,
    threshold: float | None = None,
    found: Reversals | None = None,
) -> tuple[Recording, ...]:
    """The cycles of a record, a recording each, from one turning point of the input to
    the next but one, both included.

    A cycle knows nothing of what came before it; `recording.window(start, stop)` with
    the rows of `reversals(recording).cycles` does.

    **Arguments:** the record; `threshold` as for `reversals`; or what that `found`.

    **Returns:** as many recordings as there are cycles of three samples or more; none
    where the input turns less than twice.

    **Raises:** as `reversals` does.
    """
    found = reversals(recording, threshold=threshold) if found is None else found
    columns = [np.asarray(each) for each in (recording.t, recording.u, recording.w)]
    fields = {
        "names": recording.names,
        "units": recording.units,
        "interpolation": recording.interpolation.elsewhere(recording.t, recording.u),
        "clocked": recording.clocked,
    }
    return tuple(
        Recording(*(column[start : stop + 1] for column in columns), **fields)
        for start, _, stop in found.cycles
    )


class Rainflow(NamedTuple):
    """Cycles that a history is counted as, in the order in which they close; halves of
    cycles, which do not, come last.

    **Attributes:** all of shape (k,).

    - `range`: from its minimum to its maximum, input units.
    - `mean`: of the two, input units.
    - `count`: 1, or 0.5 for half a cycle.
    - `start`, `stop`: rows of its two turning points.
    """

    range: Float[np.ndarray, " k"]
    mean: Float[np.ndarray, " k"]
    count: Float[np.ndarray, " k"]
    start: Int[np.ndarray, " k"]
    stop: Int[np.ndarray, " k"]


def rainflow(
    recording: Recording,
    *,
    threshold: float | None = None,
    found: Reversals | None = None,
) -> Rainflow:
    """Count the cycles of a history whose amplitude changes, as materials remember
    them: an inner loop is a cycle as soon as it closes, and what is left over are half
    cycles.

    **Arguments:** as for `cycles`. The first and the last sample count as turning
    points where they are more than the threshold from their neighbours.

    **Source:** ASTM E1049-85 (2017), 5.4.4; Matsuishi and Endo (1968).
    """
    found = reversals(recording, threshold=threshold) if found is None else found
    u = np.asarray(recording.u, np.float64)
    rows = _with_ends(u, found)
    full, half, stack = [], [], []
    for row in rows.tolist():
        stack.append(row)
        while len(stack) >= 3:
            a, b, c = stack[-3:]
            if abs(u[c] - u[b]) < abs(u[b] - u[a]):
                break
            if len(stack) == 3:  # it holds the first point of the history
                half.append((a, b))
                stack.pop(0)
            else:
                full.append((a, b))
                del stack[-3:-1]
    half += itertools.pairwise(stack)
    pairs = np.array([*full, *half], int).reshape(-1, 2)
    count = np.repeat([1.0, 0.5], [len(full), len(half)])
    values = u[pairs]
    spread = np.abs(values[:, 1] - values[:, 0])
    return Rainflow(spread, np.mean(values, axis=1), count, pairs[:, 0], pairs[:, 1])


def _with_ends(u: Float[np.ndarray, " n"], found: Reversals) -> Int[np.ndarray, " m"]:
    rows = found.rows
    if not len(rows):
        return rows
    before = [0] if abs(u[0] - u[rows[0]]) > found.threshold else []
    after = [len(u) - 1] if abs(u[-1] - u[rows[-1]]) > found.threshold else []
    return np.concatenate([before, rows, after]).astype(int)
