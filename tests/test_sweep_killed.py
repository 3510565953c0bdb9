"""A sweep that is killed again and again, against one that is left alone."""

import time

import numpy as np
import pytest
import sweep_job
import xarray
from test_sweep_devices import ended, started

KILLS = 8


def kept(folder):
    """When each finished chunk was written."""
    return {file.name: file.stat().st_mtime_ns for file in folder.glob("chunk-*.npz")}


def kill(run, folder, more, delay):
    """End a run once it has written some more chunks, or was done with all before."""
    enough = len(kept(folder)) + more
    while len(kept(folder)) < enough and run.poll() is None:
        time.sleep(0.0005)
    time.sleep(delay)
    run.kill()
    run.communicate()


@pytest.mark.slow
def test_killed_at_random_moments_and_resumed_gives_the_same(tmp_path):
    random = np.random.default_rng(0)
    folder, result = tmp_path / "sweep", tmp_path / "result"
    settings = {"seeds": 100, "chunk": 2, "batch": 2, "out": str(folder)}
    environment = {"JAX_COMPILATION_CACHE_DIR": str(tmp_path / "compiled")}
    environment["JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS"] = "0"
    written = {}
    for _ in range(KILLS):
        run = started(result, settings, environment)
        more = random.integers(0, 8)  # none: while it starts
        kill(run, folder, more, random.uniform(0, 0.01 if more else 2.0))
        before, written = written, kept(folder)
        # No chunk is lost, and none that was there is made again.
        assert before.items() <= written.items()
    assert not result.exists() and len(written) > KILLS
    found = ended(started(result, settings, environment), result)["dataset"]
    assert written.items() <= kept(folder).items()
    xarray.testing.assert_identical(found, sweep_job.sweep(seeds=100, chunk=2, batch=2))
