import subprocess
import sys
import zipfile

import numpy as np
import pytest
from exported import DEVICES, GCC, RECORD, STRICT, W0, T, U

import hystjax as hj
from hystjax import InputError
from hystjax.export import fmu
from hystjax.simulation import FixedStep

pytestmark = pytest.mark.skipif(GCC is None, reason="no C compiler here")

# As in an environment that has neither hystjax nor JAX.
SIMULATED = """
import sys
sys.modules["hystjax"] = sys.modules["jax"] = None
import fmpy, numpy as np
from fmpy.validation import validate_fmu
t, u, du = np.load("input.npy")
rows = list(zip(t, u, du))
signals = np.array(rows, dtype=[(name, float) for name in ("time", "u", "du")])
h = t[1] - t[0]
for path in sys.argv[2:]:
    problems = validate_fmu(path)
    assert not problems, problems
    run = fmpy.simulate_fmu(
        path, start_time=t[0], stop_time=t[-1], step_size=h, output_interval=h,
        input=signals, start_values={"w0": float(sys.argv[1])}, output=["w"],
    )
    np.save(path + ".npy", run["w"])
"""

SOME = ("rate",)
MORE = ("memory", "preisach")
# FMPy asks for outputs before it sets inputs, and the force of LuGre sees the latter.
REST = sorted(DEVICES.keys() - {*SOME, *MORE, "lugre"})


def simulated(names, folder):
    """Outputs by FMPy, of both versions of the interface, by name and version."""
    du = np.append(np.diff(U) / np.diff(T), 0.0)
    np.save(folder / "input.npy", np.stack([T, U, du]))
    (folder / "run.py").write_text(SIMULATED, encoding="utf-8")
    units = {
        (name, version): fmu(folder / f"{name}{version}.fmu", DEVICES[name], **how)
        for name in names
        for version in (2, 3)
        for how in [{"version": version, "name": name}]
    }
    command = [
        sys.executable,
        "run.py",
        str(W0),
        *(path.name for path in units.values()),
    ]
    subprocess.run(command, cwd=folder, check=True, env={})
    return {key: np.load(f"{path}.npy") for key, path in units.items()}


def compared(names, folder):
    for (name, version), w in simulated(names, folder).items():
        expected = hj.simulate(DEVICES[name], RECORD, w0=W0, method=FixedStep(1)).w
        size = np.max(np.abs(expected))
        message = f"{name}, FMI {version}"
        np.testing.assert_allclose(
            w, expected, rtol=0, atol=1e-9 * size, err_msg=message
        )


def test_fmpy_finds_no_fault_and_simulates_as_hystjax(tmp_path):
    compared(SOME, tmp_path)


@pytest.mark.slow
def test_other_families_in_fmpy(tmp_path):
    compared(MORE, tmp_path)


@pytest.mark.thorough
def test_all_families_in_fmpy(tmp_path):
    compared(REST, tmp_path)


@pytest.mark.parametrize("version", [2, 3])
def test_they_compile_from_their_sources(tmp_path, version):
    path = fmu(tmp_path / "law.fmu", DEVICES["rate"], version=version, record=RECORD)
    with zipfile.ZipFile(path) as archive:
        archive.extractall(tmp_path)
    command = [GCC, *STRICT, "-fPIC", "-shared", f"fmi{version}.c", "-o", "law.so"]
    subprocess.run([*command, "-lm"], cwd=tmp_path / "sources", check=True)
    again = fmu(tmp_path / "again.fmu", DEVICES["rate"], version=version, record=RECORD)
    assert again.read_bytes() == path.read_bytes()


def test_there_are_two_versions():
    with pytest.raises(InputError, match="`version` of the interface must be 2 or 3"):
        fmu("law.fmu", DEVICES["rate"], version=1)
