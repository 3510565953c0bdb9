"""Inputs that lead devices where one says: the voltages of measured piezos, from what
they measured alone; and twins of devices led along references, by compensators of
another family."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array
from matplotlib.figure import Figure
from scipy.ndimage import uniform_filter1d

from .. import plot
from .._core.solution import RESULTS, Solution
from ..compensation import PID, Learning, control
from ..inversion import invert
from ..library import Duhem, Lag, Play, Polynomial
from ..models import AbstractLaw, AbstractModel, Everett, PrandtlIshlinskii, SparseModel
from ..recording import Recording, datasets
from ..refinement import refine
from ..regression import LeastSquares, Ridge, identify
from ..regression.formulation import AbstractFormulation, Direct, WeakForm
from ..simulation import FixedStep, simulate
from ._document import AbstractDocument, shown
from ._published import learned, with_output

_SMOOTHED = 50  # samples, 10 ms, of piezo_ayala
_VOLTAGE_RADII = 0.95 * np.linspace(0, 1, 10)[1:]  # of half the input's range
_LAGS = (0.01, 0.1, 1.0)  # s
_CUBIC = ("w^3", "w^2*u", "w*u^2")
_VOLTAGE_HEADINGS = ("device", "model", "numbers", "off, %", "smoothed, %", "band, %")
_VOLTAGE_NOTES = (
    "The output of rows not fitted is the reference; off: what the inverse asks for "
    "less the voltage that was applied, root mean square in % of its range. smoothed: "
    "the output averaged over 10 ms, where its noise is less.",
    "piezo_ayala: fitted to rows 35001 to 45001, the voltage of rows 17500 to 35000. "
    "piezo_yan9a: fitted to the first half, the voltage of the second.",
    "line: the voltage as a straight line of the output, by least squares on the rows "
    "fitted; plays: nine, with radii up to 95 % of the amplitude, and a cubic of the "
    "input; lags: of the input, of 10 ms, 0.1 and 1 s; cubic law: with w^3, w^2 u and "
    "w u^2, which of ten such sets of terms followed the fitted rows best.",
    "band: the standard error that the covariance of a refined law's numbers gives the "
    "voltage, through the derivatives of the inverse, root mean square. What is off "
    "beyond it is the law's form.",
)


@dataclass(frozen=True)
class Voltage:
    """By how much the voltage that an output asks for is off the one applied.

    **Attributes:**

    - `device`, `model`: their names.
    - `numbers`: how many were fitted.
    - `off`, `smoothed`: root mean square, % of the range, from the output as it was
        measured and averaged; `None` where it was not averaged.
    - `band`: the standard error of `off`'s voltage; `None` where none is known.
    """

    device: str
    model: str
    numbers: int
    off: float
    smoothed: float | None = None
    band: float | None = None


@dataclass(frozen=True)
class VoltageTable(AbstractDocument):
    """Devices and models."""

    rows: tuple[Voltage, ...]

    def cells(self):
        """Headings, and a line a device and model."""
        lines = [
            (
                r.device,
                r.model,
                str(r.numbers),
                *(shown(each, 3) for each in (r.off, r.smoothed, r.band)),
            )
            for r in self.rows
        ]
        return [_VOLTAGE_HEADINGS, *lines]


def voltages() -> VoltageTable:
    """Ask inverses of two measured piezos for the voltage of rows not fitted.

    **Raises:** `InputError` when a recording cannot be had.
    """
    ayala, yan9a = (datasets.load(name) for name in ("piezo_ayala", "piezo_yan9a"))
    own, unseen = ayala.window(35001, 45001), ayala.window(17500, 35000)
    law = learned(own, threshold=0.01)
    wider = SparseModel.from_terms(
        law.terms() | dict.fromkeys(_CUBIC, 0.0), names=own.names, units=own.units
    )
    laws = {
        "law": law,
        "law, refined": refine(law, own),
        "cubic law, refined": refine(wider, own),
    }
    first, second = yan9a.split(0.5)
    rows = [
        *_judged("piezo_ayala", laws | _fitted(own), unseen, _averaged(unseen)),
        *_judged("piezo_yan9a", _fitted(first), second),
    ]
    return VoltageTable("Voltages from measured outputs", tuple(rows), _VOLTAGE_NOTES)


def _fitted(record: Recording) -> dict[str, AbstractLaw]:
    """What linear regression makes of a record, by name."""
    radii = np.ptp(record.u) / 2 * _VOLTAGE_RADII
    plays = Play(radii) + Polynomial(3, ("u",))
    libraries = {"plays": plays, "plays and lags": plays + Lag(_LAGS)}
    found = {
        name: identify(record, library, Ridge(1e-9), formulation=Direct()).value
        for name, library in libraries.items()
    }
    return {"line": _line(record)} | found


def _judged(
    device: str,
    models: Mapping[str, AbstractLaw | Solution],
    unseen: Recording,
    averaged: Recording | None = None,
) -> Iterator[Voltage]:
    """Voltages by several models, from an output as it was measured, and averaged."""
    for name, model in models.items():
        law = model.value if isinstance(model, Solution) else model
        off, band = _off(model, unseen)
        smoothed = None if averaged is None else _off(model, averaged)[0]
        yield Voltage(device, name, len(law.terms()), off, smoothed, band)


def _averaged(record: Recording) -> Recording:
    w = uniform_filter1d(np.asarray(record.w), _SMOOTHED, mode="nearest")
    return with_output(record, jnp.asarray(w))


def _line(record: Recording) -> AbstractLaw:
    """The law whose voltage is a straight line of the output, by least squares."""
    slope, level = np.polyfit(record.w, record.u, 1)
    terms = {"1": float(-level / slope), "u": float(1 / slope)}
    return SparseModel.from_terms(terms, target="value")


def _off(model: Any, record: Recording) -> tuple[float, float | None]:
    """How far off the voltages of an inverse are, and their standard errors, % of the
    range, root mean square."""
    found = invert(model, record, method=FixedStep(1))
    if found.result != RESULTS.successful:
        return float("inf"), None
    share = 100 / np.ptp(record.u)
    off = share * np.sqrt(np.mean((found.value.u - record.u) ** 2))
    errors = found.stats.get("u_standard_errors")
    band = None if errors is None else share * np.sqrt(np.nanmean(errors**2))
    return float(off), None if band is None else float(band)


NOISE = 0.01  # of the record that is fitted, and of the sensor, over the stroke
SEEDS = range(20)
_STEP = 1e-3  # s, of the controller
_LENGTH, _EVERY = 40.0, 2e-3  # s, of a record and of its samples
_TIME = 8.0  # s, of a reference
# Of plays, over the input's range.
_RADII = (0.02, 0.05, 0.08, 0.12, 0.16, 0.2, 0.25, 0.3, 0.36, 0.43)
_CREEP = (0.5, 5.0)  # s, of lags of the input
_DEAF = 2.0  # s, until the piezo has settled from a past that is not known
# Settled on seeds from 100 on: what is shown has seeds of its own.
_BANDWIDTH = 50.0  # of the loop, rad/s: a sixth of the noise would get through
_LEARNING = 0.35  # of an error that is learned each time, on the mean slope
_SMOOTHING = 0.02  # s
_REPETITIONS = 20
_CONTROL_NOTES = (
    "Worst of 20 seeds; root mean square of the true output less the reference, over "
    "the whole run, in % of the stroke, which is the range of the reference. The "
    "sensor, at 1 kHz, has white noise of 1 % of the stroke.",
    "Preisach: a smooth density on the plane of relays. Plays and creep: three plays, "
    "of which one creeps for 1.5 s. Compensators of both are fitted to records of "
    "their own, a sine of 0.25 Hz that dies away, with 1 % of noise, of each seed its "
    "own. piezo_yan9a: a Preisach model of the first half of the record, against what "
    "is fitted to the second half as it was measured.",
    "Compensators: `nothing` a constant gain, stroke over range of the input; `line` a "
    "straight line, fitted; `law` of first order, w' = (a + b u + c w) |u'| + d u'; "
    "`stack` plays with weights of one sign; `powers` a cubic of the input, plays, "
    "their squares and cubes, and two slow lags. `loop` is an integral alone, its "
    "bandwidth 50 rad/s; learning runs the reference 20 times. With both stands "
    "`powers` on Preisach, else `stack`. The piezo's record, a sine of one amplitude, "
    "tells nothing of smaller ones: there `powers`, free to, does what it wants.",
    "References: a sine of 0.5 Hz; ten random steps, smoothed over 80 ms; a triangle "
    "of 1.25 Hz; through 80 % of the range of the record, on the piezo 95 %. The "
    "device goes on from the end of its record. Loop, learning and what stands with "
    "them were settled on other seeds.",
)
_NAMED: Any = {"names": ("voltage", "stroke"), "units": ("V", "µm")}
COMPENSATORS = ("nothing", "line", "law", "stack", "powers")
SCHEMES = (*COMPENSATORS, "loop", "inverse and loop", "inverse, learned")


@dataclass(frozen=True)
class Tracked:
    """How far one device gets from one reference.

    **Attributes:**

    - `device`, `reference`: their names.
    - `rms`, `largest`: errors by scheme, % of the stroke, the worst of all seeds.
    """

    device: str
    reference: str
    rms: Mapping[str, float]
    largest: Mapping[str, float]


@dataclass(frozen=True)
class TrackingTable(AbstractDocument):
    """Devices, references and schemes."""

    rows: tuple[Tracked, ...]

    def cells(self):
        """Headings, and a line a device and reference."""
        lines = [
            (r.device, r.reference, *(shown(r.rms[each], 3) for each in SCHEMES))
            for r in self.rows
        ]
        return [("device", "reference", *SCHEMES), *lines]


@dataclass(frozen=True)
class Twin:
    """A device, what is known of it, and what stands for it.

    **Attributes:**

    - `name`: of the device.
    - `device`: the model that is led.
    - `records`: what compensators are fitted to, one or one a seed; where the first
        ends the references begin.
    - `best`: the compensator that loops and learning stand on.
    - `share`: of the output's range that references run through.
    """

    name: str
    device: AbstractModel
    records: Sequence[Recording]
    best: str = "powers"
    share: float = 0.8


def compensation() -> TrackingTable:
    """Lead twins of devices along references."""
    rows = []
    for twin in (preisach(SEEDS), creeping(SEEDS), piezo()):
        fitted = [compensators(each) for each in twin.records]
        for name, reference in references(twin).items():
            runs = tracked(twin, fitted, reference, SEEDS)
            rows.append(Tracked(twin.name, name, *_worst(runs)))
    title = "Twins of devices led along references"
    return TrackingTable(title, tuple(rows), _CONTROL_NOTES, _drawing)


def tracked(
    twin: Twin,
    fitted: Sequence[Mapping[str, AbstractModel]],
    reference: Recording,
    seeds: Sequence[int],
) -> dict[str, Solution]:
    """One device along one reference by all schemes, of which each is a batch over
    seeds; the compensators are those of each seed, or of all."""
    gain = _gain(twin.records[0])
    noise = NOISE * float(jnp.ptp(reference.w))
    keys = jax.vmap(jax.random.key)(jnp.asarray(seeds))

    def run(inputs: Sequence[Array], **options: Any) -> Solution:
        many = jnp.broadcast_to(jnp.stack(inputs), (len(seeds), len(reference)))
        return jax.vmap(
            lambda u, key: control(
                twin.device, reference, feedforward=u, noise=noise, key=key, **options
            )
        )(many, keys)

    found = {
        name: [
            invert(each[name], reference, method=FixedStep(1)).value.u
            for each in fitted
        ]
        for name in COMPENSATORS
    }
    runs = {name: run(inputs) for name, inputs in found.items()}
    loop = PID(ki=_BANDWIDTH / gain)
    lessons = Learning(_LEARNING / gain, _SMOOTHING, _REPETITIONS)
    still = [jnp.full_like(reference.u, reference.u[0])]
    best = found[twin.best]
    last = (
        run(still, feedback=loop),
        run(best, feedback=loop),
        run(best, learning=lessons),
    )
    return runs | dict(zip(SCHEMES[len(COMPENSATORS) :], last, strict=True))


def _worst(runs: Mapping[str, Solution]) -> tuple[dict[str, float], dict[str, float]]:
    """The largest of all seeds, of the rms and of the largest error."""
    rms, largest = (
        {scheme: float(jnp.max(run.stats[name])) for scheme, run in runs.items()}
        for name in ("rms", "largest")
    )
    return rms, largest


def compensators(record: Recording) -> dict[str, AbstractModel]:
    """What is fitted to a record, by name, of which nothing but the record is known."""
    u, w = np.asarray(record.u), np.asarray(record.w)
    gain = _gain(record)
    straight = {"1": float(np.mean(w) - gain * np.mean(u)), "u": gain}
    powers = Polynomial(3, ("u",)) + Lag(_CREEP)
    for radius in np.ptp(u) * np.array(_RADII):
        play = Play([radius])
        powers = powers + play + play * play + play * play * play

    def fitted(library: Any, how: AbstractFormulation) -> AbstractModel:
        return identify(record, library, LeastSquares(), formulation=how).value

    return {
        "nothing": SparseModel.from_terms(straight, target="value"),
        "line": fitted(Polynomial(1, ("u",)), Direct()),
        "law": fitted(Duhem(), WeakForm(_half_width(u))),
        "stack": PrandtlIshlinskii.guess(record),
        "powers": fitted(powers, Direct()),
    }


def _half_width(u: np.ndarray) -> int:
    """A third of the samples from one turning point to the next."""
    turns = np.count_nonzero(np.diff(np.sign(np.diff(u))))
    return max(2, len(u) // (3 * (int(turns) + 1)))


def _gain(record: Recording) -> float:
    """The output's range over the input's."""
    return float(np.ptp(record.w) / np.ptp(record.u))


def references(twin: Twin) -> dict[str, Recording]:
    """Three ways through the middle of the output's range, each from where the record
    ends, and with its past."""
    record = twin.records[0]
    w = np.asarray(record.w)
    low, high = np.quantile(w, (0.002, 0.998))  # without the noise beyond
    middle, size = (low + high) / 2, twin.share * (high - low) / 2
    t = _STEP * np.arange(round(_TIME / _STEP))
    levels = np.random.default_rng(5).uniform(-1, 1, 10)
    steps = levels[np.minimum((t / 0.8).astype(int), 9)]
    bell = np.exp(-((np.arange(-240, 241) * _STEP / 0.08) ** 2) / 2)
    padded = np.pad(steps, 240, mode="edge")
    shapes = {
        "sine": np.sin(np.pi * t),
        "steps": np.convolve(padded, bell / bell.sum(), "valid"),
        "triangle": 2 / np.pi * np.arcsin(np.sin(2.5 * np.pi * t)),
    }
    # From the last output into the reference within half a second, without a corner.
    share = np.sin(np.pi / 2 * np.minimum(t / 0.5, 1)) ** 2
    start = float(np.mean(w[-3:]))
    return {
        name: _after(record, t, start + share * (middle + size * shape - start))
        for name, shape in shapes.items()
    }


def _after(record: Recording, t: np.ndarray, w: np.ndarray) -> Recording:
    """Outputs at times from the end of a record on, of which the inputs are known."""
    n = len(record)
    times = np.concatenate([record.t, record.t[-1] + t[1:]])
    inputs = np.concatenate([record.u, np.full(len(t) - 1, record.u[-1])])
    outputs = np.concatenate([record.w[:-1], w])
    named: Any = {"names": record.names, "units": record.units}
    return Recording(times, inputs, outputs, **named).window(n - 1, n - 1 + len(t))


def preisach(seeds: Sequence[int]) -> Twin:
    """A density on the plane of relays, and noisy records of it."""
    radii = np.linspace(0, 1, 32, endpoint=False)
    centres = np.linspace(-1.2, 1.2, 25)
    middles = (centres[1:] + centres[:-1]) / 2
    density = np.exp(
        -(((radii[:, None] - 0.35) / 0.2) ** 2) / 2 - (middles / 0.45) ** 2 / 2
    )
    density[0] += 0.4 * np.exp(-((middles / 0.7) ** 2) / 2)
    roots = np.sqrt(density / density.sum())
    device = Everett(radii, centres, roots, **_NAMED)
    return Twin("Preisach", device, _recorded(device, seeds))


def creeping(seeds: Sequence[int]) -> Twin:
    """Plays, of which one creeps, and noisy records of them."""
    terms = {
        "u": 0.25,
        "play(u,0.13)": 0.2,
        "play(u,0.37)": 0.4,
        "play(u,0.71)": 0.35,
        "lag(play(u,0.37),1.5)": 0.06,
    }
    law = SparseModel.from_terms(terms, target="value", **_NAMED)
    return Twin("plays and creep", law, _recorded(law, seeds), best="stack")


def piezo() -> Twin:
    """A Preisach model of one half of a measured record, and the other half."""
    first, second = datasets.load("piezo_yan9a").split(0.5)
    settled = first.window(int(np.searchsorted(first.t, _DEAF)), len(first))
    device = Everett.guess(settled)
    return Twin("piezo_yan9a", device, [second], best="stack", share=0.95)


def _recorded(device: AbstractModel, seeds: Sequence[int]) -> list[Recording]:
    """A sine that dies away, and what a noisy sensor saw of the output."""
    t = _EVERY * np.arange(round(_LENGTH / _EVERY))
    u = (1 - 0.9 * t / _LENGTH) * np.sin(np.pi / 2 * t)
    still = Recording(t, u, np.zeros_like(t), **_NAMED)
    w = np.asarray(simulate(device, still, method=FixedStep(1)).w)
    level = NOISE * np.ptp(w)
    return [
        Recording(
            t, u, w + level * np.random.default_rng(s).normal(size=len(t)), **_NAMED
        )
        for s in seeds
    ]


def _drawing() -> Figure:
    """The steps on the first twin, by the first seed."""
    twin = preisach(SEEDS[:1])
    fitted = [compensators(each) for each in twin.records]
    runs = tracked(twin, fitted, references(twin)["steps"], SEEDS[:1])
    drawn = {"constant gain": "nothing", "inverse": twin.best}
    drawn |= {scheme: scheme for scheme in SCHEMES[-2:]}
    first = {
        label: jax.tree.map(lambda x: x[0], runs[name].value)
        for label, name in drawn.items()
    }
    return plot.tracking(first)
