"""The distribution of first-order reversal curves, by local regression on the fields
that were measured."""

from collections.abc import Sequence
from typing import NamedTuple

import equinox as eqx
import numpy as np
from jaxtyping import Float, Int

from .._core.checks import InputError
from ..recording import Recording
from ._forc_files import Curves, as_curves

_CANDIDATES = (2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0)
_TRIED = 3000  # points on which smoothings are compared


class Varying(eqx.Module):
    """A smoothing that grows away from the origin of the diagram, where distributions
    are broad: `least` steps of the field, and `growth` more for each step of the larger
    of Hc and |Hu|, up to `most`.

    **Source:** after Egli (2013), VARIFORC, doi 10.1016/j.gloplacha.2013.08.003, whose
    factors also differ from axis to axis.
    """

    least: float = 3.0
    growth: float = 0.06
    most: float = 9.0

    def at(self, distance: Float[np.ndarray, " q"]) -> Float[np.ndarray, " q"]:
        """Half widths, in steps, at distances in steps."""
        return np.minimum(self.least + self.growth * distance, self.most)


class Forc(eqx.Module):
    """The distribution -1/2 ∂²M / ∂Ha ∂Hb of first-order reversal curves.

    **Attributes:**

    - `hc`: coercivities (Hb - Ha) / 2, shape (k,), from 0.
    - `hu`: interaction fields (Ha + Hb) / 2, shape (l,); the bias of a switching unit.
        Some authors give it the other sign, or call it Hi or Hb.
    - `density`: shape (l, k), moment per field squared; NaN where nothing was measured.
    - `error`: its standard error.
    - `smoothing`: half widths of the window, steps of the field, shape (l, k).
    - `noise`: standard deviation of the moments about the surface.
    - `compared`: smoothings that were compared, and for each the root mean square error
        at points left out one by one; empty where one was given.
    - `units`: of fields and moments.
    """

    hc: Float[np.ndarray, " k"]
    hu: Float[np.ndarray, " l"]
    density: Float[np.ndarray, "l k"]
    error: Float[np.ndarray, "l k"]
    smoothing: Float[np.ndarray, "l k"]
    noise: float
    compared: dict[float, float]
    units: tuple[str, str] = eqx.field(static=True)

    @property
    def significance(self) -> Float[np.ndarray, "l k"]:
        """The density in standard errors; beyond 3 hardly by chance at one place."""
        return self.density / self.error

    def __str__(self) -> str:
        # Not on the ridge at Hc 0, which is what is reversible.
        inner = self.hc > np.nanmax(self.smoothing) * (self.hc[1] - self.hc[0])
        seen = np.where(inner & np.isfinite(self.density), self.density, -np.inf)
        top = np.unravel_index(np.argmax(seen), seen.shape)
        low, high = np.nanmin(self.smoothing), np.nanmax(self.smoothing)
        smoothing = f"{low:g}" if low == high else f"{low:g} to {high:g}"
        return (
            f"distribution on {len(self.hc)} x {len(self.hu)} fields, smoothing "
            f"{smoothing}; largest "
            f"at Hc {self.hc[top[1]]:.4g}, Hu {self.hu[top[0]]:.4g} {self.units[0]}, "
            f"{self.significance[top]:.3g} standard errors"
        )


