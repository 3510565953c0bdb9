"""What is fitted to cycles: backbones of cyclic tests and the two straight lines that
codes put in their place, losses by frequency, Steinmetz's law, and creep."""

import functools
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import equinox as eqx
import numpy as np
from jaxtyping import ArrayLike, Float

from .._core import checks
from .._core.checks import InputError
from ..recording import Recording, as_recording
from ..recording._notation import to_si
from ._corrections import check_finite, comes_back, in_si
from ._reversals import Reversals, found_in
from ._summary import summary

_FURTHER = 0.02  # share of an amplitude by which the next one is larger
_ELASTIC = 0.4  # of the peak, where the elastic stiffness is taken
_FAILED = 0.8  # of the peak, below which a specimen has failed
_NO_YIELD = 0.85  # of the peak, where no yield force has the energy
_AT_ZERO = 0.01  # share of its reach within which an input is at zero
_ROUNDING = 1e-9  # of the energy


class Backbone(eqx.Module):
    """Both sides of a backbone, from zero input outwards.

    **Attributes:** `u`, `w`, the points of the positive side, shapes (k,), and
    `u_negative`, `w_negative`, those of the other, shapes (l,); input and output units.
    A side to which the input does not come from zero has none.
    """

    u: Float[np.ndarray, " k"]
    w: Float[np.ndarray, " k"]
    u_negative: Float[np.ndarray, " l"]
    w_negative: Float[np.ndarray, " l"]

    def __str__(self) -> str:
        sides = ((self.u, self.w), (self.u_negative, self.w_negative))
        far = " and ".join(
            f"{len(u)} to ({u[-1]:.4g}, {w[-1]:.4g})" if len(u) else "none"
            for u, w in sides
        )
        return f"Backbone: points from zero input outwards, {far}"


class Bilinear(NamedTuple):
    """Two straight lines from the origin: stiffness `elastic` up to the point
    `u_yield`, `w_yield`, then `hardening`; `rmse`, what they miss, output units."""

    elastic: float
    hardening: float
    u_yield: float
    w_yield: float
    rmse: float


class Eeep(NamedTuple):
    """The elastic, then plastic curve of equal energy.

    **Attributes:** `elastic`, its stiffness; `u_yield`, `w_yield`, where it turns;
    `u_ultimate`, where it ends; `peak`, the largest output of the backbone; `energy`
    below that; `ductility`, ultimate over yield input.
    """

    elastic: float
    u_yield: float
    w_yield: float
    u_ultimate: float
    peak: float
    energy: float
    ductility: float


def backbone(
    recording: Recording,
    *,
    kind: str = "envelope",
    threshold: float | None = None,
    found: Reversals | None = None,
) -> Backbone:
    """The backbone of a cyclic test.

    **Arguments:**

    - `recording`: the test, with input and output from zero: see `centred`.
    - `kind`: `"envelope"`, the samples whose input lies further out than any before,
        on the way back to where repeated cycles ended too; `"first"`, the origin and
        the tips of the first cycle of each amplitude, those that reach further than any
        before.
    - `threshold`, `found`: as for `summary`; of `"first"` alone.

    A side begins where the input first comes to it from zero. One that is loaded second
    begins with what the other one has left: there the output of an envelope is not zero
    where the input is. Of cycles that are repeated the first one counts, also where a
    device hardens in the others, but for what is further out.

    **Raises:** `InputError` for another kind, for an input that comes from zero to no
    side, for turning points that an envelope does not ask for, and as `reversals` does.

    **Source:** ASTM E2126-19, 3.2.3, the envelope curve, and ASCE 41-17, 7.6.3, the
    backbone, are of first cycles: `kind="first"`.
    """
    if kind not in ("envelope", "first"):
        raise InputError(f'`kind` must be "envelope" or "first", got {kind!r}.')
    if kind == "envelope" and not (threshold is None and found is None):
        raise InputError(
            "`threshold` and `found` tell turning points, and an envelope is of all "
            'samples; leave them out, or ask for `kind="first"`.'
        )
    as_recording(recording, "backbone(recording)")
    checks.concrete("`hystjax.loops`", recording)
    u, w = np.asarray(recording.u, np.float64), np.asarray(recording.w, np.float64)
    if kind == "first":
        rows = found_in("backbone", recording, threshold, found).rows
        points = functools.partial(_first, rows)
    else:
        points = _envelope
    (right, up), (left, down) = (
        _side(points, sign * u, sign * w) for sign in (1.0, -1.0)
    )
    if len(right) < 2 and len(left) < 2:
        raise InputError(
            "the input comes from zero to no side; a backbone starts there: see "
            "`centred`."
        )
    return Backbone(right, up, -left, -down)


