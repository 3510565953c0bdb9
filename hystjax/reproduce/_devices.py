"""Experiments on measured devices. 6 and 8: a piezo actuator and electrical steel.
Table III: sparse laws of that piezo, an evolutionary fit and networks, timed and
judged."""

import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from .._core.solution import Solution
from ..library import VARIABLES, Polynomial
from ..models import AbstractModel, Duhem, SparseModel
from ..plot import _canvas
from ..recording import Recording, datasets
from ..refinement import Huber, refine
from ..regression import LeastSquares, identify
from ..simulation import FixedStep, Trajectory, judge, simulate
from ._document import (
    AbstractDocument,
    Comparison,
    Row,
    Side,
    as_run,
    averaged,
    published_side,
    runs,
    shown,
    side_by_side,
)
from ._measured import COPIED_PIEZO, PIEZO_SCALE
from ._published import (
    MEASURES,
    REFINED_LAW,
    ROUNDED,
    ROUNDED_LAW,
    coefficient_rows,
    error_row,
    features,
    free_run_error,
    learned,
    percent,
    published_settings,
    squared_error,
    three_laws,
)
from .baselines import (
    FCN,
    GRU,
    LSTM,
    TCN,
    AbstractSequenceBaseline,
    DifferentialEvolution,
    Stage,
)

_SHORT = ("rounded law", "unrounded law", "refined law")
_PERIOD, _SAMPLES, _CYCLES = 10.0, 1000, 10
COPIED_STEEL = {
    "w": -0.814,
    "u": 0.651,
    "du": 2.983,
    "w*|w|": 0.063,
    "u*|du|": -0.026,
    "u*|w|": -0.058,
    "du*|du|": -0.132,
    "du*|w|": -0.061,
}
_STEEL_NOTES = (
    "The input is the flux density as the script has it, 20 sin(pi t/5 - 3 pi/2) in "
    "units of 0.01 T and with 10 s for the period of 0.1 s; the output is the field "
    "strength in A/m.",
    "There is no second loop to judge on. Instead the laws run on for ten periods: the "
    "last is compared with the measured one.",
    "Refined without regard for that, the law follows the one loop to 1.76e-3 % and "
    "then diverges; so laws are required to forget their initial value.",
    "HystLab's record is another loop of this steel, moment over field, 988 rows with "
    "no rate. The fitted moment beside it in the file has next to no hysteresis: it "
    "passes 0 where the measured branches are 9.2 A m2 from it on either side. The "
    "Duhem law, with u' times a polynomial of degree 2, is fitted to all rows.",
)


def experiment_8() -> Comparison:
    """Field strength of NO27-1450H steel over its flux density."""
    record = steel_loop()
    law = learned(record, threshold=0.01)
    laws = three_laws(law, COPIED_STEEL, record, fading=True)
    script, better = laws[ROUNDED_LAW], laws[REFINED_LAW]
    later = {name: _tenth_period(each, record) for name, each in laws.items()}
    other = hystlab()
    rows = [
        *coefficient_rows(law, {name: (None, x) for name, x in COPIED_STEEL.items()}),
        error_row(
            "script's rounded law", free_run_error(script, record), None, 1.477e-2
        ),
        error_row("unrounded law", free_run_error(law, record)),
        error_row("refined law", free_run_error(better, record)),
    ]
    for name, run in zip(_SHORT, later.values(), strict=True):
        rows.append(error_row(f"{name}, tenth period", _error(record, run)))
    theirs, ours = (_error(other.record, run) for run in other.runs.values())
    rows += [
        error_row("HystLab's record: HystLab's fit", theirs),
        error_row("  a Duhem law of five numbers", ours),
    ]
    title = "Experiment 8: NO27 steel, squared errors in %"
    notes = (str(law), f"refined: {better}", MEASURES, ROUNDED, *_STEEL_NOTES)
    drawing = partial(
        side_by_side,
        published_side({ROUNDED_LAW: script}, record, "measured"),
        Side("The tenth period", record, later, "measured"),
        other,
        draw_errors=_canvas.draw_error,
    )
    return Comparison(title, tuple(rows), notes, drawing)


def hystlab() -> Side:
    """HystLab's record of the steel: its own fit, and a Duhem law beside it."""
    record = datasets.load("no27_steel", "hystlab")
    slope = float(jnp.max(record.w) / jnp.max(record.u))
    beta = 5 / float(jnp.max(record.u))
    start = Duhem(beta * slope, beta, (slope, 0.0, 0.0))
    fit = refine(start, record, fading=True)
    run = simulate(fit.value, record, w0=fit.stats["w0"][0])
    theirs = as_run(record, datasets.no27_hystlab_fit())
    both = {"HystLab's fit": theirs, "a Duhem law": run}
    return Side("HystLab's record", record, both, "measured")