def forc(
    curves: Curves | Sequence[Recording],
    *,
    smoothing: float | Varying | Sequence[float] | None = None,
    weights: str = "equal",
    hc: Float[np.ndarray, " k"] | None = None,
    hu: Float[np.ndarray, " l"] | None = None,
) -> Forc:
    """The distribution of first-order reversal curves.

    Around each place of the diagram a quadratic in the reversal field Ha and the field
    Hb is fitted by least squares to the moments in a rectangle, at the fields that were
    measured, which need not be even. Nothing is extrapolated: at the edges rectangles
    hold fewer points, and errors grow.

    **Arguments:**

    - `curves`: what `read_forc` returned, or recordings, one a curve.
    - `smoothing`: half the width of the rectangle, in steps of the fields, less a half:
        SF of Pike et al. Several are compared by leaving out points one by one, which
        the diagonal of the hat matrix does without a fit each; of those within one
        standard error of the best, the smoothest is taken. By default 2 to 8; or a
        `Varying` one.
    - `weights`: `"equal"`, of all points in the rectangle; or `"tricube"`, which fall
        to zero at the ellipse inside of it: less noise is smoothed away, and no point
        enters at once.
    - `hc`, `hu`: the axes; by default by steps of the field, Hc over all that was
        measured and Hu as far down as up.

    **Returns:** `Forc`.

    **Raises:** `InputError` for a smoothing below 1, other weights, or what are no
    curves.

    **Source:** Pike, Roberts and Verosub (1999), doi 10.1063/1.370176; local regression
    on measured fields as in Harrison and Feinberg (2008), doi 10.1029/2008GC001987;
    weights of Cleveland (1979), doi 10.1080/01621459.1979.10481038;
    errors and significance as in Heslop and Roberts (2012), doi 10.1029/2012GC004115.
    """
    if weights not in ("equal", "tricube"):
        raise InputError(f'`weights` must be "equal" or "tricube", got {weights!r}.')
    points, tricube = as_curves(curves), weights == "tricube"
    steps = steps_of(points)
    chosen, compared = _chosen(points, smoothing, steps, tricube)
    axis = _axes_of(points, steps) if hc is None or hu is None else (hc, hu)
    hc = axis[0] if hc is None else np.asarray(hc, np.float64)
    hu = axis[1] if hu is None else np.asarray(hu, np.float64)
    across, along = np.meshgrid(hc, hu)
    ha, hb = (along - across).ravel(), (along + across).ravel()
    half = _half(chosen, ha, hb, steps)
    found = surface(points, ha, hb, half, tricube)
    noise = _noise(points, chosen, steps, tricube)
    shape = across.shape
    return Forc(
        hc,
        hu,
        (-found.mixed / 2).reshape(shape),
        (noise * found.mixed_gain / 2).reshape(shape),
        np.where(np.isfinite(found.mixed), half, np.nan).reshape(shape),
        noise,
        compared,
        points.units,
    )


def _axes_of(curves: Curves, steps) -> tuple[np.ndarray, np.ndarray]:
    step = max(steps)
    across = (curves.field - curves.reversal) / 2
    along = (curves.field + curves.reversal) / 2
    hc = np.arange(0.0, across.max() + step / 2, step)
    # Curves begin at Hc 0, so that those that turn late reach far down there; a diagram
    # is as high as it is low.
    most = np.ceil(along.max() / step)
    least = -most if most > 0 else np.floor(along.min() / step)
    return hc, step * np.arange(least, most + 1)


def _half(smoothing, ha, hb, steps) -> Float[np.ndarray, " q"]:
    if isinstance(smoothing, Varying):
        far = np.maximum(np.abs(hb - ha), np.abs(ha + hb)) / 2
        return smoothing.at(far / max(steps))
    return np.full(len(ha), float(smoothing))


def _chosen(curves: Curves, smoothing, steps, tricube):
    """The smoothing, and what it was compared with."""
    if isinstance(smoothing, Varying):
        return smoothing, {}
    given = _CANDIDATES if smoothing is None else np.atleast_1d(smoothing).tolist()
    if not given or min(given) < 1:
        raise InputError(f"`smoothing` must be 1 or more, got {smoothing!r}.")
    if len(given) == 1:
        return float(given[0]), {}
    squares = {
        float(each): _left_out(curves, each, steps, tricube) ** 2 for each in given
    }
    # On the same points for all, or a wide window would be judged on fewer.
    both = np.all(np.isfinite(np.stack(list(squares.values()))), axis=0)
    compared = {each: float(np.sqrt(np.mean(s[both]))) for each, s in squares.items()}
    best = min(compared, key=lambda each: compared[each])
    spread = np.std(squares[best][both]) / np.sqrt(both.sum())
    limit = np.sqrt(compared[best] ** 2 + spread)
    return max(each for each in compared if compared[each] <= limit), compared