def _side(points, u, w):
    """The positive side, by what makes its points from a row on: the first one to which
    the input comes from zero, and not by noise."""
    near = _AT_ZERO * np.max(np.abs(u))
    begun = 0 < u[0] <= near
    starts = np.flatnonzero(np.append(begun, (u[:-1] <= 0) & (u[1:] > 0)))
    if not len(starts):
        return np.empty(0), np.empty(0)
    reached = np.maximum.reduceat(u, starts)
    return points(int(starts[np.argmax(reached > near)]), u, w)


def _first(rows, start, u, w):
    """The origin, and tips that lie further out than all before them."""
    tips, outs = [0.0], [0.0]
    for row in rows[rows >= start]:
        if u[row] > max(tips[-1] * (1 + _FURTHER), 0.0):
            tips.append(u[row])
            outs.append(w[row])
    return np.array(tips), np.array(outs)


def _envelope(start, u, w):
    """Samples whose input lies further out than all before them, from zero input on,
    where that is recorded."""
    new = start + np.flatnonzero(u[start:] > _farthest_before(u[start:]))
    if start == 0:
        return u[new], w[new]
    share = u[start - 1] / (u[start - 1] - u[start])
    at_zero = w[start - 1] + share * (w[start] - w[start - 1])
    return np.append(0.0, u[new]), np.append(at_zero, w[new])


def _farthest_before(u):
    """How far out the input was before each sample, at least zero."""
    return np.maximum.accumulate(np.concatenate([[0.0], u[:-1]]))


def _points(u, w):
    """One side of a backbone, as it must be."""
    u, w = _column("u", u), _column("w", w)
    if len(u) != len(w) or not len(u):
        raise InputError(
            "`u` and `w` must be columns of one length, one point or more; got shapes "
            f"{u.shape} and {w.shape}."
        )
    if np.min(u) < 0 < np.max(u):
        raise InputError(
            "`u` is on both sides of zero, and a fit is of one side of a backbone: "
            "give `found.u` and `found.w`, or `found.u_negative` and "
            "`found.w_negative`."
        )
    return u, w


def bilinear(u: Float[np.ndarray, " k"], w: Float[np.ndarray, " k"]) -> Bilinear:
    """The two lines from the origin that come closest to one side of a backbone, by
    least squares; of either sign.

    **Raises:** `InputError` for fewer than four points, or three different inputs; for
    a side that begins far from the origin, as one that is loaded second may; for both
    sides at once; for columns of different lengths, and what is not finite.
    """
    u, w = _points(u, w)
    _check_origin(u, w)
    knots = np.unique(np.abs(u))[1:-1]
    if len(u) < 4 or not len(knots):
        raise InputError(
            "a bilinear fit needs at least 4 points, of 3 different inputs, got "
            f"{len(u)} of {len(np.unique(np.abs(u)))}."
        )

    def fit(knot):
        columns = np.stack(
            [np.sign(u) * np.minimum(np.abs(u), knot), np.sign(u) * _beyond(u, knot)],
            axis=1,
        )
        slopes, *_ = np.linalg.lstsq(columns, w, rcond=None)
        return slopes, float(np.sum((w - columns @ slopes) ** 2))

    # For a given knot it is linear. The best one is at a sample, or where two lines
    # meet that are fitted to the samples on either side.
    knots = [*knots, *_meeting(np.abs(u), np.sign(u) * w)]
    (elastic, hardening), squares, knot = min(
        ((*fit(knot), knot) for knot in knots), key=lambda each: each[1]
    )
    sign = np.sign(u[np.argmax(np.abs(u))])
    return Bilinear(
        float(elastic),
        float(hardening),
        float(sign * knot),
        float(sign * elastic * knot),
        float(np.sqrt(squares / len(u))),
    )


