"""`hystjax invert` and `hystjax export`, as they are typed."""

import zipfile
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from test_cli import hystjax, write_csv

import hystjax as hj
from hystjax.cli._saved import _met
from hystjax.simulation import FixedStep

LAW = {"du": 0.25, "u*|du|": 0.05, "w*|du|": -0.1}
COLUMNS = ("--time", "t", "--input", "u", "--output", "w")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("machine")
    law = hj.models.SparseModel.from_terms(LAW, units=("V", "µm"))
    t = np.linspace(0, 10, 101)
    record = hj.Recording(t, np.sin(t), np.zeros_like(t))
    run = hj.simulate(law, record, w0=0.0, method=FixedStep(4))
    hj.save(folder / "law.json", law)
    write_csv(folder / "run.csv", np.stack([t, run.u, run.w], axis=1), "t,u,w")
    (folder / "no_law.json").write_text("{}")
    return folder


def table(path):
    return np.genfromtxt(path, delimiter=",", names=True)


@pytest.mark.parametrize("measured", [True, False])
def test_the_input_that_was_there_comes_back(folder, measured, tmp_path):
    out = tmp_path / "drive.csv"
    columns = COLUMNS if measured else ("--time", "t", "--output", "w")
    ran = hystjax(
        "invert", folder / "law.json", folder / "run.csv", *columns, "--out", out
    )
    assert ran.code == 0 and f"wrote {out}" in ran.out, ran.err
    assert ("off the measured input" in ran.out) == measured
    found = table(out)
    np.testing.assert_allclose(found["u"], np.sin(found["t"]), atol=1e-8)
    np.testing.assert_allclose(found["error"], 0, atol=1e-10)
    assert np.all(found["reached"] == 1) and np.all(found["margin"] > 0)


@pytest.mark.slow
def test_limits_are_kept_and_what_is_missed_is_said(folder, tmp_path):
    out = tmp_path / "drive.csv"
    files = folder / "law.json", folder / "run.csv"
    ran = hystjax("invert", *files, *COLUMNS, "--limits", "-0.5:0.5", "--out", out)
    assert ran.code == 0 and "not reached at" in ran.out, ran.err
    found = table(out)
    assert np.max(np.abs(found["u"])) <= 0.5
    first = found["t"][found["reached"] == 0][0]
    assert f"first at {first:.6g} s" in ran.out


def test_an_output_that_diverges_under_a_finite_input_is_no_result(folder, tmp_path):
    law = hj.models.SparseModel.from_terms({"du": 1.0, "w^2": 3.0, "1": 1.0})
    hj.save(tmp_path / "wild.json", law)
    files = tmp_path / "wild.json", folder / "run.csv"
    out = tmp_path / "drive.csv"
    ran = hystjax("invert", *files, *COLUMNS, "--limits", "-0.1:0.1", "--out", out)
    assert ran.code == 3 and "diverges on its way along the reference" in ran.err
    assert not out.exists()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--limits", "1"), "'1' is no range of inputs"),
        (("--u0", "nan"), "--u0 must be finite, got nan"),
        (("--speed", "-1"), "--speed must be positive"),
        (("--substeps", "0"), "--substeps must be at least 1"),
        (("--rows", "50:99999"), "99999"),
        (("--out", "run.csv"), "is the file run.csv that is read"),
    ],
)
def test_what_cannot_be_asked_for(folder, monkeypatch, arguments, message):
    monkeypatch.chdir(folder)
    ran = hystjax("invert", "law.json", "run.csv", *COLUMNS, *arguments)
    assert ran.code == 2 and message in ran.err
    assert not (folder / "inverse.csv").exists()


def test_numbers_of_samples_are_no_times(folder, tmp_path):
    law = hj.models.SparseModel.from_terms({"u": 1.0, "w": -1.0})
    hj.save(tmp_path / "lag.json", law)
    files = tmp_path / "lag.json", folder / "run.csv"
    out = "--out", tmp_path / "drive.csv"
    ran = hystjax("invert", *files, "--output", "w", *out)
    assert ran.code == 2 and "depends on the rate of the input" in ran.err
    # The law that does not is driven along, and is told of in numbers of samples.
    files = folder / "law.json", folder / "run.csv"
    columns = COLUMNS[2:]
    ran = hystjax("invert", *files, *columns, "--limits=-0.5:0.5", *out)
    found, record = table(tmp_path / "drive.csv"), table(folder / "run.csv")
    missed = found["reached"] == 0
    first = found["t"][missed][0]
    told = f"not reached at {np.sum(missed)} of 101 samples, first at sample {first:g}"
    assert ran.code == 0 and told in ran.out, ran.err
    assert "input from -0.5 to 0.5 V" in ran.out
    for said, name, unit in (
        ("output off by", "w", "µm"),
        ("off the measured input by", "u", "V"),
    ):
        rms = np.sqrt(np.mean((found[name] - record[name]) ** 2))
        share = 100 * rms / np.ptp(record[name])
        assert f"{said} {rms:.3g} {unit} rms, {share:.3g} % of its range" in ran.out


