"""Calls in processes of their own."""

import multiprocessing
import re
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import jax


def process(devices: int | None = None) -> ProcessPoolExecutor:
    """A new process with 64-bit floats; on request one that takes the processor for so
    many devices. It ends with its `with` block."""
    context = multiprocessing.get_context("spawn")
    return ProcessPoolExecutor(
        1, mp_context=context, initializer=_begun, initargs=(devices,)
    )


def peak(call: Callable[..., Any], *arguments: Any) -> float:
    """Most memory of a process of its own that does nothing but this call, MiB. As
    Linux tells it."""
    with process() as alone:
        return alone.submit(_measured, call, *arguments).result()


def _begun(devices: int | None) -> None:
    jax.config.update("jax_enable_x64", True)
    if devices is not None:  # what --xla_force_host_platform_device_count does
        jax.config.update("jax_platforms", "cpu")
        jax.config.update("jax_num_cpu_devices", devices)


def _measured(call: Callable[..., Any], *arguments: Any) -> float:
    call(*arguments)
    # Not `getrusage`, whose figure begins with that of the process that started this.
    status = Path("/proc/self/status").read_text()
    found = re.search(r"VmHWM:\s+(\d+) kB", status)
    return int(found[1]) / 1024 if found else float("nan")
