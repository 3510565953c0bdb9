"""A Preisach model from first-order reversal curves."""

from collections.abc import Sequence

import numpy as np

from .._core.checks import InputError
from ..models import Preisach
from ..recording import Recording
from ..simulation import simulate
from ._forc_files import Curves, as_curves
from ._surface import steps_of, surface

_LEVELS = 250
_SMOOTHING = 2.0


def preisach(
    curves: Curves | Sequence[Recording],
    *,
    levels: int = _LEVELS,
    smoothing: float = _SMOOTHING,
) -> Preisach:
    """The Preisach model whose reversal curves are those that were measured.

    The weight of a relay is half the mixed difference of the moments over its cell, of
    a surface smoothed by local quadratics; differences add up again to the surface, so
    noise in weights does no harm, and they may be negative. No relays turn where
    nothing was measured. What is reversible is on the diagonal.

    **Arguments:** curves as for `forc`; how many levels, evenly from the lowest
    reversal field to the highest field; `smoothing` as there.

    **Returns:** `models.Preisach`, which starts from positive saturation.

    **Source:** Everett (1955), doi 10.1039/TF9555101551; identification from reversal
    curves as in Mayergoyz (1986), doi 10.1103/PhysRevLett.56.1518.
    """
    points = as_curves(curves)
    low, high = points.reversal.min(), points.field.max()
    nodes = np.linspace(low, high, levels + 1)
    moments = _filled(points, nodes, smoothing)
    # A level lies half way between two nodes: there the output steps from what it is
    # at the one to what it is at the other.
    edges = (nodes[1:] + nodes[:-1]) / 2
    rise = np.zeros((levels, levels))
    i, j = np.tril_indices(levels, -1)
    rise[j, i] = moments[j, i + 1] - moments[j, j]
    # Relays (i, j) of all cells: mixed differences of the rise from j to i.
    padded = np.pad(rise, ((0, 1), (0, 0)))
    rows, columns = np.tril_indices(levels - 1)
    weights = (
        padded[columns, rows + 1]
        - padded[columns + 1, rows + 1]
        - padded[columns, rows]
        + padded[columns + 1, rows]
    ) / 2
    offset = moments[-1, -1] - weights.sum()
    return Preisach(
        edges,
        weights,
        offset,
        "up",
        names=("field", "moment"),
        units=points.units,
    )


def _filled(curves: Curves, nodes, smoothing):
    """Moments at pairs of nodes, Ha first. Where a field was not measured for a
    reversal field, what they are at the nearest for which it was: no relay turns in
    between."""
    n = len(nodes)
    a, b = np.triu_indices(n)
    # At the edges too few points may be near: then more are looked for.
    found = np.full(len(a), np.nan)
    for factor in (1, 2, 4):
        missing = np.flatnonzero(~np.isfinite(found) & _measured(curves, nodes, a, b))
        if not missing.size:
            break
        half = np.full(len(missing), smoothing * factor)
        found[missing] = surface(
            curves, nodes[a[missing]], nodes[b[missing]], half
        ).moment
    out = np.full((n, n), np.nan)
    out[a, b] = found
    for row in range(1, n):
        out[row] = np.where(np.isfinite(out[row]), out[row], out[row - 1])
    for row in range(n - 2, -1, -1):
        out[row] = np.where(np.isfinite(out[row]), out[row], out[row + 1])
    return out


def _measured(curves: Curves, nodes, a, b):
    """Whether places lie within what was measured, but for a step."""
    first, last = curves.field[curves.starts[:-1]], curves.field[curves.starts[1:] - 1]
    step = max(steps_of(curves))
    curve = np.clip(np.searchsorted(first, nodes[a]), 0, len(first) - 1)
    inside = nodes[a] <= first[-1] + step
    return inside & (nodes[b] <= np.maximum(last[curve], last[curve - 1]) + step)


def left_out(
    curves: Curves | Sequence[Recording], *, every: int = 10, levels: int = _LEVELS
) -> float:
    """How a Preisach model of some curves predicts the others: the root mean square
    error on every so-many-th curve, which it has not seen, over the standard deviation
    of their moments.

    **Raises:** `InputError` where fewer than `every` curves are there.
    """
    points = as_curves(curves)
    out = np.arange(every // 2, len(points), every)
    if every < 2 or len(out) == 0:
        raise InputError(
            f"of {len(points)} curves no one in {every} can be left out; `every` must "
            "be 2 or more, and at most twice as many."
        )
    kept = np.setdiff1d(np.arange(len(points)), out)
    model = preisach(points.pick(kept), levels=levels)
    unseen = [slice(*points.starts[number : number + 2]) for number in out]
    # Each curve begins at saturation; how the field came down does not matter.
    saturated = [points.field.max()]
    u = np.concatenate([x for s in unseen for x in (saturated, points.field[s])])
    w = np.split(np.asarray(simulate(model, Recording(None, u, u)).w), _ends(unseen))
    moment = np.concatenate([points.moment[s] for s in unseen])
    misfit = np.concatenate([part[1:] for part in w]) - moment
    return float(np.sqrt(np.mean(misfit**2)) / np.std(moment))


def _ends(parts: Sequence[slice]) -> np.ndarray:
    """Where curves with a row of saturation before each are apart."""
    return np.cumsum([part.stop - part.start + 1 for part in parts])[:-1]
