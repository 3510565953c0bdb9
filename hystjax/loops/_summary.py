"""The numbers of a record's cycles as a dataset and as a table."""

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from .._core.changing import changed
from .._core.checks import InputError
from ..recording import Recording
from ..simulation import Trajectory
from ._numbers import LEVELS, Number, numbers
from ._reversals import Reversals, reversals

if TYPE_CHECKING:
    import xarray

# What a table shows unless it is told otherwise: the shape, the loss, the axes.
_SHOWN = (
    "amplitude",
    "saturation",
    "energy",
    "damping",
    "secant_stiffness",
    "remanence",
    "coercivity",
    "lag",
)


def summary(
    recording: Recording,
    *,
    threshold: float | None = None,
    found: Reversals | None = None,
) -> "xarray.Dataset":
    """The numbers of each cycle of a record, measured or simulated.

    Values at tips, at axes and at levels come from local cubics, which pass through the
    samples where there is no noise and average it where there is; areas from cubics
    too, with corners kept. Standard errors are for white noise, of which third
    differences, less those at corners, tell how strong it is; `<name>_error` holds
    them.

    - `energy`, ∮ w du: positive where w is ahead of u, as the force of a device that
        dissipates; of B over H it is the loss with a minus sign. `cumulative_energy`.
    - `u_max`, `u_min`, `w_max`, `w_min`: at the tips of the input; `amplitude` and
        `saturation`, half of what they differ by; `asymmetry`; `drift`.
    - `secant_stiffness`, from tip to tip; `tangent_stiffness`, over the tenth of a
        branch after a turn; `peak_stiffness`, of the ranges.
    - `damping`: |energy| / (2 π amplitude saturation).
    - `remanence`, `coercivity`, `squareness`; `u_bias`, `w_bias`. They count from zero:
        remove an offset first (`hystjax.loops.centred`).
    - `width` at a quarter, half and three quarters of the way between tips of w.
    - `pinching`: 0 where a loop is as high in the middle as anywhere.
    - `strength_degradation`, `stiffness_degradation`: lost since the first cycle of the
        same amplitude, within 5 %.
    - with a clock, `period` and `lag`, by which the fundamental wave of the output is
        behind that of the input.

    **Arguments:** the record; `threshold` as for `reversals`; or what that `found`.

    **Returns:** an `xarray.Dataset` over `cycle`, with units, the rows of each cycle,
    and in its attributes the threshold and the noise. NaN where a loop has no such
    number: it does not reach an axis.

    **Raises:** `InputError` where there is no cycle, and as `reversals` does.

    **Source:** damping by Jacobsen (1930), Trans. ASME 52, and Chopra, *Dynamics of
    Structures*, 3.9; squareness and coercivity as in IEC 60404.
    """
    found = _with_cycles(recording, threshold, found)
    return _dataset(recording, found, numbers(recording, found))


def _with_cycles(recording, threshold, found) -> Reversals:
    """The turning points of a record whose input makes a cycle."""
    found = reversals(recording, threshold=threshold) if found is None else found
    if not len(found.cycles):
        raise InputError(
            f"the input makes no cycle: it has {found}. A smaller `threshold=` counts "
            "smaller swings; `rainflow` counts half cycles too."
        )
    return found


def side_by_side(
    recording: Recording,
    simulated: Mapping[str, Trajectory],
    *,
    threshold: float | None = None,
    found: Reversals | None = None,
) -> "xarray.Dataset":
    """The numbers of a record and of what laws make of its input, cycle by cycle along
    `source`: `"recorded"`, and the labels of the laws.

    **Raises:** `InputError` for a trajectory of other rows or that is not finite, and
    as `summary` does.
    """
    import xarray

    found = _with_cycles(recording, threshold, found)
    sets = {
        label: _dataset(run, found, numbers(run, found))
        for label, run in _runs(recording, simulated).items()
    }
    labels = xarray.DataArray(list(sets), dims="source", name="source")
    return xarray.concat(
        list(sets.values()), labels, coords="minimal", combine_attrs="override"
    )


def _runs(recording, simulated: Mapping[str, Trajectory]) -> dict[str, Recording]:
    """A record, and what laws make of its input, by label."""
    runs = {"recorded": recording}
    for label, trajectory in simulated.items():
        w = np.asarray(trajectory.w)
        if w.shape != (len(recording),) or not np.all(np.isfinite(w)):
            raise InputError(
                f"the trajectory {label!r} must be finite and have the "
                f"{len(recording)} rows of the record; got shape {w.shape}."
            )
        runs[label] = changed(recording, w=trajectory.w)
    return runs