def _meeting(x, y):
    """Where a line through the origin and one beyond it meet, which are fitted to what
    is below and to what is above, if that is where these are parted."""
    order = np.argsort(x, kind="stable")
    x, y = x[order], y[order]
    parted = 1 + np.flatnonzero(x[1:] > x[:-1])
    sums = np.cumsum([np.ones_like(x), x, y, x * x, x * y], axis=1)
    below = sums[:, parted - 1]
    count, sx, sy, sxx, sxy = sums[:, -1:] - below
    with np.errstate(divide="ignore", invalid="ignore"):
        elastic = below[4] / below[3]
        hardening = (count * sxy - sx * sy) / (count * sxx - sx**2)
        knots = (sy - hardening * sx) / count / (elastic - hardening)
    return knots[(knots >= x[parted - 1]) & (knots <= x[parted])]


def _check_origin(u, w):
    """Raise `InputError` for a side that is loaded where its input is zero."""
    first = np.argmin(np.abs(u))
    share = np.abs(w[first]) / (np.max(np.abs(w)) or 1.0)
    if np.abs(u[first]) <= _AT_ZERO * np.max(np.abs(u)) and share >= _ELASTIC:
        raise InputError(
            "the backbone does not begin at the origin: at zero input its output is "
            f"{100 * share:.0f} % of the largest one, left by the side that was loaded "
            'before. Take that of first cycles: `backbone(..., kind="first")`.'
        )


def _beyond(u, knot):
    return np.maximum(np.abs(u) - knot, 0.0)


def eeep(u: Float[np.ndarray, " k"], w: Float[np.ndarray, " k"]) -> Eeep:
    """The equivalent energy elastic-plastic curve of one side of a backbone, of either
    sign: as stiff as the backbone at 40 % of its peak, with as much energy up to where
    it falls below 80 % of the peak for good, or ends. A backbone that stiffens may have
    more energy than any yield force has: then that is taken for 85 % of the peak.

    **Raises:** `InputError` for a backbone that does not rise from the origin, or that
    leaps there; for both sides at once; for columns of different lengths, and what is
    not finite.

    **Source:** ASTM E2126-19, 9.1.4, and its failure limit state.
    """
    u, w = _points(u, w)
    sign = float(np.sign(u[np.argmax(np.abs(u))]))
    u, w = sign * u, sign * w
    order = np.argsort(u, kind="stable")
    u, w = u[order], w[order]
    top = int(np.argmax(w))
    peak = float(w[top])
    if peak <= 0 or u[top] <= 0 or w[0] >= _ELASTIC * peak:
        raise InputError(
            "the backbone does not rise from the origin: its output has no peak of the "
            f"input's sign, or begins above {100 * _ELASTIC:g} % of it, as where the "
            'other side was loaded before: see `backbone(..., kind="first")`.'
        )
    if u[0] > 0:  # from the origin, whose triangle is part of the energy
        u, w = np.append(0.0, u), np.append(0.0, w)
    # The last that carries so much: where it rings, or sticks and slips, it comes back.
    stop = int(np.flatnonzero(w >= _FAILED * peak)[-1]) + 1
    if stop < len(u):
        drop = (w[stop - 1] - _FAILED * peak) / (w[stop - 1] - w[stop])
        ultimate = float(u[stop - 1] + drop * (u[stop] - u[stop - 1]))
        u, w = np.append(u[:stop], ultimate), np.append(w[:stop], _FAILED * peak)
    ultimate = float(u[-1])
    rising = int(np.argmax(w >= _ELASTIC * peak))
    if u[rising] <= 0:
        raise InputError(
            f"the backbone reaches {100 * _ELASTIC:g} % of its peak before its input "
            "moves, so that it has no stiffness: leave the points at 0 out."
        )
    share = (_ELASTIC * peak - w[rising - 1]) / (w[rising] - w[rising - 1])
    soft = u[rising - 1] + share * (u[rising] - u[rising - 1])
    elastic = float(_ELASTIC * peak / soft)
    energy = float(np.trapezoid(w, u))
    inside = ultimate**2 - 2 * energy / elastic
    force = _NO_YIELD * peak
    if inside >= -_ROUNDING * ultimate**2:  # a straight line has no more than it can
        force = (ultimate - np.sqrt(max(inside, 0.0))) * elastic
    at = force / elastic
    return Eeep(
        elastic,
        float(sign * at),
        float(sign * force),
        sign * ultimate,
        sign * peak,
        energy,
        float(ultimate / at),
    )


