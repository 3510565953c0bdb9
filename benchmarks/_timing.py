"""Time contestants in turns, so that what slows the machine slows them all."""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import jax
import numpy as np


@dataclass(frozen=True)
class Contestant:
    """A call to be timed.

    **Attributes:**

    - `call`: does the work; what it returns is waited for.
    - `pieces`: how many pieces of work, fits say, one call does.
    """

    call: Callable[[], Any]
    pieces: int = 1


@dataclass(frozen=True)
class Effort:
    """How much time a race may take.

    **Attributes:**

    - `rounds`: turns of each contestant.
    - `turn`: a contestant is called until its turn has lasted this long, s, and at
        least once.
    - `pause`: rest before each turn, s. Threads of linear algebra spin for some time
        after their last call, and would slow the next contestant.
    - `patience`: a contestant that has taken this long in all, s, and has made a warm
        call, gets no further turns.
    """

    rounds: int
    turn: float
    pause: float
    patience: float


FULL = Effort(rounds=20, turn=0.1, pause=0.05, patience=30.0)
QUICK = Effort(rounds=2, turn=0.0, pause=0.0, patience=1.0)


@dataclass(frozen=True)
class Timing:
    """Durations of one contestant's calls.

    **Attributes:**

    - `first`: the first call, s, which imports, compiles and fills caches.
    - `warm`: the calls after it, s.
    - `pieces`: pieces of work a call.
    - `result`: what the first call returned, to compare with the others'.
    """

    first: float
    warm: tuple[float, ...]
    pieces: int = 1
    result: Any = None

    @property
    def quantiles(self) -> tuple[float, float, float, float]:
        """Minimum, lower quartile, median and upper quartile of the warm calls, s a
        piece of work."""
        found = np.quantile(self.warm, (0, 0.25, 0.5, 0.75)) / self.pieces
        low, lower, median, upper = map(float, found)
        return low, lower, median, upper

    @property
    def median(self) -> float:
        """Median of the warm calls, s a piece of work."""
        return self.quantiles[2]

    def as_dict(self) -> dict[str, float]:
        """For JSON: times in s a piece of work, the first call's in s a call."""
        low, lower, median, upper = self.quantiles
        return {
            "median": median,
            "minimum": low,
            "lower_quartile": lower,
            "upper_quartile": upper,
            "first_call": self.first,
            "warm_calls": len(self.warm),
            "pieces_a_call": self.pieces,
        }


def race(
    contestants: Mapping[str, Contestant],
    effort: Effort,
    *,
    clock: Callable[[], float] = time.perf_counter,
    sleep: Callable[[float], None] = time.sleep,
) -> dict[str, Timing]:
    """Let contestants take turns: A B … A B …, after one first call of each."""

    def timed(contestant: Contestant) -> tuple[float, Any]:
        start = clock()
        result = jax.block_until_ready(contestant.call())
        return clock() - start, result

    def take_turn(contestant: Contestant) -> list[float]:
        sleep(effort.pause)
        calls = [timed(contestant)[0]]
        while sum(calls) < effort.turn:
            calls.append(timed(contestant)[0])
        return calls

    first = {name: timed(contestant) for name, contestant in contestants.items()}
    warm: dict[str, list[float]] = {name: [] for name in contestants}
    for _ in range(effort.rounds):
        for name, contestant in contestants.items():
            if not warm[name] or first[name][0] + sum(warm[name]) < effort.patience:
                warm[name] += take_turn(contestant)
    return {
        name: Timing(took, tuple(warm[name]), contestants[name].pieces, result)
        for name, (took, result) in first.items()
    }