def compared(
    recording: Recording, simulated: Mapping[str, Trajectory]
) -> list[list[str]]:
    """What `table` makes of `side_by_side`, without xarray, which takes a tenth of the
    time of a whole report to import."""
    found = _with_cycles(recording, None, None)
    runs = _runs(recording, simulated)
    recorded, *others = (numbers(run, found) for run in runs.values())
    shown = [name for name in _SHOWN if name in recorded]
    head = [_head(name, recorded[name].unit) for name in shown]
    means = [[_mean(e[name].value) for e in (recorded, *others)] for name in shown]
    return _means(runs, head, means)


def _mean(values: np.ndarray) -> float:
    """Over the cycles that have the number."""
    there = values[~np.isnan(values)]
    return float(np.mean(there)) if there.size else np.nan


def table(dataset: "xarray.Dataset", names: Sequence[str] = _SHOWN) -> list[list[str]]:
    """Numbers as cells of text, headings first: of each cycle, with standard errors; or
    of what `side_by_side` returned, means over the cycles, and by how much those of
    each law are off.

    **Arguments:** what `summary` or `side_by_side` returned, and which numbers; those
    that it does not have are left out.

    **Raises:** `InputError` for a name that no summary has.
    """
    known = {*map(str, dataset.data_vars), *_SHOWN}
    if unknown := [name for name in names if name not in known]:
        raise InputError(
            f"a summary has no number {unknown[0]!r}; it has "
            f"{', '.join(sorted(known))}."
        )
    there = [
        name for name in names if name in dataset and "level" not in dataset[name].dims
    ]
    head = [_head(name, dataset[name].attrs["units"]) for name in there]
    if "source" in dataset.dims:
        means = [dataset[name].mean("cycle").values.tolist() for name in there]
        return _means(dataset["source"].values, head, means)
    body = [
        [str(cycle), *(_cell(dataset, name, row) for name in there)]
        for row, cycle in enumerate(dataset["cycle"].values.tolist())
    ]
    return [["cycle", *head], *body]


def _head(name: str, unit: str) -> str:
    return f"{name} ({unit or '1'})"


def _means(labels: Iterable[Any], head: Sequence[str], means) -> list[list[str]]:
    """Means over cycles of what was recorded and of laws, a row a number."""
    body = [[name, *_beside(row)] for name, row in zip(head, means, strict=True)]
    return [["mean over cycles", *map(str, labels)], *body]


def _beside(values: Sequence[float]) -> list[str]:
    """What was recorded, and the others with what they are off by."""
    truth, *others = values
    off = [100 * (x / truth - 1) if truth else np.nan for x in others]
    return [f"{truth:.5g}"] + [
        f"{x:.5g} ({each:+.2g} %)" if np.isfinite(each) else f"{x:.5g}"
        for x, each in zip(others, off, strict=True)
    ]


def _cell(dataset: "xarray.Dataset", name: str, row: int) -> str:
    value = float(dataset[name].values[row])
    if f"{name}_error" not in dataset:
        return f"{value:.5g}"
    error = float(dataset[f"{name}_error"].values[row])
    if not (np.isfinite(error) and error > 0 and np.isfinite(value)):
        return f"{value:.5g}"
    # No digits beyond the first of the error, nor more than six.
    known = -int(np.floor(np.log10(error)))
    return f"{round(value, known):.6g} ± {float(f'{error:.1g}'):g}"


def _dataset(
    recording: Recording, found: Reversals, known: Mapping[str, Number]
) -> "xarray.Dataset":
    import xarray

    data = {}
    for name, number in known.items():
        dims = ("cycle", "level")[: number.value.ndim]
        about = {"units": number.unit, "long_name": number.what}
        data[name] = (dims, number.value, about)
        if number.error is not None:
            about = {"units": number.unit, "long_name": f"standard error of {name}"}
            data[f"{name}_error"] = (dims, number.error, about)
    rows = found.cycles
    coordinates = {
        "cycle": np.arange(1, len(rows) + 1),
        "level": np.array(LEVELS),
        "start": ("cycle", rows[:, 0]),
        "turn": ("cycle", rows[:, 1]),
        "stop": ("cycle", rows[:, 2]),
    }
    attributes = {
        "input": recording.names[0],
        "output": recording.names[1],
        "threshold": found.threshold,
        "input_noise": found.noise,
        "reversals": len(found),
    }
    return xarray.Dataset(data, coordinates, attributes)