if TYPE_CHECKING:
    import xarray

_TOLD = 1e-8  # of the largest singular value, which the least one exceeds


class Fit(NamedTuple):
    """Numbers of a fit by name, their standard errors, and the root mean square of what
    it leaves, in the unit of what was fitted, for `steinmetz` relative."""

    value: dict[str, float]
    error: dict[str, float]
    rmse: float


def least_squares(
    names: Sequence[str], columns: Float[np.ndarray, "n k"], y: Float[np.ndarray, " n"]
) -> Fit:
    """Linear least squares, with errors by what it leaves, NaN where nothing is.

    **Raises:** `InputError` where some of the numbers could be any.
    """
    # Columns of one size, so that their rank does not depend on units.
    scale = np.linalg.norm(columns, axis=0)
    scaled = columns / scale
    sizes = np.linalg.svd(scaled, compute_uv=False)
    if sizes[-1] < _TOLD * sizes[0]:
        raise InputError(
            f"these rows cannot tell {', '.join(f'`{name}`' for name in names)} apart: "
            "what they are multiplied by goes up and down together. Add rows in which "
            "it does not."
        )
    inverse = np.linalg.pinv(scaled) / scale[:, None]
    found = inverse @ y
    left = y - columns @ found
    free = len(y) - len(names)
    deviation = np.sqrt(left @ left / free) if free else np.nan
    errors = deviation * np.linalg.norm(inverse, axis=1)
    return Fit(
        dict(zip(names, found.tolist(), strict=True)),
        dict(zip(names, errors.tolist(), strict=True)),
        float(np.sqrt(np.mean(left**2))),
    )


def core_loss(
    recording: Recording,
    *,
    frequency: float | None = None,
    density: float | None = None,
    threshold: float | None = None,
) -> "xarray.Dataset":
    """What a core loses, from field strength and flux density, whichever is the input.

    **Arguments:**

    - `recording`: its units say which is which, such as `("A/m", "T")`; `Oe`, `G`, `mT`
        and others that `in_si` knows are converted.
    - `frequency`: cycles a second, Hz; by default that of the record's clock.
    - `density`: of the material, kg/m³, for losses per mass.
    - `threshold`: as for `reversals`, in the input's unit as it is recorded.

    **Returns:** an `xarray.Dataset` over `cycle`: `energy`, J/m³, with `energy_error`;
    `power`, W/m³, where a frequency is known; per mass `specific_energy`, J/kg, and
    `specific_power`, W/kg; `field` and `flux`, the amplitudes, half their ranges over
    the cycle, A/m and T; `coercivity`, A/m, and `remanence`, T, with errors.

    Warns of cycles that do not end at the amplitude at which they begin.

    **Raises:** `InputError` for other units, numbers that are not positive and finite,
    and as `summary` does.
    """
    import xarray

    for name, number in {"frequency": frequency, "density": density}.items():
        if number is not None:
            check_finite(name, number)
            checks.positive(name, number)
    record = _of_core(recording)
    _, factor = to_si(recording.units[0])
    if threshold is not None:
        threshold = factor * float(checks.number("threshold", threshold))
    found = found_in("core_loss", record, threshold, None)
    known = summary(record, found=found)
    _warn_of_open_loops(record, found)
    driven_by_field = record.units[0] == "A/m"
    # ∮ H dB: by parts, of B over H it is less than ∮ B dH by a sign. So are the axes'
    # openings of H over B, which then are each other's.
    sign = -1 if driven_by_field else 1
    energy = sign * known["energy"]
    # The output may be largest beside the tips of the input.
    sizes = known["amplitude"], known["peak_stiffness"] * known["amplitude"]
    pairs = sizes, ("coercivity", "remanence")
    (field, flux), (coercive, remanent) = (
        pair if driven_by_field else pair[::-1] for pair in pairs
    )
    out = {
        "energy": (energy, "J/m³"),
        "energy_error": (known["energy_error"], "J/m³"),
        "field": (field, "A/m"),
        "flux": (flux, "T"),
        "coercivity": (-sign * known[coercive], "A/m"),
        "coercivity_error": (known[f"{coercive}_error"], "A/m"),
        "remanence": (-sign * known[remanent], "T"),
        "remanence_error": (known[f"{remanent}_error"], "T"),
    }
    rate = 1 / known["period"] if frequency is None and record.clocked else frequency
    if rate is not None:
        out["power"] = (energy * rate, "W/m³")
    if density is not None:
        out["specific_energy"] = (energy / density, "J/kg")
    if density is not None and rate is not None:
        out["specific_power"] = (energy * rate / density, "W/kg")
    arrays = {
        name: value.drop_attrs().assign_attrs(units=unit)
        for name, (value, unit) in out.items()
    }
    return xarray.Dataset(arrays)


