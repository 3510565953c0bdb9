import base64
import importlib.util
import os
import re
from pathlib import Path

import nbformat
import pytest

FOLDER = Path(__file__).resolve().parents[1] / "notebooks"


def load_build():
    spec = importlib.util.spec_from_file_location("build", FOLDER / "build.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


build = load_build()
SOURCES = build.sources()
NAMES = [source.stem for source in SOURCES]
NUMBER = re.compile(r"[-+]?\d+\.?\d*(?:e[-+]\d+)?")
READERS = ("magnetics", "piezo", "structural")
MEASURED = ("boucwen", "discovery", "experiment_6", "experiment_8", "memory", *READERS)
LONG = (  # a minute and more
    *("boucwen", "control", "discovery", "memory", "sweeps"),
    *("experiment_3", "experiment_4", "experiment_7", "experiment_8"),
)
EXPERIMENTS = [
    pytest.param(
        name,
        marks=[pytest.mark.thorough if name in LONG else pytest.mark.slow]
        + [pytest.mark.recordings] * (name in MEASURED),
    )
    for name in NAMES
    if name.startswith("experiment_") or name in (*MEASURED, *LONG, "sweeps")
]


def printed(notebook):
    """What the cells of a notebook print."""
    outputs = (output for cell in notebook.cells for output in cell.get("outputs", ()))
    return "".join(output.text for output in outputs if output.output_type == "stream")


def numbers(line):
    return [float(number) for number in NUMBER.findall(line)]


def pictures(notebook):
    """PNG files among the outputs of a notebook."""
    for cell in notebook.cells:
        for output in cell.get("outputs", ()):
            if "image/png" in output.get("data", {}):
                yield base64.b64decode(output.data["image/png"])


@pytest.mark.parametrize("source", SOURCES, ids=NAMES)
def test_committed_notebook_is_its_source_executed(source):
    assert build.differences(source) == ""
    file = source.with_suffix(".ipynb")
    assert file.stat().st_size < 1_000_000
    notebook = nbformat.read(file, as_version=4)
    nbformat.validate(notebook)
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert [cell.execution_count for cell in code] == list(range(1, len(code) + 1))
    assert any(pictures(notebook))
    assert not re.search(r"\"[^\"]*/(home|tmp|root|Users)/", file.read_text())


def test_what_is_told_of_discovery_is_what_it_prints():
    text = (FOLDER.parent / "docs" / "notebooks.md").read_text(encoding="utf-8")
    said = re.search(r"actuator (\w+), ([\d.]+) % .* and\s([\d.]+) % on unseen", text)
    assert said is not None
    output = printed(nbformat.read(FOLDER / "discovery.ipynb", as_version=4))
    law = re.findall(r"^w' = (.*)$", output, re.MULTILINE)[-1]
    count = 1 + law.count(" + ") + law.count(" - ")
    assert said[1] == ("one", "two", "three", "four", "five", "six")[count - 1]
    errors = re.findall(r"NRMSE, \w+ rows: ([\d.]+) %", output)
    assert said.groups()[1:] == tuple(f"{float(error):.3f}" for error in errors)


@pytest.mark.parametrize("name", EXPERIMENTS)
def test_experiment_executes_to_what_is_committed(name):
    source = FOLDER / f"{name}.py"
    fresh = build.executed(source)
    committed = nbformat.read(source.with_suffix(".ipynb"), as_version=4)
    for ours, theirs in zip(
        printed(fresh).splitlines(), printed(committed).splitlines(), strict=True
    ):
        assert NUMBER.sub("", ours).split() == NUMBER.sub("", theirs).split()
        if "MLP" not in ours:  # whose training makes much of the last bit
            assert numbers(ours) == pytest.approx(numbers(theirs), rel=1e-2, abs=1e-6)
    assert len([*pictures(fresh)]) == len([*pictures(committed)])


@pytest.mark.recordings
@pytest.mark.slow
@pytest.mark.parametrize("name", ["quickstart", "refinement"])
def test_source_executes_on_the_recordings(name):
    source = FOLDER / f"{name}.py"
    fresh = build.executed(source)
    committed = nbformat.read(source.with_suffix(".ipynb"), as_version=4)
    errors = re.compile(r"^(?:fitted|unseen) +[\d.]+ %", re.MULTILINE)
    assert errors.findall(printed(fresh)) == errors.findall(printed(committed))
    assert len([*pictures(fresh)]) == len([*pictures(committed)])


@pytest.mark.slow
def test_quickstart_executes_without_recordings(tmp_path, monkeypatch):
    monkeypatch.delenv("HYSTJAX_DATA_DIR", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    notebook = build.executed(FOLDER / "quickstart.py")
    text = printed(notebook)
    assert "The piezo record is not on this disk" in text
    assert re.search(r"w\*\|du\| -0\.[45]\d+ V\^-1\n", text)  # of the simulated device
    committed = nbformat.read(FOLDER / "quickstart.ipynb", as_version=4)
    assert len([*pictures(notebook)]) == len([*pictures(committed)])


@pytest.fixture
def sandbox(tmp_path, monkeypatch):
    """A folder with one notebook source, which `build` takes for its own."""
    monkeypatch.setattr(build, "HERE", tmp_path)
    return tmp_path / "small.py"


def test_build_writes_the_same_bytes_again_and_checks_without_writing(sandbox, capsys):
    sandbox.write_text("# %% [markdown]\n# # Sum\n\n# %%\nprint(1 + 1)\n")
    target = sandbox.with_suffix(".ipynb")
    assert build.main(["--check"]) == 1 and not target.exists()
    assert build.main([]) == 0
    first = target.read_bytes()
    notebook = nbformat.read(target, as_version=4)
    assert [cell.source for cell in notebook.cells] == ["# Sum", "print(1 + 1)"]
    assert printed(notebook) == "2\n"
    assert build.main(["small"]) == 0 and target.read_bytes() == first
    sandbox.write_text("# %% [markdown]\n# # Sum\n\n# %%\nprint(1 + 2)\n")
    assert build.main(["--check"]) == 1 and target.read_bytes() == first
    assert (
        "source of cell 1 of small.ipynb is not the source's" in capsys.readouterr()[0]
    )
    assert sorted(os.listdir(sandbox.parent)) == ["small.ipynb", "small.py"]


@pytest.mark.parametrize(
    ("code", "message"),
    [
        ("import warnings; warnings.warn('beware')", "a cell complains.*beware"),
        ("import os; print(os.getcwd())", "an output of small.py shows the path"),
    ],
)
def test_build_refuses_complaints_and_paths(sandbox, code, message):
    sandbox.write_text(f"# %%\n{code}\n")
    with pytest.raises(RuntimeError, match=f"(?s){message}"):
        build.main([])
    assert not sandbox.with_suffix(".ipynb").exists()
