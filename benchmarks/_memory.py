"""How much memory a call takes."""

import multiprocessing
import re
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import jax


def peak(call: Callable[..., Any], *arguments: Any) -> float:
    """Most memory of a process of its own that does nothing but this call, MiB. As
    Linux tells it."""
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(1, mp_context=context) as pool:
        return pool.submit(_alone, call, *arguments).result()


def _alone(call: Callable[..., Any], *arguments: Any) -> float:
    jax.config.update("jax_enable_x64", True)
    call(*arguments)
    # Not `getrusage`, whose figure begins with that of the process that started this.
    status = Path("/proc/self/status").read_text()
    found = re.search(r"VmHWM:\s+(\d+) kB", status)
    return int(found[1]) / 1024 if found else float("nan")
