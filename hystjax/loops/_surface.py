"""First-order reversal curves as points, and local regression: quadratics fitted to
them around many places."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from .._core import checks
from .._core.checks import InputError
from .._core.compiling import jit, side_by_side
from ..recording import Recording
from ..recording._recording import Column, pair_of

_FEWEST = 3  # curves, for a parabola over reversal fields


class Curves(eqx.Module):
    """First-order reversal curves, as points: each curve was measured with rising
    field, after the field had come down from saturation to the curve's reversal field.

    **Attributes:** curves are in order of their reversal fields, each by rising field.

    - `reversal`: of each point, the reversal field of its curve, shape (n,).
    - `field`: shape (n,), in `units[0]`.
    - `moment`: shape (n,), in `units[1]`.
    - `starts`: the first point of each curve, and n, shape (c + 1,).
    - `units`: of fields and moments; files give T, for µ0 H, and A m².

    **Raises:** `InputError` for fewer than three curves, or a curve whose field falls.
    """

    reversal: Float[np.ndarray, " n"]
    field: Float[np.ndarray, " n"]
    moment: Float[np.ndarray, " n"]
    starts: Int[np.ndarray, " c"]
    units: tuple[str, str] = eqx.field(static=True)

    def __init__(
        self,
        parts: Sequence[tuple[Column, Column]],
        units: tuple[str, str] = ("T", "A m²"),
    ):
        """**Arguments:** field and moment of each curve, in any order; their units."""
        checks.concrete("`hystjax.loops`", parts)
        try:
            columns = [
                (np.asarray(field, np.float64), np.asarray(moment, np.float64))
                for field, moment in parts
            ]
        except (TypeError, ValueError):
            raise InputError(
                "`parts` must be pairs of columns, the field and the moment of each "
                f"curve, got {checks.described(parts)}; `read_forc` reads a file."
            ) from None
        if len(columns) < _FEWEST:
            raise InputError(
                f"a diagram needs {_FEWEST} reversal curves or more, got "
                f"{len(columns)}. Curves are told apart by blank lines, or by where "
                "the field falls."
            )
        for number, (field, moment) in enumerate(columns, 1):
            if field.shape != moment.shape or field.ndim != 1 or not len(field):
                raise InputError(
                    f"curve {number} must have as many moments as fields, one or more; "
                    f"got shapes {field.shape} and {moment.shape}."
                )
            if not (np.all(np.isfinite(field)) and np.all(np.isfinite(moment))):
                raise InputError(f"curve {number} holds NaN or inf; remove such rows.")
            if field[-1] < field[0]:
                raise InputError(
                    f"the field falls along curve {number}, from {field[0]:g} to "
                    f"{field[-1]:g}. Reversal curves are measured with rising field; "
                    "turn falling ones round by the signs of field and moment."
                )
        # Stable, so that noise in the field does not mix equal ones.
        sorted_parts = [
            (field[order], moment[order])
            for field, moment in columns
            for order in [np.argsort(field, kind="stable")]
        ]
        sorted_parts.sort(key=lambda part: part[0][0])
        lengths = [len(field) for field, _ in sorted_parts]
        self.starts = np.concatenate([[0], np.cumsum(lengths)]).astype(int)
        self.reversal = np.repeat([field[0] for field, _ in sorted_parts], lengths)
        self.field = np.concatenate([field for field, _ in sorted_parts])
        self.moment = np.concatenate([moment for _, moment in sorted_parts])
        self.units = pair_of("units", units)

    def __len__(self) -> int:
        return len(self.starts) - 1

    def pick(self, numbers: Sequence[int] | np.ndarray) -> "Curves":
        """Some of the curves, by their numbers from 0 in the order of reversal fields.

        **Raises:** `InputError` for other numbers, and as `Curves` does.
        """
        chosen = np.asarray(numbers)
        whole = chosen.dtype.kind in "iu" and chosen.ndim == 1
        if not (whole and np.all((chosen >= 0) & (chosen < len(self)))):
            raise InputError(
                "`numbers` must be a list of curves by their numbers, from 0 to "
                f"{len(self) - 1}; got {numbers!r}."
            )
        slices = [slice(self.starts[i], self.starts[i + 1]) for i in chosen]
        return Curves([(self.field[s], self.moment[s]) for s in slices], self.units)


def as_curves(curves: Curves | Sequence[Recording]) -> Curves:
    """Curves, or recordings of one curve each.

    **Raises:** `InputError` for anything else, or recordings of different units.
    """
    if isinstance(curves, Curves):
        return curves
    recordings = list(curves) if isinstance(curves, Sequence) else []
    if not recordings or not all(isinstance(each, Recording) for each in recordings):
        raise InputError(
            "`curves` must be what `hystjax.loops.read_forc` returns, or a list of "
            f"recordings, one a curve; got {type(curves).__name__}."
        )
    checks.concrete("`hystjax.loops.forc`", recordings)
    units = {each.units for each in recordings}
    if len(units) > 1:
        raise InputError(
            f"the curves have different units: {sorted(units)}. Convert them first."
        )
    return Curves([(each.u, each.w) for each in recordings], units.pop())


_TERMS = ((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2))  # powers of both fields
_MIXED, _SECOND = 4, 5  # of these, the mixed one and the second power of Hb
NEEDED = len(_TERMS) + 4  # points, for a fit with something to spare
_LEAST = 1e-6  # of a term, which the terms before it must leave unexplained
_SAME = 1e-9  # of a half width, within which fields are one
_BLOCK = 4096  # places fitted by one call
_FAR = 1e20  # times all fields; its powers are numbers, and without weight nothing
_WHOLE = 1e6  # times all fields, a half width to which all points are equally near
_BUCKETS = 10_000  # of fields, at most


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
    """Typical steps of the reversal field, and of the field along a curve.

    **Raises:** `InputError` where one of them is none.
    """
    first = curves.field[curves.starts[:-1]]
    along = np.diff(curves.field)
    inner = np.ones(len(along), bool)
    inner[curves.starts[1:-1] - 1] = False
    steps = np.median(np.diff(first)), np.median(along[inner]) if np.any(inner) else 0.0
    for step, what in zip(
        steps, ("reversal field", "field along a curve"), strict=True
    ):
        if not step > 0:
            raise InputError(
                f"the {what} does not change, typically, so that nothing can be told "
                f"of its {len(curves)} curves. Remove curves of one point, and such as "
                "were measured again."
            )
    return float(steps[0]), float(steps[1])


def surface(
    curves: Curves,
    ha: Float[np.ndarray, " q"],
    hb: Float[np.ndarray, " q"],
    smoothing: Float[np.ndarray, "*axes q"],
    tricube: bool = False,
) -> Surface:
    """Local quadratics at places (Ha, Hb), each in a rectangle along both fields of a
    smoothing of its own; or of two, shape (2, q), in a rectangle along Hc and Hu where
    no reversal field is missing for it.

    Around each place a window of as many curves, and points of each, as any place may
    need is cut out of all points; those that are not near have no weight. So all
    places share one program.
    """
    steps = steps_of(curves)
    tilted = smoothing.ndim == 2
    # Powers of shares of a width that is far larger than this would be 0.
    whole = _WHOLE * np.ptp(curves.field) / min(steps)
    half = np.minimum(smoothing + 0.5, whole)
    first, rim = curves.field[curves.starts[:-1]], _rim(tricube)
    wide, long, tilt = (
        _tilted(half, steps, ha, first) if tilted else _upright(half, steps)
    )
    low = np.searchsorted(first, ha - rim * wide)
    everywhere = _Places(ha, hb, wide, long, tilt, low)
    most = [rim * np.max(each, initial=0.0) for each in (wide, long)]

    def fitted(begun: int) -> np.ndarray:
        # Of one length, or what is left over would be compiled apart.
        rows = np.resize(np.arange(len(ha))[begun : begun + _BLOCK], _BLOCK)
        places = _Places(*(each[rows] for each in everywhere))
        sums = _summed(points, places, size, tricube, tilted)
        return np.asarray(_solved(places, sums))

    out = np.empty((len(Surface._fields), len(ha)))
    # Differences of sums of 4th powers need all digits, whatever else is computed in.
    with jax.enable_x64(True):
        points, size = _points(curves, steps[1], *most)
        for begun, found in side_by_side(fitted, range(0, len(ha), _BLOCK)):
            out[:, begun : begun + _BLOCK] = found[:, : len(ha) - begun]
    found = Surface(*out)
    return found._replace(moment=curves.moment.mean() + found.moment)


def _upright(half, steps: tuple[float, float]):
    """What `_Places` calls `wide`, `long` and `tilt`, by half widths in steps."""
    return half * steps[0], half * steps[1], np.zeros(len(half))


def _tilted(half, steps: tuple[float, float], ha, first):
    # Along diagonals of squares of steps: so as many points are near as of an upright
    # rectangle.
    across, along = half * max(steps) / np.sqrt(2)
    narrow = np.minimum(across, along)
    tilted = across + along, 2 * narrow, np.where(along <= across, 1.0, -1.0)
    # What depends on Hb alone has no mixed derivative. Where the lowest or the highest
    # curve cuts a tilted rectangle slantwise, a fit finds one; in an upright one not.
    cut = (ha - tilted[0] < first[0]) | (ha + tilted[0] > first[-1])
    upright = _upright(np.sqrt(np.prod(half, axis=0)), steps)
    return tuple(np.where(cut, *pair) for pair in zip(upright, tilted, strict=True))


def _rim(tricube: bool) -> float:
    """How far, in half widths, points are near. Those on the rim itself weigh nothing,
    or as much as others, however their fields are rounded."""
    return 1 - _SAME if tricube else 1 + _SAME


class _Places(NamedTuple):
    """Places; half widths of the windows around them, `wide` in Ha and `long` on each
    curve; and the first curve of each.

    The rectangle in a window is all of it where `tilt` is 0. Of one along Hc and Hu the
    window is the strip between its long sides, which lies lower by `tilt` times Ha: 1
    where it is narrow in Hu, -1 where in Hc.
    """

    ha: Float[np.ndarray, " q"]
    hb: Float[np.ndarray, " q"]
    wide: Float[np.ndarray, " q"]
    long: Float[np.ndarray, " q"]
    tilt: Float[np.ndarray, " q"]
    low: Int[np.ndarray, " q"]


class _Points(NamedTuple):
    """Reversal fields of the curves; field and moment, less its mean, of all points,
    those of each curve followed by some that are infinitely far, which windows reach
    into; and the first point of each curve in or after each bucket of fields, which
    begin at `origin` and are a `bucket` wide."""

    reversal: Float[Array, " c"]
    field: Float[Array, " p"]
    moment: Float[Array, " p"]
    begun: Int[Array, "c b"]
    origin: Float[Array, ""]
    bucket: Float[Array, ""]


def _points(
    curves: Curves, step: float, wide: float, long: float
) -> tuple[_Points, tuple[int, int]]:
    """What windows are cut out of, and how many curves, and points of each, those of
    such half widths may hold."""
    n = len(curves)
    first = curves.field[curves.starts[:-1]]
    beyond = np.searchsorted(first, first + 2 * wide, side="right")
    across = int(np.max(beyond - np.arange(n)))

    # Where a window begins on a curve is looked up, which is faster than a search for
    # each curve of each place.
    origin, extent = curves.field.min(), np.ptp(curves.field)
    bucket = max(step / 2, extent / _BUCKETS)
    row = np.repeat(np.arange(n), np.diff(curves.starts))
    column = np.floor((curves.field - origin) / bucket).astype(int)
    m = np.max(column) + 1
    count = np.bincount(row * m + column, minlength=n * m).reshape(n, m)
    through = np.cumsum(count, axis=1)
    before = through - count
    last = np.arange(m) + int(np.ceil(2 * long / bucket))
    along = int(np.max(through[:, np.minimum(last, m - 1)] - before))

    starts = curves.starts[:-1] + along * np.arange(n)
    at = np.arange(len(row)) + along * row
    field = np.full(len(row) + along * n, _FAR * extent)
    moment = np.zeros(len(field))
    field[at], moment[at] = curves.field, curves.moment - curves.moment.mean()
    arrays = (first, field, moment, starts[:, None] + before, origin, bucket)
    return _Points(*map(jnp.asarray, arrays)), (across, along)


class _Sums(NamedTuple):
    """Sums over the points near each place: their `count`; of weights times x^j y^k,
    by (j, k), `powers`, and `moments`, times the moment less its mean; `squares`, like
    the first, of squared weights."""

    count: Float[Array, " q"]
    powers: dict[tuple[int, int], Float[Array, " q"]]
    squares: dict[tuple[int, int], Float[Array, " q"]]
    moments: dict[tuple[int, int], Float[Array, " q"]]


@jit
def _summed(
    points: _Points,
    places: _Places,
    size: tuple[int, int],
    tricube: bool,
    tilted: bool,
) -> _Sums:
    """`_Sums` over windows of one size."""

    def at(place: _Places) -> _Sums:
        # As many curves as a window holds, also at the end of all.
        low = jnp.minimum(place.low, len(points.reversal) - size[0])
        away = jax.lax.dynamic_slice(points.reversal, (low,), size[:1]) - place.ha
        bottom = place.hb - _rim(tricube) * place.long
        middle = place.hb
        if tilted:
            bottom, middle = (each - place.tilt * away for each in (bottom, middle))
            middle = middle[:, None]
        begun = _begun(points, low, bottom, size[0])
        cut = jax.vmap(jax.lax.dynamic_slice, (None, 0, None))
        field, moment = (
            cut(each, begun[:, None], size[1:])
            for each in (points.field, points.moment)
        )
        x = (away * (1 / place.wide))[:, None]
        y = (field - middle) * (1 / place.long)
        other = _along(place, x, y) if tilted else x
        return _sums(x, y, other, moment, tricube)

    return jax.vmap(at)(places)


def _begun(points: _Points, low, bottom, count: int) -> Int[Array, " c"]:
    """The first point of a window on each of its curves, which begins at one field or
    on each curve at one of its own."""
    bucket = jnp.floor((bottom - points.origin) / points.bucket)
    bucket = jnp.clip(bucket, 0, points.begun.shape[1] - 1).astype(int)
    if bucket.ndim:
        return points.begun[low + jnp.arange(count), bucket]
    return jax.lax.dynamic_slice(points.begun, (low, bucket), (count, 1))[:, 0]


def _along(place: _Places, x, y) -> Float[Array, "c k"]:
    """How far points are along the strip of a tilted rectangle, in half lengths, or
    from curve to curve where it is upright."""
    half = place.wide - place.long / 2
    along = (place.long * y / 2 - place.tilt * place.wide * x) * (1 / half)
    return jnp.where(place.tilt == 0, x, along)


def _sums(
    x: Float[Array, "c 1"],
    y: Float[Array, "c k"],
    other: Float[Array, "c _k"],
    moment: Float[Array, "c k"],
    tricube: bool,
) -> _Sums:
    """Of weights 1 where neither y nor the `other` coordinate is beyond 1, or tricube
    weights in the ellipse inside of this rectangle."""
    xx, yy = other**2, y**2
    far = xx + yy if tricube else jnp.maximum(xx, yy)
    near = jnp.where(far <= _rim(tricube) ** 2, 1.0, 0.0)
    weight = near * (1 - far * jnp.sqrt(far)) ** 3 if tricube else near
    # Along each curve first, where x is one number.
    along = _total(
        (
            [near],
            _powers(weight, y, 4),
            _powers(weight**2, y, 4),
            _powers(weight * moment, y, 2),
        ),
        axis=1,
    )
    products = [
        {
            (j, k): product
            for k, each in enumerate(sums)
            for j, product in enumerate(_powers(each, x[:, 0], len(sums) - 1 - k))
        }
        for sums in along
    ]
    count, *others = _total(products, axis=0)
    return _Sums(count[0, 0], *others)


def _powers(first: Array, x: Array, most: int) -> list[Array]:
    """An array times x^0 to x^most."""
    out = [first]
    for _ in range(most):
        out.append(out[-1] * x)
    return out


def _total(arrays: Any, axis: int) -> Any:
    """The sum of each array, of all in one pass: one by one, windows would be cut out
    for each again."""

    def add(a: Any, b: Any) -> Any:
        return jax.tree.map(jnp.add, a, b)

    zeros = jax.tree.map(lambda _: 0.0, arrays)
    return jax.lax.reduce(arrays, zeros, add, (axis,))


@jit
def _solved(places: _Places, sums: _Sums) -> Float[Array, "f q"]:
    """What `Surface` holds, moments less their mean."""
    n = len(_TERMS)
    # Of pairs of terms, an array over the places each.
    gram, squares = (
        [[each[a + c, b + d] for c, d in _TERMS] for a, b in _TERMS]
        for each in (sums.powers, sums.squares)
    )
    factors, told = _factors(gram)
    told &= sums.count >= NEEDED
    # y is Hb, and `tilt` times Ha, over `long`.
    mixed = {_MIXED: 1 / (places.wide * places.long)}
    mixed[_SECOND] = 2 * places.tilt / places.long**2
    parts = [
        _column(factors, [right.get(i, 0.0) for i in range(n)])
        for right in ({0: 1.0}, mixed)
    ]
    moments = [sums.moments[term] for term in _TERMS]
    found = [sum(a * b for a, b in zip(p, moments, strict=True)) for p in parts]
    found += [
        jnp.sqrt(jnp.abs(sum(p[i] * squares[i][j] * p[j] for i, j in np.ndindex(n, n))))
        for p in parts
    ]
    return jnp.where(told, jnp.stack([*found, parts[0][0]]), jnp.nan)


def _factors(gram):
    """L and D of each L D L', and whether they tell all terms apart. By hand over all
    places together: for six unknowns a library's call for each place would take most of
    the time."""
    lower, pivots, told = {}, [], True
    for j in range(len(gram)):
        pivot = gram[j][j] - sum(lower[j, k] ** 2 * pivots[k] for k in range(j))
        told &= pivot > _LEAST * gram[j][j]
        pivots.append(jnp.where(told, pivot, 1.0))
        for i in range(j + 1, len(gram)):
            known = sum(lower[i, k] * lower[j, k] * pivots[k] for k in range(j))
            lower[i, j] = (gram[i][j] - known) / pivots[j]
    return (lower, pivots), told


def _column(factors, right):
    """The solution for one right side."""
    lower, pivots = factors
    out = []
    for i, each in enumerate(right):
        out.append(each - sum(lower[i, k] * out[k] for k in range(i)))
    out = [each / pivot for each, pivot in zip(out, pivots, strict=True)]
    for i in reversed(range(len(out))):
        out[i] = out[i] - sum(lower[k, i] * out[k] for k in range(i + 1, len(out)))
    return out
