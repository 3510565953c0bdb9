"""How much memory a call takes."""

import multiprocessing
import resource
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from typing import Any

import jax


def peak(call: Callable[..., Any], *arguments: Any) -> float:
    """Most memory of a process of its own that does nothing but this call, MiB."""
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(1, mp_context=context) as pool:
        return pool.submit(_alone, call, *arguments).result()


def _alone(call: Callable[..., Any], *arguments: Any) -> float:
    jax.config.update("jax_enable_x64", True)
    call(*arguments)
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
