"""Work that is mostly compiling, side by side."""

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from typing import Any, TypeVar

import jax

_MOST = 4  # more would wait for Python, which traces one program at a time

_Item = TypeVar("_Item")
_Result = TypeVar("_Result")


def side_by_side(
    function: Callable[[_Item], _Result], items: Sequence[_Item]
) -> Iterator[tuple[_Item, _Result]]:
    """Each item with what the function makes of it, in the order in which they are
    done: as many at a time as there are processors."""
    # What a caller has set for its own thread holds in these, too.
    settings: Any = jax.config  # whose attributes are made as it runs
    wide, device = settings.jax_enable_x64, settings.jax_default_device

    def call(item: _Item) -> _Result:
        with jax.enable_x64(wide), jax.default_device(device):
            return function(item)

    pool = ThreadPoolExecutor(min(_MOST, _processors()))
    try:
        running = {pool.submit(call, item): item for item in items}
        for done in as_completed(running):
            yield running[done], done.result()
    finally:  # who stops waiting does not wait for what has not begun
        pool.shutdown(cancel_futures=True)


def _processors() -> int:
    """That this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