def steel_loop() -> Recording:
    """The measured loop with the time and the input of the script."""
    measured = datasets.load("no27_steel")
    t = np.linspace(0, _PERIOD, _SAMPLES)
    units = "0.01 T", measured.units[1]
    record = Recording(t, measured.u, measured.w, names=measured.names, units=units)
    return record.with_input(_sine)


def _sine(t):
    return 20 * jnp.sin(jnp.pi * t / 5 - 3 * jnp.pi / 2)


def _error(record: Recording, run: Trajectory) -> float:
    return squared_error(record.w, run.w)


def _tenth_period(law: AbstractModel, record: Recording) -> Trajectory:
    """The last of several periods under the same sine, at the times of the first."""
    t = np.linspace(0, _CYCLES * _PERIOD, _CYCLES * (_SAMPLES - 1) + 1)
    zero = np.zeros_like(t)
    longer = Recording(t, zero, zero).with_input(_sine)
    w = simulate(law, longer, w0=record.w[0], throw=False).w
    return as_run(record, w[-_SAMPLES:])


_PUBLISHED = {
    "1": (-0.176, -0.176),
    "w": (-2.38, -2.383),
    "u": (0.58, 0.580),
    "du": (0.12, 0.119),
    "w*|w|": (-0.076, -0.076),
}
_PIEZO_NOTE = (
    "The law is fitted to rows 35001:45001; rows 17500:35000 are unseen. `hystjax "
    "reproduce measured` refines laws of this and other devices."
)


def experiment_6() -> Comparison:
    """Measured piezo actuator, rows 35001:45001, judged on rows 17500:35000 too."""
    own, unseen = piezo(35001, 45001), piezo(17500, 35000)
    law = learned(own, threshold=0.01)
    laws = three_laws(law, COPIED_PIEZO, own, free_start=True)
    script, better = laws[ROUNDED_LAW], laws[REFINED_LAW]
    rounded, later = judge(script, own), judge(script, unseen)
    over_own = float(later.errors["rmse"]) / float(jnp.ptp(own.w))
    rows = (
        *coefficient_rows(law, _PUBLISHED),
        Row("NRMSE, own rows, %", 0.23, None, _nrmse(law, own)),
        Row("  with the script's rounded law", 0.23, 0.2328, percent(rounded, "nrmse")),
        Row("  with the refined law", None, None, _nrmse(better, own)),
        Row("NRMSE, unseen rows 17500:35000, %", None, None, _nrmse(law, unseen)),
        Row("  rounded law, unseen", None, None, percent(later, "nrmse")),
        Row(
            "  rounded law, over the range of the own rows", None, 0.248, 100 * over_own
        ),
        Row("  refined law, unseen", None, None, _nrmse(better, unseen)),
        Row("R2, own rows, rounded law", 0.99, 0.99996, float(rounded.errors["r2"])),
        Row(
            "squared error, own rows, rounded law, %",
            None,
            4.37e-3,
            percent(rounded, "relative_squared_error"),
            percent(rounded, "relative_error"),
        ),
    )
    title = "Experiment 6: measured piezo actuator, u = 150 sin(2 pi t - 46.2)"
    drawing = partial(
        side_by_side,
        published_side({ROUNDED_LAW: script}, own, "measured"),
        Side("On unseen rows", unseen, runs(laws, unseen), "measured"),
        draw_errors=averaged(101),
    )
    return Comparison(title, rows, (str(law), ROUNDED, _PIEZO_NOTE), drawing)


def _nrmse(law: AbstractModel, record: Recording) -> float:
    return percent(judge(law, record), "nrmse")


def piezo(start: int, stop: int) -> Recording:
    """Rows of the recording with its input replaced by the fitted sine, as the paper's
    script does."""
    record = datasets.load("piezo_ayala").window(start, stop)
    return record.with_input(_fitted_sine)


def _fitted_sine(t):
    return 150 * jnp.sin(6.28318530724 * t - 46.2178545458)


_CALLS = 5  # of which warm times are medians
_METHOD = FixedStep()
_COLUMNS = (
    ("", "own rows", "paper", "unseen", "training", "warm", "paper"),
    ("testing", "paper", "numbers"),
)


