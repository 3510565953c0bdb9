"""Laws of measured devices, fitted on part of a recording and judged on the rest:
refined ones; how many terms one of the measured piezo needs; and laws of plays, stops
and lags."""

from collections.abc import Sequence
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._core.compiling import jit
from ..comparison import compare
from ..discovery import discover
from ..discovery.search import Trial
from ..library import Lag, Library, Polynomial, Term
from ..models import AbstractModel, SparseModel
from ..recording import Recording, datasets
from ..refinement import AbstractLoss, Huber, Squares, refine
from ..regression import LeastSquares, identify
from ..regression.differentiation import SavitzkyGolay
from ..regression.formulation import Direct
from ..simulation import FixedStep, judge, metrics, simulate
from ._document import AbstractDocument, shown

# µm, beyond 1.345 of which residuals count less: a little less than the noise at rest,
# of which 1.4826 times the median distance from its median is 0.0452, and the standard
# deviation, with its spikes, 0.0488.
PIEZO_SCALE = 0.0427
# Of mr_damper to start from: a force that follows the velocity within 20 ms; sampled at
# 100 Hz its derivative is too coarse to regress on.
MR_DAMPER = {
    **{"1": 0.0, "w": -50.0, "u": 0.0},
    **{"du": 150.0, "w*|w|": 0.0, "du*|du|": 0.0},
}
_SQUARES = Squares()
_HEADINGS = ("device", "terms", "matched", "own rows", "unseen rows", "forgets")
_NOTE = (
    "matched: with the initial output fitted too; own and unseen rows: free runs from "
    "the first measured output. Noise floor of piezo_ayala, from its rest: 0.124 %."
)
COPIED_PIEZO = {"1": -0.176, "w": -2.388, "u": 0.581, "du": 0.119, "w*|w|": -0.076}


@dataclass(frozen=True)
class Device:
    """What is fitted, and how.

    **Attributes:**

    - `name`: device and law.
    - `fitted`, `unseen`: recordings.
    - `start`: the law that refinement starts from.
    - `loss`: what residuals cost.
    - `substeps`: integration steps a sample interval.
    """

    name: str
    fitted: Sequence[Recording]
    unseen: Sequence[Recording]
    start: SparseModel
    loss: AbstractLoss = _SQUARES
    substeps: int = 1


@dataclass(frozen=True)
class Refined:
    """A refined law with its errors, NRMSE in per cent, means over recordings.

    **Attributes:** the `name`; the `law`; errors of the fit itself (with fitted initial
    outputs), and of free runs from the first measured output on fitted and on unseen
    rows; whether the law `forgets` its initial value.
    """

    name: str
    law: SparseModel
    matched: float
    fitted: float
    unseen: float
    forgets: bool


@dataclass(frozen=True)
class MeasuredTable(AbstractDocument):
    """The laws of several devices."""

    rows: tuple[Refined, ...]

    def cells(self):
        """Headings, and a line a law."""
        return [_HEADINGS, *map(_cells, self.rows)]


def measured() -> MeasuredTable:
    """Refine a law for each measured device of the registry.

    **Raises:** `InputError` when a recording cannot be had.
    """
    devices = (*_ayala(), _yan9a(), _mr_damper(), _friction())
    rows = tuple(refined(device) for device in devices)
    laws = (f"{row.name}: {row.law}" for row in rows)
    title = "Refined laws of measured devices, NRMSE in %"
    return MeasuredTable(title, rows, (_NOTE, *laws))


def refined(device: Device) -> Refined:
    """Refine one law and judge it."""
    solution = refine(
        device.start,
        device.fitted,
        loss=device.loss,
        substeps=device.substeps,
        throw=False,
    )
    law, stats = solution.value, solution.stats
    ranges = [float(np.ptp(np.asarray(each.w))) for each in device.fitted]
    matched = 100 * np.mean(np.asarray(stats["rmse"]) / np.array(ranges))
    return Refined(
        device.name,
        law,
        float(matched),
        mean_error(law, device.fitted, device.substeps),
        mean_error(law, device.unseen, device.substeps),
        bool(np.all(np.asarray(stats["fading"].exponent) < 0)),
    )


def mean_error(
    law: AbstractModel, recordings: Sequence[Recording], substeps: int
) -> float:
    """NRMSE of free runs, %, the mean of recordings."""
    method = FixedStep(substeps)
    judgements = [judge(law, each, method=method) for each in recordings]
    return 100 * float(np.mean([float(each.errors["nrmse"]) for each in judgements]))


