"""Sweeps on several devices and in several processes, against one device."""

import json
import os
import pickle
import socket
import subprocess
import sys

import jax
import numpy as np
import pytest
import sweep_job
import xarray
from pages import ROOT, blocks

JOB = sweep_job.__file__
FLAG = "--xla_force_host_platform_device_count=4"
FOUR = {"XLA_FLAGS": f"{os.environ.get('XLA_FLAGS', '')} {FLAG}"}


def started(result, settings, environment=None):
    return subprocess.Popen(
        [sys.executable, JOB, str(result), json.dumps(settings)],
        env={**os.environ, "PYTHONPATH": str(ROOT), **(environment or {})},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )


def ended(process, result):
    printed, _ = process.communicate(timeout=300)
    assert process.returncode == 0, printed
    return pickle.loads(result.read_bytes())


@pytest.fixture(scope="module")
def alone():
    return sweep_job.sweep(batch=2)


def four_devices(tmp_path, function):
    settings = {"function": function, "batch": 2, "look": True}
    found = ended(started(tmp_path / "four", settings, FOUR), tmp_path / "four")
    assert found["devices"] == 4
    ours, loose = found["collectives"]
    assert ours == []
    assert "all-reduce" in loose  # what `shard_map` is for
    return found["dataset"]


def test_four_devices_give_the_numbers_of_one_and_do_not_talk(tmp_path, alone):
    # Bit for bit: each device runs the same batches that one alone would.
    xarray.testing.assert_identical(four_devices(tmp_path, "identified"), alone)


@pytest.mark.slow
def test_four_devices_refine_the_same_and_do_not_talk(tmp_path):
    found = four_devices(tmp_path, "refined")
    alone = sweep_job.sweep("refined", batch=2)
    xarray.testing.assert_identical(found["result"], alone["result"])
    # Not to the last bit: a sum of squares may be fused, and then rounded, otherwise in
    # a program for several devices.
    numbers = [each.drop_vars("result") for each in (found, alone)]
    xarray.testing.assert_allclose(*numbers, rtol=1e-12, atol=0)


@pytest.mark.slow
def test_two_processes_share_a_sweep(tmp_path, alone):
    with socket.socket() as free:
        free.bind(("localhost", 0))
        address = f"localhost:{free.getsockname()[1]}"
    settings = {"batch": 2, "chunk": 4, "out": str(tmp_path / "sweep")}
    results = [tmp_path / "first", tmp_path / "second"]
    runs = []
    for number, result in enumerate(results):
        about = {"coordinator_address": address, "num_processes": 2}
        about["process_id"] = number
        runs.append(started(result, {**settings, "processes": about}))
    for run, result in zip(runs, results, strict=True):
        found = ended(run, result)
        assert found["processes"] == 2
        xarray.testing.assert_identical(found["dataset"], alone)
    assert len(list((tmp_path / "sweep").glob("chunk-*.npz"))) == 5


@pytest.mark.slow
@pytest.mark.recordings
def test_the_job_in_the_documentation_runs(tmp_path, monkeypatch, capsys):
    text = (ROOT / "docs" / "clusters.md").read_text(encoding="utf-8")
    (job,) = (block for block in blocks(text) if block.startswith("# sweep.py"))
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(jax.distributed, "initialize", lambda: None)
    found = {}
    exec(job.replace("10_000", "2"), found)
    assert "standard_errors.w" in capsys.readouterr().out
    assert np.all(found["found"]["result"] == "successful")


ON_ONE_CORE = """
import os
os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
import jax
jax.config.update("jax_enable_x64", True)
import hystjax as hj
import numpy as np

t = np.linspace(0, 20, 1000)
library = hj.library.Polynomial(2, hj.library.VARIABLES)

def fit(seed, u, w):
    noisy = w + 0.01 * jax.random.normal(jax.random.key(seed), w.shape)
    found = hj.identify(hj.Recording(t, u, noisy), library, throw=False)
    return hj.Solution(found.value, found.result, {})

shared = {"u": np.sin(t), "w": np.sin(t - 0.3)}
space = hj.sweeping.Grid(seed=range(4096))
print(hj.sweep(fit, space, shared=shared, devices=jax.devices()).sizes["seed"])
"""


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="Linux pins processes")
def test_two_devices_on_one_core_do_not_wait_for_each_other():
    two = {"XLA_FLAGS": "--xla_force_host_platform_device_count=2"}
    kept = {name: value for name, value in os.environ.items() if name != "NPROC"}
    ended = subprocess.run(
        [sys.executable, "-c", ON_ONE_CORE],
        env={**kept, **two, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=300,  # it takes seconds, or for ever
    )
    assert ended.stdout.split() == ["4096"], ended.stderr