@dataclass(frozen=True)
class Published:
    """The paper's figures of a method: `nrmse`, %; `training` and `testing`, s."""

    nrmse: float | None = None
    training: float | None = None
    testing: float | None = None


@dataclass(frozen=True)
class Task:
    """What is fitted, the `own` rows, and what the fit is judged on, the `unseen`."""

    own: Recording
    unseen: Recording


@dataclass(frozen=True)
class Method:
    """How a method does.

    **Attributes:**

    - `name`: of the method.
    - `own`, `unseen`: NRMSE of the free run, %.
    - `training`, `warm`: s of the first fit, which compiles, and of one more.
    - `testing`: s of a free run along the own rows, warm.
    - `numbers`: how many the fit chooses.
    - `paper`: the paper's figures.
    """

    name: str
    own: float
    unseen: float
    training: float
    warm: float
    testing: float
    numbers: int
    paper: Published = Published()

    def cells(self) -> tuple[str, ...]:
        """What is shown, in the order of the columns."""
        times = (self.training, self.warm)
        return (
            self.name,
            shown(self.own, 4),
            shown(self.paper.nrmse),
            shown(self.unseen, 4),
            *(shown(each, 3) for each in times),
            shown(self.paper.training),
            shown(self.testing, 2),
            shown(self.paper.testing),
            str(self.numbers),
        )


@dataclass(frozen=True)
class MethodTable(AbstractDocument):
    """Methods side by side.

    **Attributes:**

    - `title`: what they are used on.
    - `rows`: the methods.
    - `notes`: lines below the table.
    """

    rows: tuple[Method, ...]

    def cells(self):
        """Headings, and a line a method."""
        return [sum(_COLUMNS, ()), *(row.cells() for row in self.rows)]


def tried(
    name: str,
    learn: Callable[[], Solution],
    task: Task,
    numbers: Callable[[Any], int],
    paper: Published = Published(),
    warm: Callable[[Solution], float] | None = None,
) -> Method:
    """Learn a model, once with compilation, and judge it.

    **Arguments:**

    - `numbers`: how many of a model are chosen by the fit.
    - `warm`: the time of a further fit, from what the first tells; measured by default.
    """
    solution, first = _timed(learn)
    again = _median(learn) if warm is None else warm(solution)
    model = solution.value
    own, unseen = (
        100 * float(judge(model, rows, method=_METHOD).errors["nrmse"])
        for rows in (task.own, task.unseen)
    )
    testing = _median(lambda: simulate(model, task.own, method=_METHOD, throw=False))
    return Method(name, own, unseen, first, again, testing, numbers(model), paper)


def _timed(call: Callable[[], Any]) -> tuple[Any, float]:
    begun = time.perf_counter()
    result = jax.block_until_ready(call())
    return result, time.perf_counter() - begun


def _median(call: Callable[[], Any]) -> float:
    return statistics.median(_timed(call)[1] for _ in range(_CALLS))


_KEY = jax.random.key(0)
_FOUR = features("1", "w", "u", "du*|du|")
# Wide, so that the search needs no knowledge of the law, and not centred on it.
_BOUNDS = {
    "1": (-20.0, 20.0),
    "w": (-100.0, 100.0),
    "u": (-20.0, 20.0),
    "du": (-1.0, 1.0),
    "w*|w|": (-5.0, 5.0),
}
_SINDY = Published(0.23, 1.8e-2, 4.5e-4)
_NETWORKS: tuple[tuple[AbstractSequenceBaseline, Published], ...] = (
    (LSTM(), Published(0.25, 104.83, 7.1e-3)),
    (GRU(), Published(0.30, 101.31, 5.4e-3)),
    (TCN(), Published(0.19, 61.57, 3.0e-3)),
    (FCN(), Published(0.60, 74.92, 3.4e-3)),
)
_TABLE_TITLE = (
    "Table III: measured piezo actuator (NRMSE of free runs in %, times in s)"
)
_TABLE_NOTES = (
    "Fitted to rows 35000:45000, the first line as in the paper to 35001:45001 with "
    "its sine; unseen are rows 17500:35000. Noise at rest: 0.124 %.",
    "Training: the first fit, which compiles (or loads what an earlier process of the "
    "command line compiled), and another, warm. Warm networks are their epochs at the "
    "pace measured after the first 50 of each stage, not a second training. Testing: a "
    "warm free run over the own rows.",
    "The four terms are the best of that number that `discover` finds, which chooses a "
    "law of five; its time is not in that of learning and refining them.",
    "Networks, free runs too, get the input, its slope, and the first output. Their "
    "learning rates and sizes were chosen by fitting rows 35000:40000 and judging "
    "40000:45000. The paper gives neither sizes nor settings of its networks, which "
    "are of Nguyen and Chauhan (2021), Meas. Sci. Technol. 32, 075004, and does not "
    "say what FCN stands for: here a fully convolutional network.",
    "One sine, the same before and after: input and slope tell the phase, and a "
    "network need not remember anything to reproduce such a record. This says nothing "
    "of another amplitude or frequency.",
    "The paper's times are of another machine, and that of SINDy is a difference of "
    "bare calls of timeit.timeit, which does not measure it.",
)