@pytest.mark.parametrize(("least", "said"), [(0.0, True), (0.1, False)])
def test_an_output_that_waits_has_more_than_one_input(least, said):
    record = hj.Recording(None, np.arange(3.0), np.arange(3.0))
    stats = {"reached": np.ones(3, bool), "margin": np.array([0.5, least, 0.2])}
    value = SimpleNamespace(u=np.arange(3.0), error=np.zeros(3))
    found = SimpleNamespace(value=value, stats=stats)
    told = list(
        _met(
            found,
            record,
            hj.models.SparseModel.from_terms(LAW),
            SimpleNamespace(input=None),
        )
    )
    line = (
        "other inputs lead to the same output, which does not follow the input one way "
        "everywhere: its least slope that way is 0"
    )
    assert (line in told) == said


FORMATS = {
    "c": "bool piezo_step(",
    "python": '"""piezo: made by hystjax',
    "matlab": "function [w, s] = piezo(",
    "modelica": "package piezo",
    "latex": r"\dot{w} = ",
    "text": "w' = ",
}


@pytest.mark.parametrize("to", FORMATS)
def test_laws_become_programs(folder, tmp_path, to):
    out = tmp_path / "piezo"
    ran = hystjax(
        "export", folder / "law.json", "--to", to, "--name", "piezo", "--out", out
    )
    assert ran.code == 0 and f"wrote {out}" in ran.out, ran.err
    assert FORMATS[to] in out.read_text(encoding="utf-8")


def test_the_recording_may_stand_behind_options(folder, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    law, record = folder / "law.json", folder / "run.csv"
    orders = {"a.c": (law, record, "--to", "c"), "b.c": (law, "--to", "c", record)}
    for name, order in orders.items():
        ran = hystjax("export", *order, *COLUMNS, "--out", name)
        assert ran.code == 0, ran.err
    first, second = (Path(name).read_text("utf-8") for name in orders)
    assert first == second and "Of the record: u from " in first


@pytest.mark.parametrize("version", [2, 3])
def test_laws_become_units(folder, monkeypatch, tmp_path, version):
    monkeypatch.chdir(tmp_path)
    law, record = folder / "law.json", folder / "run.csv"
    ran = hystjax("export", law, record, *COLUMNS, "--to", f"fmu{version}")
    assert ran.code == 0, ran.err
    with zipfile.ZipFile("law.fmu") as unit:
        assert b"Of the record: u from " in unit.read("sources/law.c")
        said = unit.read("modelDescription.xml")
    assert f'fmiVersion="{version}.0"'.encode() in said


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("law.json", "--to", "pascal"), "'pascal'"),
        (("law.json", "--to", "c", "--name", "a b"), "--name becomes part of names"),
        (("law.json", "--to", "python", "--name", "numpy"), "--name is 'numpy'"),
        (("law.json", "--to", "python", "--name", "class"), "--name is 'class'"),
        (("law.json", "--to", "c", "--out", "law.json"), "is the file law.json"),
        (("law.json", "--to", "c", "--out", "nowhere/law.c"), "there is no folder"),
        (("law.json", "run.csv", "--to", "c"), "--input and --output"),
        (("law.json", "--to", "c", "--rows", "0:9"), "--rows is of a recording"),
        (("law.json", "--to", "c", "--time-unit", "s"), "--time-unit is of a rec"),
        (("law.json", "run.csv", *COLUMNS, "--to", "text"), "the equation alone"),
        (("law.json", "--to", "c", "law.c"), "a file to write is named by --out"),
        (("law.json", "--to", "c", "run.csv", "law.c"), "unrecognized arguments: "),
        (("no_law.json", "--to", "c"), "no_law.json"),
    ],
)
def test_what_cannot_be_exported(folder, monkeypatch, arguments, message):
    monkeypatch.chdir(folder)
    before = {path: path.read_bytes() for path in folder.iterdir()}
    ran = hystjax("export", *arguments)
    assert ran.code == 2 and message in ran.err
    assert {path: path.read_bytes() for path in folder.iterdir()} == before


def test_units_of_a_column_are_not_those_of_another(folder, tmp_path):
    rows = table(folder / "run.csv")
    columns = np.stack([rows["t"], 1e3 * rows["u"], rows["w"]], axis=1)
    write_csv(tmp_path / "mV.csv", columns, "t,u (mV),w (µm)")
    law, file, out = folder / "law.json", tmp_path / "mV.csv", tmp_path / "out.csv"
    alone = hystjax("invert", law, file, "--time", "t", "--output", "w", "--out", out)
    assert " V\n" in alone.out.split("input from")[1] and not alone.err
    for arguments in (
        ("invert", law, file, *COLUMNS, "--out", out),
        ("simulate", law, file, *COLUMNS[:4], "--w0", "0", "--out", out),
        ("simulate", law, file, *COLUMNS, "--units", "V,um", "--out", out),
    ):
        ran = hystjax(*arguments)
        assert ran.code == 0
        told = "in V, and the recording's is in mV." in ran.err
        assert told == ("--units" not in arguments)
        assert "an output in" not in ran.err
        if arguments[0] == "invert":
            assert " mV\n" in ran.out.split("input from")[1]
