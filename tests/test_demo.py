import dataclasses
import re

import pytest

import hystjax as hj
from hystjax.cli import main
from hystjax.recording.datasets._access import REGISTRY

TRUTH = {"u*|du|": 0.4, "w*|du|": -0.5, "du": 0.25}


def test_demo_without_recordings_says_so_and_runs(tmp_path, monkeypatch, capsys):
    monkeypatch.delenv("HYSTJAX_DATA_DIR", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    piezo = REGISTRY["piezo_ayala"]
    gone = [dataclasses.replace(f, url="file:///nowhere/x.csv") for f in piezo.files]
    offline = dataclasses.replace(piezo, files=tuple(gone))
    monkeypatch.setitem(REGISTRY, "piezo_ayala", offline)
    assert main(["demo", "--out", str(tmp_path / "out")]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    assert "simulated Duhem device: 700 rows fitted, 300 unseen\n" in out
    left_out = "measured piezo actuator: left out, .*file:///nowhere/x.csv could not be"
    assert re.search(left_out, out)
    law = hj.load(tmp_path / "out" / "simulated" / "law.json")
    assert law.terms() == pytest.approx(TRUTH, abs=1e-3)
    assert not (tmp_path / "out" / "piezo").exists()


@pytest.mark.parametrize("out", ["", "taken"])
def test_demo_needs_a_folder_before_it_works(tmp_path, monkeypatch, capsys, out):
    def worked():
        raise AssertionError("the demonstration ran")

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(hj.reproduce, "duhem_growing_sine", worked)
    (tmp_path / "taken").touch()
    assert main(["demo", "--out", out]) == 2
    assert "folder" in capsys.readouterr().err
    assert [each.name for each in tmp_path.iterdir()] == ["taken"]


@pytest.mark.slow
@pytest.mark.recordings
def test_demo_with_recordings_judges_the_piezo_too(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["demo"]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    assert "measured piezo actuator: 10000 rows fitted, 17500 unseen\n" in out
    assert out.count(" ms again; free run ") == 2
    for name in ("simulated", "piezo"):
        assert (tmp_path / "hystjax-report-demo" / name / "report.md").is_file()
    law = hj.load("hystjax-report-demo/piezo/law.json")
    assert law.terms().keys() == {"1", "w", "u", "du", "w*|w|"}
