import ctypes
import os
import re
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

import numpy as np
import pytest
from exported import DEVICES, GCC, MORE, RECORD, STRICT, W0, Fading, T, U

import hystjax as hj
from hystjax import InputError
from hystjax.export import fmu
from hystjax.simulation import FixedStep

pytestmark = pytest.mark.skipif(GCC is None, reason="no C compiler here")

# An interpreter with FMPy: `make fmu` names one that has nothing of hystjax beside it.
PYTHON = os.environ.get("FMU_PYTHON", sys.executable)
ALONE = Path(__file__).with_name("fmu_alone.py")

ALL = DEVICES | MORE
SOME = ("rate",)
OTHERS = ("lugre", "memory", "preisach")
REST = sorted(ALL.keys() - {*SOME, *OTHERS})
# Its force sees the derivative of the input, which FMPy's master sets after it has
# asked for the output.
LATE = ("lugre",)


def simulated(devices, folder, start=0.0):
    """Outputs by both masters, of both versions of the interface, by name and
    version."""
    du = np.diff(U) / np.diff(T)
    ends = np.append(du, du[-1])  # as hystjax takes it where the record ends
    np.save(folder / "input.npy", np.stack([start + T, U, ends]))
    units = {
        (name, version): fmu(folder / f"{name}{version}.fmu", device, **how)
        for name, device in devices.items()
        for version in (2, 3)
        for how in [{"version": version, "name": name}]
    }
    command = [PYTHON, ALONE, str(W0), *(path.name for path in units.values())]
    subprocess.run(command, cwd=folder, check=True, env={})
    return {key: np.load(f"{path}.npy") for key, path in units.items()}


def compared(names, folder):
    devices = {name: ALL[name] for name in names}
    for (name, version), (by_fmpy, by_hand) in simulated(devices, folder).items():
        expected = hj.simulate(ALL[name], RECORD, w0=W0, method=FixedStep(1)).w
        size = np.max(np.abs(expected))
        for w in (by_hand,) if name in LATE else (by_fmpy, by_hand):
            message = f"{name}, FMI {version}"
            np.testing.assert_allclose(
                w, expected, rtol=0, atol=1e-9 * size, err_msg=message
            )


def test_fmpy_finds_no_fault_and_simulates_as_hystjax(tmp_path):
    compared(SOME, tmp_path)


def test_the_time_begins_where_the_experiment_does(tmp_path):
    device = Fading(2.0)
    for both in simulated({"fading": device}, tmp_path, start=5.0).values():
        faded = np.stack([device.along(5 + T, U)] * 2)
        np.testing.assert_allclose(both, faded, rtol=0, atol=1e-9)


@pytest.mark.slow
def test_other_families_in_fmpy(tmp_path):
    compared(OTHERS, tmp_path)


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


def test_functions_of_a_law_are_seen_by_its_own_unit_alone(tmp_path):
    """Or the law of another unit in the process would take their place."""
    path = fmu(tmp_path / "law.fmu", DEVICES["rate"])
    with zipfile.ZipFile(path) as unit:
        unit.extractall(tmp_path)
    unit = ctypes.CDLL(str(tmp_path / "binaries/linux64/law.so"))
    assert hasattr(unit, "fmi2DoStep")
    for name in ("init", "step", "output"):
        assert not hasattr(unit, f"law_{name}")


def test_there_are_two_versions(unchecked):
    with pytest.raises(InputError, match="`version` of the interface must be 2 or 3"):
        fmu("law.fmu", DEVICES["rate"], version=1)
    with pytest.raises(InputError, match="`version` must be a whole number"):
        fmu("law.fmu", DEVICES["rate"], version=2.0)


def test_sources_that_cannot_be_compiled_are_all_that_is_packed(tmp_path, monkeypatch):
    broken = tmp_path / "cc"
    broken.write_text("#!/bin/sh\necho 'fatal error: no math.h' >&2\nexit 1\n")
    broken.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.warns(UserWarning, match=r"no binary.*cc did not.*\(fatal error: no"):
        path = fmu(tmp_path / "law.fmu", DEVICES["rate"])
    with zipfile.ZipFile(path) as archive:
        names = archive.namelist()
    assert "sources/law.c" in names and not any("binaries" in each for each in names)

    def full():
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(tempfile, "TemporaryDirectory", full)
    with pytest.warns(UserWarning, match=r"no binary.*\(.*No space left on device\)"):
        fmu(path, DEVICES["rate"])


def test_a_step_that_is_refused_takes_no_time(tmp_path):
    path = fmu(tmp_path / "law.fmu", DEVICES["rate"])
    with zipfile.ZipFile(path) as unit:
        unit.extractall(tmp_path)
    said = (tmp_path / "modelDescription.xml").read_text(encoding="utf-8")
    guid = re.search('guid="(.*?)"', said)[1].encode()
    (time,) = re.findall(r'name="time" valueReference="(\d+)"', said)
    unit = ctypes.CDLL(str(tmp_path / "binaries/linux64/law.so"))
    unit.fmi2Instantiate.restype = ctypes.c_void_p
    law = ctypes.c_void_p(unit.fmi2Instantiate(b"law", 1, guid, None, None, 0, 0))
    real, which = ctypes.c_double, (ctypes.c_uint * 1)(int(time))
    unit.fmi2SetupExperiment(law, 0, real(0), real(2), 0, real(0))
    unit.fmi2EnterInitializationMode(law)
    unit.fmi2ExitInitializationMode(law)
    assert unit.fmi2DoStep(law, real(2), real(-1), 1) != 0
    now = real(0)
    unit.fmi2GetReal(law, which, ctypes.c_size_t(1), ctypes.byref(now))
    assert now.value == 2.0
    unit.fmi2FreeInstance(law)
