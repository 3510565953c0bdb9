"""What everything else stands on: errors, checks, compiling, results, files.

Threads enough for XLA on few cores are asked for here, before its first array. The
LAPACK kernels of jaxlib (0.10) hand a batch to the threads of XLA's pool, and wait
for them in one of these threads. Where as many kernels wait as there are threads, they
wait for ever, as two devices on one core do each time. XLA has a thread for each core,
or as many as `NPROC` in the environment says when its first array is made.
"""

import os

_LEAST = 8

os.environ.setdefault("NPROC", str(max(_LEAST, os.cpu_count() or 1)))