def table_3(epochs: int | None = None) -> MethodTable:
    """Table III of the paper on the measured piezo, with refined laws beside.

    **Arguments:** `epochs`: most epochs of each stage of a network's training, for a
    quick look; all by default.

    **Raises:** `InputError` when the recording cannot be had.
    """
    record = datasets.load("piezo_ayala")
    task = Task(record.window(35000, 45000), record.window(17500, 35000))
    sparse = _sparse(task)
    networks = [
        tried(
            type(each).__name__,
            partial(_train, each, task),
            task,
            lambda model: model.size,
            paper,
            partial(_warm, each),
        )
        for each, paper in (
            (_shortened(network, epochs), paper) for network, paper in _NETWORKS
        )
    ]
    evolved = tried("evolution, SINDy's terms", lambda: _evolve(task), task, _terms)
    rows = (*sparse, evolved, *networks)
    return MethodTable(
        _TABLE_TITLE, rows, (*_TABLE_NOTES, *_verdicts(sparse[-1], networks))
    )


def _sparse(task: Task) -> list[Method]:
    """SINDy as in the paper, its law refined, and four terms that do better."""
    sine = Task(piezo(35001, 45001), piezo(17500, 35000))
    return [
        tried("SINDy", lambda: _sindy(sine), sine, _terms, _SINDY),
        tried("SINDy, refined", lambda: _refined(_sindy(sine), task), task, _terms),
        tried("four terms, refined", lambda: four_terms(task), task, _terms),
    ]


def _sindy(task: Task) -> Solution:
    library = Polynomial(2, VARIABLES)
    return identify(task.own, library, published_settings(threshold=0.01))


def four_terms(task: Task) -> Solution:
    """The terms of the best law of that size, with the loss that suits the spikes."""
    law = identify(task.own, _FOUR, LeastSquares())
    return _refined(law, task, loss=Huber(1.345 * PIEZO_SCALE))


def _refined(law: Solution, task: Task, **how) -> Solution:
    return refine(law.value, task.own, substeps=1, throw=False, **how)


def _evolve(task: Task) -> Solution:
    law = SparseModel.from_terms(dict.fromkeys(_BOUNDS, 0.0))
    search = DifferentialEvolution(
        law, _BOUNDS, tolerance=1e-4, method=FixedStep(substeps=1)
    )
    return search.fit(task.own, key=_KEY)


def _shortened(
    network: AbstractSequenceBaseline, epochs: int | None
) -> AbstractSequenceBaseline:
    if epochs is None:
        return network
    stages = tuple(
        Stage(stage.window, min(stage.epochs, epochs)) for stage in network.stages
    )
    return replace(network, stages=stages)


def _train(network: AbstractSequenceBaseline, task: Task) -> Solution:
    return network.fit(task.own, key=_KEY, progress=True)


def _warm(network: AbstractSequenceBaseline, trained: Solution) -> float:
    epochs = [stage.epochs for stage in network.stages]
    return float(np.dot(trained.stats["pace"], epochs))


def _terms(law: SparseModel) -> int:
    return len(law.terms())


def _verdicts(law: Method, networks: Sequence[Method]) -> tuple[str, ...]:
    """What the figures say, whichever way."""
    times = [
        f"{each.name} {each.warm / law.warm:.3g} warm, "
        f"{each.training / law.training:.3g} with compilation"
        for each in networks
    ]
    better = [each.name for each in networks if each.unseen < law.unseen]
    return (
        f"Training over that of {law.name}, learned and refined: {'; '.join(times)}.",
        f"On unseen rows {', '.join(better) or 'no network'} "
        f"{'do' if len(better) > 1 else 'does'} better than {law.name}.",
    )
