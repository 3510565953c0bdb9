"""What everything else stands on: errors, checks, compiling, results, files.

Threads enough for XLA on few cores are asked for here, before its first array. The
LAPACK kernels of jaxlib (0.10) hand a batch to the threads of XLA's pool, and wait
for them in one of these threads. Where as many kernels wait as there are threads, they
wait for ever, as two devices on one core do each time. XLA has a thread for each core,
or as many as `NPROC` in the environment says when its first array is made.
"""

import gc
import os
from collections.abc import Iterator
from contextlib import contextmanager

_LEAST = 8

os.environ.setdefault("NPROC", str(max(_LEAST, os.cpu_count() or 1)))


@contextmanager
def uncollected() -> Iterator[None]:
    """Nothing is looked through for garbage meanwhile, and what is made counts as old:
    as new it would be looked through next, all of it."""
    collects = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if gc.get_freeze_count() == 0:  # or what others have frozen would thaw too
            gc.freeze()
            gc.unfreeze()  # into the oldest generation
        if collects:
            gc.enable()
