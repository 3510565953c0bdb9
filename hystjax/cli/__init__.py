"""The command line `hystjax`: to fit, simulate and reproduce, and a demonstration."""

import gc

from ._main import main as main

# What is imported stays: looking through it for garbage over and over, while programs
# are traced, takes a tenth of the time to a first result.
gc.freeze()
