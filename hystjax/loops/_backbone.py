"""Backbones of cyclic tests, and the two straight lines that codes put in their
place."""

from typing import Any, NamedTuple

import equinox as eqx
import numpy as np
from jaxtyping import Float

from .._core.checks import InputError
from ..recording import Recording
from ._reversals import Reversals, reversals

_FURTHER = 0.02  # share of an amplitude by which the next one is larger
_ELASTIC = 0.4  # of the peak, where the elastic stiffness is taken
_FAILED = 0.8  # of the peak, below which a specimen has failed
_LEAST = np.sqrt(0.5)  # of the peak, where no yield force has the energy


class Backbone(eqx.Module):
    """Both sides of a backbone, from the origin outwards.

    **Attributes:** `u`, `w`, the points of the positive side, shapes (k,), and
    `u_negative`, `w_negative`, those of the other, shapes (l,); input and output units.
    """

    u: Float[np.ndarray, " k"]
    w: Float[np.ndarray, " k"]
    u_negative: Float[np.ndarray, " l"]
    w_negative: Float[np.ndarray, " l"]

    def __str__(self) -> str:
        sides = ((self.u, self.w), (self.u_negative, self.w_negative))
        far = " and ".join(f"{len(u)} to ({u[-1]:.4g}, {w[-1]:.4g})" for u, w in sides)
        return f"Backbone: points from the origin outwards, {far}"


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
    below either; `ductility`, ultimate over yield input.
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
    - `kind`: `"envelope"`, the samples whose input lies further out than any before;
        `"first"`, the tips of the first cycle of each amplitude, those that reach
        further than any before.
    - `threshold`, `found`: as for `summary`.

    A side that is loaded second begins with what the other one has left: there the
    output is not zero where the input is. Of cycles that are repeated the first one
    counts, also where a device hardens in the others, but for what is further out.

    **Raises:** `InputError` for another kind, for an input that does not pass zero, and
    as `reversals` does.

    **Source:** ASTM E2126, the envelope curve; ASCE 41-17, 7.6.3, the first cycles.
    """
    if kind not in ("envelope", "first"):
        raise InputError(f'`kind` must be "envelope" or "first", got {kind!r}.')
    found = reversals(recording, threshold=threshold) if found is None else found
    u, w = np.asarray(recording.u, np.float64), np.asarray(recording.w, np.float64)
    rows = np.unique(np.concatenate([[0], found.rows, [len(u) - 1]]))

    def side(u, w):
        return _envelope(u, w) if kind == "envelope" else _first(u, w, rows)

    (right, up), (left, down) = side(u, w), side(-u, -w)
    if len(right) < 2 and len(left) < 2:
        raise InputError(
            "the input stays on one side of the record's turning points; a backbone "
            "starts from zero."
        )
    return Backbone(right, up, -left, -down)


def _first(u, w, rows):
    """Tips that lie further out than all before them."""
    tips, outs = [0.0], [0.0]
    for row in rows:
        if u[row] > max(tips[-1] * (1 + _FURTHER), 0.0):
            tips.append(u[row])
            outs.append(w[row])
    return np.array(tips), np.array(outs)


def _envelope(u, w):
    """Samples whose input lies further out than all before them, from the origin."""
    before = np.maximum.accumulate(np.concatenate([[0.0], u[:-1]]))
    new = u > np.maximum(before, 0.0)
    return np.append(0.0, u[new]), np.append(0.0, w[new])


def _points(u, w):
    """One side of a backbone, as it must be."""
    u, w = np.asarray(u, np.float64), np.asarray(w, np.float64)
    if u.shape != w.shape or u.ndim != 1 or not len(u):
        raise InputError(
            "`u` and `w` must be columns of one length, one point or more; got shapes "
            f"{u.shape} and {w.shape}."
        )
    if not (np.all(np.isfinite(u)) and np.all(np.isfinite(w))):
        raise InputError("`u` or `w` holds NaN or inf; remove such points.")
    return u, w


def bilinear(u: Float[np.ndarray, " k"], w: Float[np.ndarray, " k"]) -> Bilinear:
    """The two lines from the origin that come closest to one side of a backbone, by
    least squares; of either sign.

    **Raises:** `InputError` for fewer than four points, or three different inputs; for
    columns of different lengths, and what is not finite.
    """
    import scipy.optimize  # slow to import

    u, w = _points(u, w)
    # For a given knot it is linear; of all samples the best, then between neighbours.
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

    best = int(np.argmin([fit(knot)[1] for knot in knots]))
    low, high = knots[max(best - 1, 0)], knots[min(best + 1, len(knots) - 1)]
    if high > low:
        found: Any = scipy.optimize.minimize_scalar(
            lambda knot: fit(knot)[1],
            bounds=(low, high),
            method="bounded",
            options={"xatol": 1e-10 * high},
        )
        knot = min((float(found.x), float(knots[best])), key=lambda k: fit(k)[1])
    else:
        knot = float(knots[best])
    (elastic, hardening), squares = fit(knot)
    sign = np.sign(u[np.argmax(np.abs(u))])
    return Bilinear(
        float(elastic),
        float(hardening),
        float(sign * knot),
        float(sign * elastic * knot),
        float(np.sqrt(squares / len(u))),
    )


def _beyond(u, knot):
    return np.maximum(np.abs(u) - knot, 0.0)


def eeep(u: Float[np.ndarray, " k"], w: Float[np.ndarray, " k"]) -> Eeep:
    """The equivalent energy elastic-plastic curve of one side of a backbone, of either
    sign: as stiff as the backbone at 40 % of its peak, with as much energy up to where
    it falls below 80 % of the peak for good, or ends.

    **Raises:** `InputError` for a backbone that does not rise from the origin; for
    columns of different lengths, and what is not finite.

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
            f"input's sign, or begins above {100 * _ELASTIC:g} % of it."
        )
    # The last that carries so much: where it rings, or sticks and slips, it comes back.
    stop = int(np.flatnonzero(w >= _FAILED * peak)[-1]) + 1
    if stop < len(u):
        drop = (w[stop - 1] - _FAILED * peak) / (w[stop - 1] - w[stop])
        ultimate = float(u[stop - 1] + drop * (u[stop] - u[stop - 1]))
        u, w = np.append(u[:stop], ultimate), np.append(w[:stop], _FAILED * peak)
    ultimate = float(u[-1])
    rising = int(np.argmax(w >= _ELASTIC * peak))
    share = (_ELASTIC * peak - w[rising - 1]) / (w[rising] - w[rising - 1])
    soft = u[rising - 1] + share * (u[rising] - u[rising - 1])
    elastic = float(_ELASTIC * peak / soft)
    energy = float(np.trapezoid(w, u))
    inside = ultimate**2 - 2 * energy / elastic
    force = (ultimate - np.sqrt(inside)) * elastic if inside >= 0 else _LEAST * peak
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