def _ayala() -> tuple[Device, ...]:
    """The paper's five terms, by squares; and one more, with the loss that suits the
    spikes in this recording: Huber's, with his threshold of 1.345 times the scale of
    the noise, Huber (1981), doi 10.1002/0471725250."""
    record = datasets.load("piezo_ayala")
    rows = [record.window(35000, 45000)], [record.window(17500, 35000)]
    five = SparseModel.from_terms(COPIED_PIEZO)
    six = SparseModel.from_terms(COPIED_PIEZO | {"du*|du|": 0.0})
    return (
        Device("piezo_ayala, the paper's terms", *rows, five),
        Device("piezo_ayala, and du*|du|", *rows, six, Huber(1.345 * PIEZO_SCALE)),
    )


def _yan9a() -> Device:
    record = datasets.load("piezo_yan9a")
    fitted, unseen = [record.window(0, 4000)], [record.window(4000, 8027)]
    names = ("1", "w", "u", "du", "u*|du|", "w*|du|", "|du|")
    return Device("piezo_yan9a", fitted, unseen, _smoothed(fitted, names, 31))


def _mr_damper() -> Device:
    """Ten amplitudes in one fit: the first half of each."""
    records = [
        datasets.load("mr_damper", name) for name in datasets.records("mr_damper")
    ]
    halves = [record.split(0.5) for record in records]
    fitted, unseen = zip(*halves, strict=True)
    start = SparseModel.from_terms(MR_DAMPER)
    return Device("mr_damper, ten amplitudes", fitted, unseen, start, substeps=4)


def _friction() -> Device:
    record = datasets.load("friction_pin")
    centred = record.with_input(record.u - record.u.mean())
    fitted, unseen = centred.split(0.5)
    names = ("du", "w*|du|", "|du|", "du*|w|", "u*|du|")
    start = _smoothed([fitted], names, 15)
    return Device("friction_pin", [fitted], [unseen], start)


def _smoothed(recordings, names: Sequence[str], window: int) -> SparseModel:
    """The law of given terms by least squares on smoothed derivatives."""
    library = Library(tuple(Term.parse(name) for name in names))
    return identify(
        recordings, library, LeastSquares(), differentiation=SavitzkyGolay(window)
    ).value


def _cells(row: Refined) -> list[str]:
    errors = [shown(value, 4) for value in (row.matched, row.fitted, row.unseen)]
    return [
        row.name,
        str(len(row.law.terms())),
        *errors,
        "yes" if row.forgets else "no",
    ]


_LARGEST, _WIDTH = 8, 24
_AT_ONCE = 32  # laws that are simulated side by side
_SIZE_TITLE = "Laws of the measured piezo by size (NRMSE of free runs in %)"
_SIZE_NOTES = (
    "`discover` on rows 35000:45000, with the library of degree 3 and `width=24`; "
    "unseen are rows 17500:35000; free runs start at the measured first output. Noise "
    "at rest: 0.124 %.",
    "On the left the best law by the rows it was fitted to. On the right, of all laws "
    "of that size that were refined, the one of the least error on the unseen rows: a "
    "choice that knows these rows, and so no result, but what a better rule of choice "
    "could win.",
)


@dataclass(frozen=True)
class Law:
    """A law and the errors of its free run, %, on its `own` and on `unseen` rows."""

    terms: tuple[str, ...]
    own: float
    unseen: float

    def cells(self) -> tuple[str, ...]:
        """What is shown."""
        return shown(self.own, 4), shown(self.unseen, 4), ", ".join(self.terms)


@dataclass(frozen=True)
class Size:
    """Laws of so many `terms`: the one `chosen` by its own rows, and the one that turns
    out `best` on the unseen ones."""

    terms: int
    chosen: Law
    best: Law


@dataclass(frozen=True)
class SizeTable(AbstractDocument):
    """Laws of each size."""

    rows: tuple[Size, ...]

    def cells(self):
        """Headings, and a line a size."""
        heads = ("own rows", "unseen", "law")
        lines = [
            (str(row.terms), *row.chosen.cells(), *row.best.cells())
            for row in self.rows
        ]
        return [("terms", *heads, *(f"{head}, best unseen" for head in heads)), *lines]


def sizes() -> SizeTable:
    """Laws of up to eight terms of the measured piezo, chosen and best.

    **Raises:** `InputError` when the recording cannot be had.
    """
    record = datasets.load("piezo_ayala")
    own, unseen = record.window(35000, 45000), record.window(17500, 35000)
    library = Polynomial(3)
    stats = discover(own, library, largest=_LARGEST, width=_WIDTH, progress=True).stats
    trials = stats["candidates"]
    errors = [errors_of(trials, library, rows) for rows in (own, unseen)]
    laws = [
        Law(trial.support, float(on_own), float(on_unseen))
        for trial, on_own, on_unseen in zip(trials, *errors, strict=True)
    ]
    rows = (_size(size, chosen, laws) for size, chosen in stats["frontier"].items())
    return SizeTable(_SIZE_TITLE, tuple(rows), _SIZE_NOTES)