def _sample(curves: Curves) -> Int[np.ndarray, " q"]:
    """Points, evenly over all, on which smoothings are compared."""
    n = len(curves.field)
    return np.unique(np.linspace(0, n - 1, min(n, _TRIED)).astype(int))


def _left_out(curves: Curves, smoothing, steps, tricube) -> Float[np.ndarray, " q"]:
    """Errors at points that the fits do not see."""
    left, hat, _ = _residuals(curves, smoothing, steps, tricube)
    return left / np.where(hat < 1 - 1e-9, 1 - hat, np.nan)


def _residuals(curves: Curves, smoothing, steps, tricube):
    """What the surface misses at measured points, the diagonal of the hat matrix there,
    and the variance of a residual in that of the noise."""
    rows = _sample(curves)
    ha, hb = curves.reversal[rows], curves.field[rows]
    found = surface(curves, ha, hb, _half(smoothing, ha, hb, steps), tricube)
    spread = 1 - 2 * found.hat + found.gain**2
    return curves.moment[rows] - found.moment, found.hat, spread


def _noise(curves: Curves, smoothing, steps, tricube) -> float:
    left, _, spread = _residuals(curves, smoothing, steps, tricube)
    known = np.isfinite(left) & (spread > 1e-9)
    return float(np.sqrt(np.mean(left[known] ** 2 / spread[known])))


_TERMS = ((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2))  # powers of both fields
_MIXED = 4  # of these, the mixed one
_SPARE = 4  # points more than terms that a fit needs
_LEAST = 1e-6  # of a term, which the terms before it must leave unexplained
_CHUNK = 400_000  # stretches of curves, or with weights points, in memory together
_SAME = 1e-9  # of a step, within which fields are one


class Surface(NamedTuple):
    """What local quadratics say at q places, NaN where too few points are near: the
    `moment`; the mixed derivative `mixed`; by how much they multiply the standard
    deviation of white noise, `gain` and `mixed_gain`; and the part that a point
    at the place itself has in the moment, `hat`."""

    moment: Float[np.ndarray, " q"]
    mixed: Float[np.ndarray, " q"]
    gain: Float[np.ndarray, " q"]
    mixed_gain: Float[np.ndarray, " q"]
    hat: Float[np.ndarray, " q"]


def steps_of(curves: Curves) -> tuple[float, float]:
    """Typical steps of the reversal field, and of the field along a curve."""
    first = curves.field[curves.starts[:-1]]
    along = np.diff(curves.field)
    inner = np.ones(len(along), bool)
    inner[curves.starts[1:-1] - 1] = False
    return float(np.median(np.diff(first))), float(np.median(along[inner]))


