"""Table III: sparse laws of the measured piezo, an evolutionary fit and networks, timed
and judged."""

import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import jax
import numpy as np

from .._core.solution import Solution
from ..library import VARIABLES, Polynomial
from ..models import SparseModel
from ..recording import Recording, datasets
from ..refinement import Huber, refine
from ..regression import LeastSquares, identify
from ..simulation import FixedStep, judge, simulate
from ._devices import piezo
from ._document import AbstractDocument, shown
from ._measured import PIEZO_SCALE
from ._published import features, published_settings
from .baselines import (
    FCN,
    GRU,
    LSTM,
    TCN,
    AbstractSequenceBaseline,
    DifferentialEvolution,
    Stage,
)

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
_TITLE = "Table III: measured piezo actuator (NRMSE of free runs in %, times in s)"
_NOTES = (
    "Fitted to rows 35000:45000, the first line as in the paper to 35001:45001 with "
    "its sine; unseen are rows 17500:35000. Noise at rest: 0.124 %.",
    "Training: the first fit, which compiles (or loads what an earlier process of the "
    "command line compiled), and another, warm. Warm networks are their epochs at the "
    "pace measured after the first 50 of each stage, not a second training. Testing: a "
    "warm free run over the own rows.",
    "The four terms are those that `discover` finds in subsets of 18 terms; "
    "its 13 s, 3 s once compiled, are not in the time of learning and refining them.",
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
    return MethodTable(_TITLE, rows, (*_NOTES, *_verdicts(sparse[-1], networks)))


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