def _warn_of_open_loops(record: Recording, found: Reversals) -> None:
    """Warn of cycles that begin at one amplitude and end at another."""
    first, between, last = found.cycles.T
    back = comes_back(np.asarray(record.u), first, between, last)
    if not np.all(back):
        checks.warn(
            f"at the end of {np.sum(~back)} of {len(back)} cycles (the first is cycle "
            f"{1 + np.argmin(back)}) the input is not where it was at the beginning: "
            "closed by a straight line such a loop has an energy that is no loss, and "
            "may be negative. Give a `window` from a tip of a loop to the next such."
        )


def _of_core(recording: Recording) -> Recording:
    """A record of field strength and flux density, in A/m and T."""
    as_recording(recording, "core_loss(recording)")
    checks.concrete("`hystjax.loops.core_loss`", recording)
    record = in_si(recording)
    if sorted(record.units) != ["A/m", "T"]:
        raise InputError(
            "core losses need field strength (A/m) and flux density (T); the record's "
            f"units are {recording.units}. Give them: `Recording(..., "
            'units=("A/m", "T"))`.'
        )
    return record


def separate(
    frequency: ArrayLike | Sequence[float],
    energy: ArrayLike | Sequence[float],
    *,
    excess: bool = True,
) -> Fit:
    """Split energies a cycle, measured at several frequencies and one amplitude, into
    parts: static + classical f + excess √f, by least squares.

    **Arguments:** frequencies, Hz, and energies a cycle, both of shape (k,); `excess`
    `False` leaves the last part out.

    **Returns:** `static`, in the unit of the energies; `classical`, that times s;
    `excess`, that times √s. With as many frequencies as parts, errors are NaN.

    **Raises:** `InputError` for fewer different frequencies than parts, or numbers that
    are not positive and finite.

    **Source:** Bertotti (1988), doi 10.1109/20.43994.
    """
    checks.answers(excess=excess)
    names = ["static", "classical", *(["excess"] if excess else [])]
    f, y = _columns(len(names), frequency=frequency, energy=energy)
    if (count := len(np.unique(f))) < len(names):
        raise InputError(
            f"`frequency` has {count} different values, and {len(names)} parts need "
            f"{len(names)} or more. Measure at others"
            f"{', or leave out the last part: `excess=False`' if excess else ''}."
        )
    columns = np.stack([np.ones_like(f), f, np.sqrt(f)], axis=1)[:, : len(names)]
    return least_squares(names, columns, y)


