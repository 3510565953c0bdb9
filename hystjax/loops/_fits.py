"""What is fitted to cycles: losses by frequency, Steinmetz's law, and creep."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from jaxtyping import ArrayLike, Float

from .._core import checks
from .._core.checks import InputError
from ..recording import Recording
from ._corrections import in_si
from ._summary import summary

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
    - `threshold`: as for `reversals`.

    **Returns:** an `xarray.Dataset` over `cycle`: `energy`, J/m³, with `energy_error`;
    `power`, W/m³, where a frequency is known; per mass `specific_energy`, J/kg, and
    `specific_power`, W/kg; `field` and `flux`, the amplitudes, half their ranges over
    the cycle, A/m and T; `coercivity`, A/m, and `remanence`, T, with errors.

    **Raises:** `InputError` for other units, numbers that are not positive, and as
    `summary` does.
    """
    import xarray

    for name, number in {"frequency": frequency, "density": density}.items():
        if number is not None:
            checks.positive(name, number)
    record = _of_core(recording)
    known = summary(record, threshold=threshold)
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


def _of_core(recording: Recording) -> Recording:
    """A record of field strength and flux density, in A/m and T."""
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

    **Raises:** `InputError` for fewer different frequencies than parts, or one that is
    not positive.

    **Source:** Bertotti (1988), doi 10.1109/20.43994.
    """
    f, y = (np.asarray(each, np.float64) for each in (frequency, energy))
    names = ["static", "classical", *(["excess"] if excess else [])]
    _check_pairs(len(names), frequency=f, energy=y)
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

    **Raises:** `InputError` for fewer than three rows, numbers that are not positive,
    only one frequency or amplitude, or amplitudes that are a power of the frequency.

    **Source:** Steinmetz (1892), doi 10.1109/T-AIEE.1892.5570437.
    """
    f, b, p = (np.asarray(each, np.float64) for each in (frequency, flux, power))
    _check_pairs(3, frequency=f, flux=b, power=p)
    for name, each in {"frequency": f, "flux": b}.items():
        if np.ptp(each) == 0:
            raise InputError(
                f"all of `{name}` are {each[0]:g}: no exponent can be told from one."
            )
    columns = np.stack([np.ones_like(f), np.log(f), np.log(b)], axis=1)
    fit = least_squares(["k", "alpha", "beta"], columns, np.log(p))
    k = float(np.exp(fit.value["k"]))
    return Fit(fit.value | {"k": k}, fit.error | {"k": k * fit.error["k"]}, fit.rmse)


def _check_pairs(least: int, **columns: Float[np.ndarray, " _n"]) -> None:
    for name, column in columns.items():
        checks.positive(name, column)
        if column.ndim != 1:
            raise InputError(f"`{name}` must be 1-D, got shape {column.shape}.")
    lengths = {name: len(column) for name, column in columns.items()}
    if len(set(lengths.values())) > 1 or min(lengths.values()) < least:
        raise InputError(
            f"{' and '.join(f'`{name}`' for name in columns)} must have the same "
            f"length, {least} or more; got {', '.join(map(str, lengths.values()))}."
        )


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
    than 1 % of what it is, or fewer than four samples.

    **Source:** the logarithmic law as in Vieira (1986), doi 10.1147/rd.305.0553.
    """
    checks.concrete("`hystjax.loops.creep`", recording)
    if not recording.clocked:
        raise InputError("creep is over time, and the record has no clock.")
    t, u, w = (
        np.asarray(x, np.float64) for x in (recording.t, recording.u, recording.w)
    )
    if np.ptp(u) > _STILL * np.max(np.abs(u)):
        raise InputError(
            f"the input moves by {np.ptp(u):.4g} over these rows; creep is what the "
            "output does while it rests. Choose rows of a rest by `window`."
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
