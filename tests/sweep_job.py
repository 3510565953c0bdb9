"""A sweep in a process of its own, for tests that need several, or kill them:
`python sweep_job.py RESULT SETTINGS`, settings being JSON."""

import json
import os
import pickle
import re
import sys
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import NamedSharding, PartitionSpec

import hystjax as hj
from hystjax import sweeping
from hystjax.sweeping import _sweep

T = np.linspace(0, 20, 201)
COLLECTIVE = r"all-reduce|all-gather|all-to-all|collective-\w+|reduce-scatter"


def record(noise, seed):
    path = hj.interpolation.Linear().path(jnp.asarray(T), jnp.sin(T))
    law, step = hj.models.Duhem(0.4, 0.5, 0.25), hj.simulation.FixedStep()
    w = hj.simulate(law, path, w0=0.0, method=step, throw=False).w
    drawn = jax.random.normal(jax.random.key(seed), T.shape)
    return hj.Recording(T, np.sin(T), w + noise * drawn)


def identified(noise, seed):
    library, settings = hj.library.Polynomial(2), hj.regression.STLSQ(0.1)
    return hj.identify(record(noise, seed), library, settings, throw=False)


def refined(noise, seed):
    return hj.refine(hj.models.Duhem(0.5, 0.6, 0.2), record(noise, seed), throw=False)


FUNCTIONS = {"identified": identified, "refined": refined}


def sweep(function="identified", seeds=6, **options):
    space = sweeping.Grid(noise=[0.0, 0.01, 3.0], seed=range(seeds))
    return hj.sweep(FUNCTIONS[function], space, **options)


def collectives(function="identified", **_):
    """What devices say to each other: in the program of a sweep, and in one that has
    its lanes shared out by the compiler."""
    space = sweeping.Grid(noise=[0.0, 0.01, 3.0, 5.0], seed=range(2))
    lane = _sweep.Lane(FUNCTIONS[function], space, {})
    program = _sweep.planned(lane, jax.local_devices(), 2**30, 8, 2)
    spread = NamedSharding(program.mesh, PartitionSpec("lanes"))
    loose = jax.jit(jax.vmap(lane), in_shardings=spread)
    texts = program.compiled.as_text(), loose.lower(np.arange(8)).compile().as_text()
    return [sorted(set(re.findall(COLLECTIVE, text))) for text in texts]


def main(result, settings):
    settings = json.loads(settings)
    jax.config.update("jax_enable_x64", True)
    if "processes" in settings:
        jax.distributed.initialize(**settings.pop("processes"))
    found = {"devices": jax.local_device_count(), "processes": jax.process_count()}
    if settings.pop("look", False):
        found["collectives"] = collectives(**settings)
    found["dataset"] = sweep(**settings)
    part = Path(f"{result}.part")
    part.write_bytes(pickle.dumps(found))
    os.replace(part, result)


if __name__ == "__main__":
    main(*sys.argv[1:])