def steinmetz(
    frequency: ArrayLike | Sequence[float],
    flux: ArrayLike | Sequence[float],
    power: ArrayLike | Sequence[float],
) -> Fit:
    """Steinmetz's law, power = k f^alpha B^beta, by least squares of the logarithms.

    **Arguments:** frequencies, Hz, amplitudes of the flux density, T, and powers, each
    of shape (n,).

    **Returns:** `k`, in the unit of the powers at 1 Hz and 1 T, `alpha` and `beta`.

    **Raises:** `InputError` for fewer than three rows, numbers that are not positive
    and finite, only one frequency or amplitude, or amplitudes that are a power of the
    frequency.

    **Source:** Steinmetz (1892), doi 10.1109/T-AIEE.1892.5570437.
    """
    f, b, p = _columns(3, frequency=frequency, flux=flux, power=power)
    for name, each in {"frequency": f, "flux": b}.items():
        if np.ptp(each) == 0:
            raise InputError(
                f"all of `{name}` are {each[0]:g}: no exponent can be told from one."
            )
    columns = np.stack([np.ones_like(f), np.log(f), np.log(b)], axis=1)
    fit = least_squares(["k", "alpha", "beta"], columns, np.log(p))
    k = float(np.exp(fit.value["k"]))
    return Fit(fit.value | {"k": k}, fit.error | {"k": k * fit.error["k"]}, fit.rmse)


def _columns(least: int, **given: ArrayLike | Sequence[float]):
    """Columns of positive numbers, of one length."""
    columns = {}
    for name, values in given.items():
        columns[name] = _column(name, values)
        checks.positive(name, columns[name])
    lengths = {name: len(column) for name, column in columns.items()}
    if len(set(lengths.values())) > 1 or min(lengths.values()) < least:
        raise InputError(
            f"{' and '.join(f'`{name}`' for name in columns)} must have the same "
            f"length, {least} or more; got {', '.join(map(str, lengths.values()))}."
        )
    return columns.values()


def _column(name: str, values: Any) -> np.ndarray:
    """A column of finite numbers."""
    checks.concrete("`hystjax.loops`", values)
    try:
        column = np.asarray(values, np.float64)
    except (TypeError, ValueError):
        raise InputError(
            f"`{name}` must be a column of numbers, got {checks.described(values)}."
        ) from None
    if column.ndim != 1:
        raise InputError(f"`{name}` must be 1-D, got shape {column.shape}.")
    if not np.all(np.isfinite(column)):
        raise InputError(f"`{name}` holds NaN or inf; remove such rows.")
    return column


_LEAST = 4  # samples of a rest
_STILL = 0.01  # of the input, by which it may move


def creep(recording: Recording, *, settle: float = 0.0) -> Fit:
    """The creep of a record whose input rests, a part of a longer one by `window`: by
    least squares w = start + rate log10(t / t1), t from its first sample on and t1 the
    first time that counts.

    **Arguments:** the record; `settle`, s after its first sample that do not count,
    such as a step that rings.

    **Returns:** `start`, output units, and `rate`, output units a decade of time; their
    standard errors hold for white noise.

    **Raises:** `InputError` for a record without a clock, an input that moves by more
    than 1 % of what it is, or was before (which windows keep: near 0 it is nothing but
    noise), fewer than four samples, or a negative `settle`.

    **Source:** the logarithmic law as in Vieira (1986), doi 10.1147/rd.305.0553.
    """
    as_recording(recording, "creep(recording)")
    checks.concrete("`hystjax.loops.creep`", recording, settle)
    checks.positive("settle", checks.number("settle", settle), zero=True)
    if not recording.clocked:
        raise InputError("creep is over time, and the record has no clock.")
    t, u, w = (
        np.asarray(x, np.float64) for x in (recording.t, recording.u, recording.w)
    )
    known = u if recording.past is None else np.append(np.asarray(recording.past.u), u)
    size = np.max(np.abs(known))
    if np.ptp(u) > _STILL * size:
        raise InputError(
            f"the input moves by {np.ptp(u):.4g} over these rows, more than 1 % of "
            f"{size:.4g}; creep is what the output does while it rests. Choose rows of "
            "a rest by `window`, of a record that has what came before too: how far "
            "its input went tells the noise of one that rests at 0."
        )
    since = t - t[0]
    counts = (since > 0) & (since >= settle)
    if counts.sum() < _LEAST:
        raise InputError(
            f"{counts.sum()} samples are left after `settle={settle:g}` s; a straight "
            f"line and its errors need {_LEAST} or more."
        )
    since = since[counts]
    decades = np.log10(since / since[0])
    columns = np.stack([np.ones_like(decades), decades], axis=1)
    return least_squares(["start", "rate"], columns, w[counts])
