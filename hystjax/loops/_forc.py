"""First-order reversal curves: files of them, and their drift; their distribution, by
local regression on the fields that were measured; and a Preisach model from them."""

import os
import re
from collections.abc import Sequence

import equinox as eqx
import numpy as np
from jaxtyping import Bool, Float, Int

from .._core import checks
from .._core.checks import InputError
from .._core.files import path_of
from .._core.show import as_factor, quantity
from ..models import Preisach
from ..recording import Recording, forc_table
from ..recording._notation import to_si
from ..simulation import simulate
from ._surface import NEEDED, Curves, as_curves, steps_of, surface

_MU0 = 4e-7 * np.pi
_BACK = 0.5  # typical steps by which the field falls back at least between curves
_GAP = 3.0  # by which it rises to a point that is measured before the next curve


def read_forc(path: str | os.PathLike, *, drift: bool = True) -> Curves:
    """Read a file of first-order reversal curves.

    What is read: MicroMag 2900/3900 (Princeton Measurements, Lake Shore), in hybrid SI,
    SI or cgs; tables of Lake Shore's 8600 series, below `##DATA TABLE`; and columns of
    text, the first two field and moment unless a header names them, as with these
    words, H or B, and M, curves apart by blank lines or by where the field falls back.

    Where a single point was measured before each curve, drift is corrected by it: the
    moments are divided by what these points, joined by straight lines in the order of
    measurement, are of their mean.

    **Arguments:** the file; `drift`, whether to correct for it.

    **Returns:** `Curves`, fields in T (µ0 H) and moments in A m² where the file tells
    its units.

    **Raises:** `InputError`, with what is wrong: no such file, a table cut short or
    without its footer, units that contradict each other, curves that are missing or too
    few, or run downwards.
    """
    checks.answers(drift=drift)
    table = forc_table(path_of(path))
    parts, points = _with_calibration(table.segments)
    if table.promised is not None and len(parts) != table.promised:
        raise InputError(
            f"{path} holds {len(parts)} reversal curves where its header promises "
            f"{table.promised} (`NForc`). Some are missing, or other segments are "
            "among them; measure or cut it again."
        )
    if drift and points is not None:
        parts = _without_drift(parts, points)
    field_unit, moment_unit = table.units
    to_tesla, field_unit = _tesla(field_unit)
    moment_unit, to_moment = to_si(_spelt(moment_unit))
    scaled = [(to_tesla * part[:, 0], to_moment * part[:, 1]) for part in parts]
    return Curves(scaled, (field_unit, moment_unit))


def _with_calibration(segments):
    """The curves, and the points measured before each if there are any."""
    if len(segments) == 1:
        segments = _cut(segments[0])
    before = segments[0::2]
    if len(segments) % 2 == 0 and all(len(each) == 1 for each in before):
        return segments[1::2], np.array([each[0, 1] for each in before])
    return segments, None


def _cut(points):
    """Runs of rising field of one long table."""
    steps = np.diff(points[:, 0])
    if not np.any(steps > 0):
        return [points]
    step = np.median(steps[steps > 0])
    ends = np.flatnonzero(steps < -_BACK * step) + 1
    # A point far above each curve, where there is one above the first curve too,
    # belongs to the next curve.
    last = ends[1:] - 2
    if last.size and ends[0] == 1:
        others = np.delete(steps, last)
        if np.min(steps[last]) > max(_GAP * step, np.max(others)):
            ends = np.union1d(ends, last + 1)
    return np.split(points, ends)


def _without_drift(parts, points):
    mean = np.mean(points)
    later = np.append(points[1:], points[-1])
    out = []
    for part, now, then in zip(parts, points, later, strict=True):
        share = np.arange(1, len(part) + 1) / (len(part) + 1)
        level = now + share * (then - now)
        out.append(np.stack([part[:, 0], part[:, 1] * mean / level], axis=1))
    return out


def _tesla(unit: str) -> tuple[float, str]:
    """What fields in a unit are multiplied by to be µ0 H in T, and the unit then."""
    name, factor = to_si(_spelt(unit))
    if name == "A/m":
        return _MU0 * factor, "T"
    return factor, name


def _spelt(unit: str) -> str:
    """A unit as `to_si` knows it; square metres are written in many ways."""
    return re.sub(r"A[ ·*]?m(²|\^?2)", "A m²", re.sub(r"\s+", " ", unit))


_CANDIDATES = (2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0)
_TRIED = 3000  # points on which smoothings are compared


