"""Peers on all cores, by joblib."""

import functools
import time
from collections.abc import Callable, Sequence
from typing import Any

from joblib import Parallel, delayed

from ._machine import cores

_WORKERS = max(2, cores())
_PAUSE = 2.0  # s in which each process finds a call of its own
JOBLIB = f"joblib, {_WORKERS} processes"


@functools.cache
def _start(function: Callable) -> None:
    """Let every process import what the function needs: no turn should pay for that."""
    Parallel(n_jobs=_WORKERS)(delayed(_imported)(function) for _ in range(_WORKERS))


def _imported(function: Callable) -> None:
    time.sleep(_PAUSE)


def in_parallel(
    function: Callable, arguments: Sequence[tuple[Any, ...]]
) -> Callable[[], list[Any]]:
    """A call that shares calls out to processes, which are kept for the next time."""
    _start(function)
    calls = [delayed(function)(*each) for each in arguments]
    return lambda: Parallel(n_jobs=_WORKERS)(calls)