def _size(size: int, chosen: Trial, laws: Sequence[Law]) -> Size:
    same = [law for law in laws if len(law.terms) == size]
    by_own_rows = next(law for law in same if law.terms == chosen.support)
    return Size(size, by_own_rows, min(same, key=lambda law: law.unseen))


def errors_of(
    trials: Sequence[Trial], library: Library, recording: Recording, substeps: int = 2
) -> Float[np.ndarray, " m"]:
    """NRMSE of the free runs, %; infinite for a law that diverges."""
    rows = [[trial.terms.get(name, 0.0) for name in library.names] for trial in trials]
    errors = 100 * np.asarray(_nrmse(jnp.array(rows), library, recording, substeps))
    return np.where(np.isfinite(errors), errors, np.inf)


@jit
def _nrmse(
    coefficients: Float[Array, "m k"],
    library: Library,
    recording: Recording,
    substeps: int,
) -> Float[Array, " m"]:
    # All laws over the whole library, for one program.
    everything = np.ones(len(library), bool)

    def one(row):
        law = SparseModel(library, row, everything)
        return judge(law, recording, method=FixedStep(substeps)).errors["nrmse"]

    return jax.lax.map(one, coefficients, batch_size=_AT_ONCE)


_PLAYS = (0.02, 0.04, 0.07, 0.1, 0.15, 0.2, 0.27, 0.35, 0.42)  # over the input's range
_CREEP = (0.3, 5.0)  # s
_TIMES = (0.01, 0.03, 0.05, 0.1)  # s
_START_UP = 400  # rows, 2 s, in which the device settles from a past that is not known
_CONSTANT = Library((Term(),))
_MEMORY_NOTES = (
    "friction_damper: w = c + sum of a stop(u, r) + b stop(u, r)^3, two springs that "
    "slide, each with a static curve; seven numbers, the radii refined: the family "
    '"two stops" of `compare`. The error is the mean of the recordings\' NRMSE, % of '
    "the range of each.",
    "piezo_yan9a: a cubic of the input and nine plays, all behind one lag, and lags of "
    "0.3 and 5 s of the input beside them; one linear fit to the first half but for "
    "the start, in which the device settles. RMSE in µm.",
)


@dataclass(frozen=True)
class Remembered:
    """A law on one device.

    **Attributes:** the `device`; what was `fitted`; the number of `numbers`; the errors
    on what was fitted (`own`) and on the rest (`unseen`, `None` for no rest); and the
    `law`.
    """

    device: str
    fitted: str
    numbers: int
    own: float
    unseen: float | None
    law: str


@dataclass(frozen=True)
class MemoryTable(AbstractDocument):
    """Laws that remember."""

    rows: tuple[Remembered, ...]

    def cells(self):
        """Headings, and a line a law."""
        rows = [
            (r.device, r.fitted, str(r.numbers), shown(r.own, 3), shown(r.unseen, 3))
            for r in self.rows
        ]
        return [("device", "fitted on", "numbers", "own", "unseen"), *rows]


def memory() -> MemoryTable:
    """Laws of plays, stops and lags for the friction damper and a piezo."""
    title = "Signals with memory in laws of the value"
    return MemoryTable(title, (*_friction_damper(), *_piezo()), _MEMORY_NOTES)


def _friction_damper():
    name = "friction_damper"
    records = {each: datasets.load(name, each) for each in datasets.records(name)}
    small = [each for each in records if each.endswith("0.5in")]
    large = [each for each in records if each not in small]
    wholes = {"all four": list(records), "0.5 in": small, "1 in": large}
    for fitted, names in wholes.items():
        fitted_on = [records[each] for each in names]
        law = compare(fitted_on, families=["two stops"]).best.model
        errors = {
            each: 100 * float(metrics.nrmse(record.w, simulate(law, record).w))
            for each, record in records.items()
        }
        own = float(np.mean([errors[each] for each in names]))
        rest = [error for each, error in errors.items() if each not in names]
        unseen = float(np.mean(rest)) if rest else None
        count = len(law.parameters())
        yield Remembered(name, fitted, count, own, unseen, str(law))


def _piezo():
    first, second = datasets.load("piezo_yan9a").split(0.5)
    first = first.window(_START_UP, len(first))
    span = float(jnp.ptp(first.u))
    for time in _TIMES:
        fast = Lag([time])
        library = _CONSTANT + fast + fast * fast + fast * fast * fast
        for share in _PLAYS:
            library = library + Lag([time], of=f"play(u,{span * share!r})")
        library = library + Lag(_CREEP)
        law = identify(first, library, LeastSquares(), formulation=Direct()).value
        own, unseen = (
            float(metrics.rmse(each.w, simulate(law, each).w))
            for each in (first, second)
        )
        fitted = f"2 s to 20 s, lag of {1000 * time:g} ms"
        yield Remembered("piezo_yan9a", fitted, len(library), own, unseen, str(law))