def surface(
    curves: Curves,
    ha: Float[np.ndarray, " q"],
    hb: Float[np.ndarray, " q"],
    smoothing: Float[np.ndarray, " q"],
    tricube: bool = False,
) -> Surface:
    """Local quadratics at places (Ha, Hb), each with a smoothing of its own.

    The normal equations of a quadratic hold sums of products of powers of both fields,
    and each curve has one reversal field: with equal weights they are made of sums
    along stretches of single curves, which neighbouring places share.
    """
    steps = steps_of(curves)
    wide, long = ((smoothing + 0.5) * step for step in steps)
    first = curves.field[curves.starts[:-1]]
    low = np.searchsorted(first, ha - wide)
    high = np.searchsorted(first, ha + wide, side="right")
    out = np.full((len(Surface._fields), len(ha)), np.nan)
    # Places with windows of like size together, so that little is padded.
    order = np.argsort(high - low, kind="stable")
    begun = 0
    while begun < len(order):
        size = max(1, int(high[order[begun]] - low[order[begun]]))
        if tricube:
            size *= int(2 * np.max(long[order[begun:]]) / steps[1]) + 3
        rows = order[begun : begun + max(1, _CHUNK // size)]
        begun += len(rows)
        window = _Window(*(x[rows] for x in (ha, hb, wide, long, low, high)))
        sums = _weighted if tricube else _equal
        out[:, rows] = _fitted(window, sums(curves, window), curves.moment.mean())
    return Surface(*out)


class _Window(NamedTuple):
    """Places, half widths of their rectangles, and their curves, from `low` to
    `high`."""

    ha: np.ndarray
    hb: np.ndarray
    wide: np.ndarray
    long: np.ndarray
    low: np.ndarray
    high: np.ndarray

    def curves(self, total: int):
        """Numbers of the curves of each place, shape (q, c), and which count."""
        numbers = self.low[:, None] + np.arange(max(1, np.max(self.high - self.low)))
        return np.minimum(numbers, total - 1), numbers < self.high[:, None]


class _Sums(NamedTuple):
    """Sums over the points near each place: their `count`; `powers`, of weights times
    x^j y^k, shape (q, 5, 5), and `moments`, times the moment less its mean, shape
    (q, 3, 3); `squares`, like the first, of squared weights."""

    count: np.ndarray
    powers: np.ndarray
    moments: np.ndarray
    squares: np.ndarray


def _equal(curves: Curves, window: _Window) -> _Sums:
    """Of weights 1 in a rectangle."""
    numbers, used = window.curves(len(curves))
    row, hb, long = _stretches(window, steps_of(curves)[1])
    keys = row[:, None] * len(curves) + numbers
    wanted = np.zeros(len(hb) * len(curves), bool)
    wanted[keys[used]] = True
    pairs = np.flatnonzero(wanted)
    place, curve = np.divmod(pairs, len(curves))
    index, inside = _points(curves, curve, hb[place], long[place])
    y = np.where(inside, (curves.field[index] - hb[place, None]) / long[place, None], 0)
    m = np.where(inside, curves.moment[index] - curves.moment.mean(), 0.0)
    powers = _powers(inside.astype(float), y)
    products = [*powers, *(m * each for each in powers[:3])]
    along = np.stack([each.sum(axis=1) for each in products], axis=1)
    found = np.where(used, (np.cumsum(wanted) - 1)[keys], 0)
    x = (curves.field[curves.starts[numbers]] - window.ha[:, None]) / window.wide[
        :, None
    ]
    across = np.stack(_powers(used.astype(float), x), axis=1)
    sums = across @ along[found]
    powers = sums[..., :5]
    return _Sums(powers[:, 0, 0], powers, sums[:, :3, 5:], powers)


def _stretches(window: _Window, step: float):
    """Of each place the row of a table of fields and half lengths, and the table."""
    codes = np.zeros(len(window.hb), int)
    for column in (window.hb, window.long):
        _, code = np.unique(np.rint(column / (_SAME * step)), return_inverse=True)
        codes = codes * (code.max() + 1) + code
    _, first, row = np.unique(codes, return_index=True, return_inverse=True)
    return row, window.hb[first], window.long[first]


def _weighted(curves: Curves, window: _Window) -> _Sums:
    """Of tricube weights in the ellipse inside the rectangle."""
    numbers, used = window.curves(len(curves))
    shape = (*numbers.shape, -1)
    hb, long = (
        np.broadcast_to(each[:, None], numbers.shape).ravel()
        for each in (window.hb, window.long)
    )
    index, inside = _points(curves, numbers.ravel(), hb, long)
    inside = inside.reshape(shape) & used[..., None]
    index = index.reshape(shape)
    x, y = (
        np.where(
            inside, (column[index] - at[:, None, None]) / half[:, None, None], 0.0
        ).reshape(len(window.ha), 1, -1)
        for column, at, half in (
            (curves.reversal, window.ha, window.wide),
            (curves.field, window.hb, window.long),
        )
    )
    inside = inside.reshape(x.shape)
    m = np.where(inside, curves.moment[index].reshape(x.shape), 0.0)
    m -= curves.moment.mean() * inside
    weight = inside * np.maximum(1 - np.hypot(x, y) ** 3, 0.0) ** 3
    across = np.concatenate(_powers(weight, x), axis=1)
    along = np.swapaxes(np.concatenate(_powers(np.ones_like(y), y), axis=1), 1, 2)
    return _Sums(
        np.sum(weight > 0, axis=(1, 2)),
        across @ along,
        (m * across[:, :3]) @ along[..., :3],
        (weight * across) @ along,
    )


def _powers(first, x) -> list[np.ndarray]:
    """An array times x^0 to x^4."""
    out = [first]
    for _ in range(4):
        out.append(out[-1] * x)
    return out


def _points(curves: Curves, curve, hb, long):
    """Numbers of the points of a curve within a half length of a field, shape (p, k),
    and which of them count."""
    # One search over all curves: each has a stretch of its own on a common axis.
    origin = curves.field.min()
    span = 2 * (np.ptp(curves.field) + np.max(long) + np.max(np.abs(hb - origin)))
    number = np.repeat(np.arange(len(curves)), np.diff(curves.starts))
    keys = number * span + (curves.field - origin)
    shifted = curve * span - origin
    before = np.searchsorted(keys, shifted + hb - long, side="left")
    after = np.searchsorted(keys, shifted + hb + long, side="right")
    begun = np.maximum(before, curves.starts[curve])
    count = np.maximum(np.minimum(after, curves.starts[curve + 1]) - begun, 0)
    index = begun[:, None] + np.arange(max(1, np.max(count)))
    inside = np.arange(index.shape[1]) < count[:, None]
    return np.where(inside, index, 0), inside


def _fitted(window: _Window, sums: _Sums, mean: float):
    """What `Surface` holds."""
    n = len(_TERMS)
    # Of pairs of terms, an array over the places each.
    gram, squares = (
        [[each[:, a + c, b + d] for c, d in _TERMS] for a, b in _TERMS]
        for each in (sums.powers, sums.squares)
    )
    factors, told = _factors(gram)
    # Two curves more than one, or the quadratic part across them is not told.
    told &= (sums.count >= n + _SPARE) & (window.high - window.low >= 3)
    zero, one = np.zeros(len(told)), np.ones(len(told))
    parts = [
        _solved(factors, [one if i == term else zero for i in range(n)])
        for term in (0, _MIXED)
    ]
    moments = [sums.moments[:, a, b] for a, b in _TERMS]
    value, mixed = (sum(a * b for a, b in zip(p, moments, strict=True)) for p in parts)
    gains = [
        np.sqrt(np.abs(sum(p[i] * squares[i][j] * p[j] for i, j in np.ndindex(n, n))))
        for p in parts
    ]
    cell = window.wide * window.long
    out = (mean + value, mixed / cell, gains[0], gains[1] / cell, parts[0][0])
    return np.where(told, np.stack(out), np.nan)


def _factors(gram):
    """L and D of each L D L', and whether they tell all terms apart. By hand over all
    places together: for six unknowns a library's call for each place would take most of
    the time."""
    lower, pivots, told = {}, [], np.ones(len(gram[0][0]), bool)
    for j in range(len(gram)):
        pivot = gram[j][j] - sum(lower[j, k] ** 2 * pivots[k] for k in range(j))
        told &= pivot > _LEAST * gram[j][j]
        pivots.append(np.where(told, pivot, 1.0))
        for i in range(j + 1, len(gram)):
            known = sum(lower[i, k] * lower[j, k] * pivots[k] for k in range(j))
            lower[i, j] = (gram[i][j] - known) / pivots[j]
    return (lower, pivots), told


def _solved(factors, right):
    """The solution for one right side."""
    lower, pivots = factors
    out = []
    for i, each in enumerate(right):
        out.append(each - sum(lower[i, k] * out[k] for k in range(i)))
    out = [each / pivot for each, pivot in zip(out, pivots, strict=True)]
    for i in reversed(range(len(out))):
        out[i] = out[i] - sum(lower[k, i] * out[k] for k in range(i + 1, len(out)))
    return out
