"""Functional mock-up units in the hands of FMPy: validated, and led along an input.

`python fmu_alone.py W0 UNIT ...`, beside an `input.npy` of times, inputs and their
derivatives, writes UNIT.npy: outputs as FMPy's own master finds them, and as a master
does that sets the inputs of a sample before it asks for the output there.
"""

import sys

sys.modules["hystjax"] = sys.modules["jax"] = None  # as if there were neither

import fmpy
import numpy as np
from fmpy.fmi2 import FMU2Slave
from fmpy.fmi3 import FMU3Slave
from fmpy.validation import validate_fmu


def simulated(path, w0, t, u, du):
    """Outputs by FMPy's master, which asks before it sets inputs."""
    h = t[1] - t[0]
    signals = np.array(
        list(zip(t, u, du, strict=True)),
        dtype=[(name, float) for name in ("time", "u", "du")],
    )
    run = fmpy.simulate_fmu(
        path,
        start_time=t[0],
        stop_time=t[-1],
        step_size=h,
        output_interval=h,
        input=signals,
        start_values={"w0": w0},
        output=["w"],
    )
    return run["w"]


def stepped(path, w0, t, u, du):
    """Outputs with the inputs of their own samples."""
    about = fmpy.read_model_description(path)
    numbers = {each.name: each.valueReference for each in about.modelVariables}
    second = about.fmiVersion.startswith("2")
    unit = (FMU2Slave if second else FMU3Slave)(
        guid=about.guid if second else about.instantiationToken,
        unzipDirectory=fmpy.extract(path),
        modelIdentifier=about.coSimulation.modelIdentifier,
        instanceName="unit",
    )
    put, get = (
        (unit.setReal, unit.getReal) if second else (unit.setFloat64, unit.getFloat64)
    )
    inputs = [numbers["u"], numbers["du"]]
    unit.instantiate()
    if second:
        unit.setupExperiment(startTime=t[0])
        unit.enterInitializationMode()
    else:
        unit.enterInitializationMode(startTime=t[0])
    put([numbers["w0"], *inputs], [w0, u[0], du[0]])
    unit.exitInitializationMode()
    w = []
    for i, time in enumerate(t):
        put(inputs, [u[i], du[i]])
        w += get([numbers["w"]])
        if i + 1 < len(t):
            unit.doStep(time, t[i + 1] - time)
    unit.terminate()
    unit.freeInstance()
    return np.array(w)


def main(w0, paths):
    signals = np.load("input.npy")
    for path in paths:
        problems = validate_fmu(path)
        assert not problems, problems
        both = [run(path, w0, *signals) for run in (simulated, stepped)]
        np.save(f"{path}.npy", np.array(both))


if __name__ == "__main__":
    main(float(sys.argv[1]), sys.argv[2:])