class Varying(eqx.Module):
    """A smoothing that grows away from either axis of the diagram, and that may differ
    along Hc and Hu: narrow in Hu near Hu = 0, where a central ridge is sharp, and wide
    in Hc, along which it is smooth.

    **Attributes:** each a number, or a pair of them, along Hc and along Hu.

    - `least`: the smoothing along Hc at Hc = 0, and along Hu at Hu = 0; 1 or more.
    - `growth`: by how much that along Hc grows for each step of the field in Hc, and
        that along Hu for each in Hu. With √2 a side that has come over an axis stays
        there.
    - `most`: what they grow to, from `least` on.

    The rectangle lies along Hc and Hu. Of smoothings a and b it is √2 (a + 1/2) by
    √2 (b + 1/2) steps, and holds (2 a + 1) (2 b + 1) points, as that of one number does
    where both are that. Where it would reach beyond the lowest or the highest reversal
    field, one of as large an area along Ha and Hb takes its place: cut slantwise it
    would take what depends on the field alone, such as the branch of a loop, for a
    density.

    **Raises:** `InputError` for other numbers, naming the attribute.

    **Source:** Egli (2013), VARIFORC, doi 10.1016/j.gloplacha.2013.08.003, of which
    `least`, `growth` and `most` are the limits at ridges, the rate of increase, and the
    limits elsewhere, which here grow no more.
    """

    least: float | tuple[float, float] = 3.0
    growth: float | tuple[float, float] = (0.06, 0.2)
    most: float | tuple[float, float] = 9.0

    def __check_init__(self):
        least, growth, most = (
            _pair(name, getattr(self, name)) for name in ("least", "growth", "most")
        )
        for name, found, limit in (
            ("least", least, 1.0),
            ("growth", growth, 0.0),
            ("most", most, least),
        ):
            last = name == "most"  # which need not end
            if not np.all((found >= limit) & (last | np.isfinite(found))):
                wanted = "`least` or more" if last else f"{limit:g} or more, and finite"
                raise InputError(
                    f"`{name}` must be {wanted}, got {getattr(self, name)!r}."
                )

    def at(self, distance: Float[np.ndarray, "2 q"]) -> Float[np.ndarray, "2 q"]:
        """Smoothings along Hc and Hu, at distances from their axes in steps."""
        least, growth, most = (
            _pair("", each)[:, None] for each in (self.least, self.growth, self.most)
        )
        return np.minimum(least + growth * distance, most)


def _pair(name: str, value) -> Float[np.ndarray, " 2"]:
    """A number along both axes, or one along each."""
    try:
        return np.broadcast_to(np.asarray(value, np.float64), (2,))
    except (TypeError, ValueError):
        raise InputError(
            f"`{name}` must be a number, or a pair of them along Hc and along Hu, got "
            f"{value!r}."
        ) from None


