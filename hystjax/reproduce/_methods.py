"""Ways to a model of a record, timed and judged."""

import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import jax

from .._judge import judge
from .._recording import Recording
from .._simulate import simulate
from .._solution import Solution
from ..simulation import FixedStep
from ._document import AbstractDocument, shown

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
