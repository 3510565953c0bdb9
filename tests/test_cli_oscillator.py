"""`hystjax discover --oscillator`, from a file to the law of a hidden spring."""

import re
from dataclasses import replace
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest
from fits import fit_of

import hystjax as hj
from hystjax.cli import main
from hystjax.refinement._certainty import _noise_in_words

PERIOD = 64
COLUMNS = ("--time", "t", "--input", "force", "--output", "position")


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A force that repeats itself four times, and some position."""
    t = 0.1 * np.arange(4 * PERIOD)
    phase = 2 * np.pi * np.arange(len(t)) / PERIOD
    w = np.sin(phase - 1) + 0.1 * np.random.default_rng(0).normal(size=len(t))
    write(tmp_path / "mass.csv", t, np.sin(phase), w)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def write(path, *columns):
    rows = (",".join(map(repr, row)) for row in np.stack(columns, 1).tolist())
    path.write_text("t,force,position\n" + "\n".join(rows))


def searched(monkeypatch, *arguments):
    """What a search is asked to look at."""
    found = {}

    def caught(record, library, **options):
        found.update(record=record, library=library, **options)
        raise hj.ComputationError("enough")

    monkeypatch.setattr("hystjax.discovery._discover.discover", caught)
    assert main(("discover", "mass.csv", *COLUMNS, "--oscillator", *arguments)) == 3
    return found


def test_cycles_of_the_fitted_rows_are_averaged(folder, monkeypatch):
    rows = ("--rows", f"0:{3 * PERIOD}")
    found = searched(monkeypatch, *rows, "--cycle", str(PERIOD), "--units", "N,m")
    names = {"time": "t", "input": "force", "output": "position"}
    record = hj.Recording.from_csv("mass.csv", **names).window(0, 3 * PERIOD)
    expected, weight = hj.steady(record, PERIOD)
    np.testing.assert_array_equal(found["record"].w, expected.w)
    np.testing.assert_array_equal(found["weights"][0], weight)
    assert found["library"].names == hj.library.Polynomial(2, HIDDEN).names
    model = found["around"](hj.models.Dahl(3.0, 0.8))
    assert isinstance(model, hj.models.Oscillator) and model.units == ("N", "m")


HIDDEN = ("w", "du", "|du|", "|w|")


def test_a_record_that_does_not_repeat_itself_is_taken_as_it_is(folder, monkeypatch):
    found = searched(monkeypatch, "--variables", "w,du", "--degree", "1")
    assert found["weights"] is None and len(found["record"]) == 179
    assert found["library"].names == hj.library.Polynomial(1, ("w", "du")).names


def test_what_begins_with_the_fitted_rows_is_judged_from_the_fitted_position(
    folder, monkeypatch
):
    begun = {}

    def judged(model, run, *, w0, lead_in):
        begun[len(run)] = w0, lead_in
        if len(begun) == 2:
            raise hj.ComputationError("enough")

    machine = hj.models.Oscillator(1.0, 1.0, 1.0, hj.models.Dahl(3.0, 0.8))
    found = fit_of(machine, w0=jnp.array([0.25])).solution()
    found.stats["why"] = ""
    monkeypatch.setattr("hystjax.discovery._discover.discover", lambda *_, **__: found)
    monkeypatch.setattr("hystjax.cli._laws.judge", judged)
    command = ("discover", "mass.csv", *COLUMNS, "--oscillator")
    assert main((*command, "--rows", "0:100", "--test", "100:200")) == 3
    assert begun == {100: (0.25, 0), 200: (0.25, 100)}  # from the fitted rows on
    begun.clear()
    assert main((*command, "--rows", "100:200", "--test", "0:80")) == 3
    assert begun == {100: (0.25, 0), 80: (None, 0)}


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--cycle", "64"), "--cycle is of an --oscillator"),
        (("--known", "w=-1", "--known", "w=-2"), "--known is given more than once for"),
        (("--oscillator", "--seed", "7"), "--seed is of laws whose output was meas"),
        (("--oscillator", "--known", "w=-1"), "--known is of laws whose output was"),
        (("--oscillator", "--cycle", "0"), "--cycle 0 must be 3 samples or more"),
        (("--oscillator", "--cycle", "63"), "does not repeat itself every 63 samples"),
        (
            ("--oscillator", "--cycle", "64", "--rows", "64:256", "--test", "0:34"),
            "unseen rows 0:34 are too few.*first 32 rows.*--test",
        ),
    ],
)
def test_slips_are_said_before_the_search(folder, capsys, arguments, said):
    assert main(("discover", "mass.csv", *COLUMNS, *arguments)) == 2
    assert re.search(said, capsys.readouterr().err)


def test_samples_left_out_are_no_noise_that_grows():
    def said(*weights):
        fit = fit_of(hj.models.BoucWen(1.0, 0.5, 0.5), weights=weights)
        known = replace(fit.certainty, noise=jnp.asarray(2.0))
        return _noise_in_words(replace(fit, certainty=known))

    assert said(np.array([0.0, 1.0, 1.0])) == "2"
    assert said(np.array([0.0, 4.0]), np.array([1.0])).endswith("from 1 to 2")


@pytest.mark.thorough
def test_the_law_of_a_hidden_spring_is_found_and_reported(folder, capsys):
    from test_hidden import TERMS, recorded

    record = recorded()
    write(folder / "mass.csv", *map(np.asarray, (record.t, record.u, record.w)))
    rows = ("--rows", "0:2048", "--cycle", "1024", "--interpolation", "cubic")
    code = main(
        ("discover", "mass.csv", *COLUMNS, "--oscillator", *rows, "--largest", "3")
    )
    out = capsys.readouterr().out
    assert code == 0
    model = hj.load("hystjax-report/law.json")
    assert set(model.spring.terms()) == TERMS
    report = Path("hystjax-report")
    assert "hidden.png" in (report / "report.md").read_text()
    assert (report / "hidden.png").read_bytes().startswith(b"\x89PNG")
    for name, x in model.parameters().items():
        told = re.search(rf"^{re.escape(name)} +(\S+) +± (\S+)", out, re.MULTILINE)
        assert told and abs(float(told[1]) - float(x)) <= 1e-4 * abs(float(x))
    errors = re.findall(r"^(?:fitted|unseen) +(\S+) %", out, re.MULTILINE)
    # The noise of one period is about 0.14 % of the range, of the mean less.
    assert len(errors) == 2 and 0.05 < float(errors[0]) < float(errors[1]) < 0.2
    assert "cannot be known" in out and "standard error" in out
    assert "mass" in Path("hystjax-report/report.md").read_text()
