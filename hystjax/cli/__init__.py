"""The command line `hystjax`: to fit, simulate and reproduce, and a demonstration."""

import atexit
import gc

from ._main import main as main, run as run

# What is imported stays: looking through it for garbage over and over, while programs
# are traced, takes a tenth of the time to a first result.
gc.freeze()
# Nor need it be looked through once more when the process ends, all at once.
atexit.register(gc.freeze)