class Forc(eqx.Module):
    """The distribution -1/2 ∂²M / ∂Ha ∂Hb of first-order reversal curves.

    **Attributes:**

    - `hc`: coercivities (Hb - Ha) / 2, shape (k,), from 0.
    - `hu`: interaction fields (Ha + Hb) / 2, shape (l,); the bias of a switching unit.
        Some authors give it the other sign, or call it Hi or Hb.
    - `density`: shape (l, k), moment per field squared; NaN where nothing was measured.
    - `error`: its standard error.
    - `smoothing`: along Hc and along Hu, shape (2, l, k); the same but for a `Varying`
        one, of which each axis has its own, also where a rectangle is along Ha and Hb.
    - `step`: of the field, by which smoothings count.
    - `noise`: standard deviation of the moments about the surface.
    - `compared`: smoothings that were compared, and for each the root mean square error
        at points left out one by one; empty where one was given.
    - `units`: of fields and moments.
    """

    hc: Float[np.ndarray, " k"]
    hu: Float[np.ndarray, " l"]
    density: Float[np.ndarray, "l k"]
    error: Float[np.ndarray, "l k"]
    smoothing: Float[np.ndarray, "2 l k"]
    step: float
    noise: float
    compared: dict[float, float]
    units: tuple[str, str] = eqx.field(static=True)

    @property
    def significance(self) -> Float[np.ndarray, "l k"]:
        """The density in standard errors; beyond 3 hardly by chance at one place."""
        return self.density / self.error

    @property
    def density_unit(self) -> str:
        """Such as `A m²/T²`; none where that of fields or of moments is not known."""
        field, moment = self.units
        return f"{moment}/{as_factor(field)}²" if field and moment else ""

    @property
    def smoothed(self) -> str:
        """The smoothing in words: one, or from the least to the most of each axis."""
        ranges = [
            f"{np.nanmin(each):g}"
            if np.nanmin(each) == np.nanmax(each)
            else f"{np.nanmin(each):g} to {np.nanmax(each):g}"
            for each in self.smoothing
        ]
        if np.array_equal(*self.smoothing, equal_nan=True):
            return ranges[0]
        return f"{ranges[0]} in Hc and {ranges[1]} in Hu"

    @property
    def inner(self) -> Bool[np.ndarray, " k"]:
        """Which coercivities are beyond the ridge at Hc 0, which is what is reversible;
        all where nothing is known there."""
        beyond = self.hc > np.nanmax(self.smoothing[0]) * self.step
        known = np.any(np.isfinite(self.density), axis=0)
        return beyond | (not np.any(beyond & known))

    def __str__(self) -> str:
        known = np.isfinite(self.density)
        if not np.any(known):
            return f"distribution on {len(self.hc)} x {len(self.hu)} fields, none known"
        seen = np.where(self.inner & known, self.density, -np.inf)
        top = np.unravel_index(np.argmax(seen), seen.shape)
        where = quantity(self.hu[top[0]], self.units[0])
        return (
            f"distribution on {len(self.hc)} x {len(self.hu)} fields, smoothing "
            f"{self.smoothed}; largest at Hc {self.hc[top[1]]:.4g}, Hu {where}, "
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
    measured, which need not be even. Nothing is extrapolated by more than a step of the
    field: at the edges rectangles hold fewer points, and errors grow. These are of
    noise; by how much smoothing flattens a peak is not in them.

    **Arguments:**

    - `curves`: what `read_forc` returned, or recordings, one a curve.
    - `smoothing`: half the width of a rectangle along both fields, in steps, less a
        half: SF of Pike et al. Several are compared by leaving out points one by one,
        which the diagonal of the hat matrix does without a fit each; of those within
        one standard error of the best, the smoothest is taken. By default 2 to 8; or a
        `Varying` one, of a rectangle along Hc and Hu.
    - `weights`: `"equal"`, of all points in the rectangle; or `"tricube"`, which fall
        to zero at the ellipse inside of it: less noise is smoothed away, and no point
        enters at once. Where the lowest or the highest reversal field cuts an ellipse,
        what depends on the field alone, such as the branch of a loop, is taken for some
        density, as it is not by equal weights.
    - `hc`, `hu`: the axes, rising; by default by steps of the field, Hc over all that
        was measured and Hu as far down as up.

    **Returns:** `Forc`.

    **Raises:** `InputError` for a smoothing below 1, or whose rectangles all hold too
    few points; for other weights, axes that are not finite or do not rise, what are no
    curves, or curves of one point each or of one reversal field.

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
    hc = axis[0] if hc is None else _axis("hc", hc)
    hu = axis[1] if hu is None else _axis("hu", hu)
    across, along = np.meshgrid(hc, hu)
    ha, hb = (along - across).ravel(), (along + across).ravel()
    half = _half(chosen, ha, hb, steps)
    found = surface(points, ha, hb, half, tricube)
    mixed = np.where(_measured(points, ha, hb), found.mixed, np.nan)
    noise = _noise(points, chosen, steps, tricube)
    shape = across.shape
    return Forc(
        hc,
        hu,
        (-mixed / 2).reshape(shape),
        np.where(np.isfinite(mixed), noise * found.mixed_gain / 2, np.nan).reshape(
            shape
        ),
        np.where(np.isfinite(mixed), half, [[np.nan], [np.nan]]).reshape(2, *shape),
        float(max(steps)),
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


def _half(smoothing, ha, hb, steps) -> Float[np.ndarray, "*axes q"]:
    if isinstance(smoothing, Varying):
        return smoothing.at(np.abs([hb - ha, ha + hb]) / 2 / max(steps))
    return np.full(len(ha), float(smoothing))


def _chosen(curves: Curves, smoothing, steps, tricube):
    """The smoothing, and what it was compared with."""
    if isinstance(smoothing, Varying):
        return smoothing, {}
    given = _numbers(_CANDIDATES if smoothing is None else smoothing)
    if len(given) == 1:
        return given[0], {}
    squares = {each: _left_out(curves, each, steps, tricube) ** 2 for each in given}
    # Of small ones rectangles may hold too few points for any fit.
    squares = {each: s for each, s in squares.items() if np.any(np.isfinite(s))}
    if not squares:
        raise _too_few(curves, given)
    # On the same points for all, or a wide window would be judged on fewer.
    both = np.all(np.isfinite(np.stack(list(squares.values()))), axis=0)
    compared = {each: float(np.sqrt(np.mean(s[both]))) for each, s in squares.items()}
    best = min(compared, key=lambda each: compared[each])
    spread = np.std(squares[best][both]) / np.sqrt(both.sum())
    limit = np.sqrt(compared[best] ** 2 + spread)
    return max(each for each in compared if compared[each] <= limit), compared


def _too_few(curves: Curves, smoothing) -> InputError:
    return InputError(
        f"no rectangle of the smoothing {smoothing} holds {NEEDED} points that tell a "
        f"quadratic, of the {len(curves.field)} of these {len(curves)} curves. Take a "
        "larger `smoothing`, or curves of more points."
    )


def _numbers(smoothing) -> list[float]:
    given = np.atleast_1d(smoothing)
    numbers = given.dtype.kind in "iuf" and given.ndim == 1 and given.size
    if not (numbers and np.all(np.isfinite(given)) and np.min(given) >= 1):
        raise InputError(
            f"`smoothing` must be 1 or more, and finite, got {smoothing!r}."
        )
    return given.astype(float).tolist()


def _axis(name: str, values) -> Float[np.ndarray, " k"]:
    axis = np.asarray(values)
    if (
        axis.dtype.kind not in "iuf"
        or axis.ndim != 1
        or not len(axis)
        or not np.all(np.isfinite(axis))
        or not np.all(np.diff(axis) > 0)
    ):
        raise InputError(
            f"`{name}` must be a column of finite fields that rise, one or more, got "
            f"{values!r}."
        )
    return axis.astype(np.float64)


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
    if not np.any(known):
        raise _too_few(curves, smoothing)
    return float(np.sqrt(np.mean(left[known] ** 2 / spread[known])))


_LEVELS = 250
_SMOOTHING = 2.0
_FACTORS = 2 ** np.arange(11)  # of the smoothing, by which points are looked for
_NEAR = 4  # of these the largest, where a moment of another curve would do


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

    **Raises:** as `forc` does, and for too few points.

    **Source:** Everett (1955), doi 10.1039/TF9555101551; identification from reversal
    curves as in Mayergoyz (1986), doi 10.1103/PhysRevLett.56.1518.
    """
    points = as_curves(curves)
    (smoothing,) = _numbers(checks.number("smoothing", smoothing))
    checks.count("levels", levels, 2)
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
    # At the edges too few points may be near: then more are looked for; and from
    # farther yet for a field at which nothing is known, as where few curves begin.
    found = np.full(len(a), np.nan)
    for factor in _FACTORS:
        missing = ~np.isfinite(found) & _measured(curves, nodes[a], nodes[b])
        if factor > _NEAR:
            missing &= ~np.isin(b, b[np.isfinite(found)])
        missing = np.flatnonzero(missing)
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
    if not np.all(np.isfinite(out)):
        raise InputError(
            f"{len(curves)} curves of {len(curves.field)} points do not tell the "
            "moments at all fields between them. Give more curves, or more points of "
            "each."
        )
    return out


def _measured(curves: Curves, ha, hb) -> Bool[np.ndarray, " q"]:
    """Whether places lie within what was measured, but for a step."""
    first, last = curves.field[curves.starts[:-1]], curves.field[curves.starts[1:] - 1]
    step = max(steps_of(curves))
    curve = np.clip(np.searchsorted(first, ha), 0, len(first) - 1)
    inside = (ha >= first[0] - step) & (ha <= first[-1] + step) & (hb >= ha - step)
    return inside & (hb <= np.maximum(last[curve], last[curve - 1]) + step)


def left_out(
    curves: Curves | Sequence[Recording], *, every: int = 10, levels: int = _LEVELS
) -> float:
    """How a Preisach model of some curves predicts the others: the root mean square
    error on every so-many-th curve, which it has not seen, over the standard deviation
    of their moments.

    **Raises:** `InputError` where half of `every` curves are there, or fewer, of which
    none is left out.
    """
    points, every = as_curves(curves), checks.whole("every", every)
    out = np.arange(every // 2, len(points), max(every, 1))
    if every < 2 or len(out) == 0:
        raise InputError(
            f"of {len(points)} curves no one in {every} can be left out; `every` must "
            "be 2 or more, and less than twice as many."
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
