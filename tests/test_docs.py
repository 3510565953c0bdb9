"""The code in the guides runs, and prints what they show."""

import ast
import re
import shlex
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from pages import ROOT, blocks

import hystjax as hj
from docs import _tables
from hystjax.cli import main

DOCS = ROOT / "docs"
GUIDES = [
    *("classical.md", "loops.md", "comparison.md", "tasks.md", "diffrax.md"),
    *("units.md", "start/piezo.md", "start/structure.md"),
    *("api/library.md", "api/models.md", "api/loops.md"),
]
SLOW = [
    *("models.md", "memory.md", "machine.md", "start/magnetics.md", "start/jax.md"),
    *("api/records.md", "api/simulation.md", "api/tools.md"),
]
THOROUGH = ["hidden.md", "hybrid.md", "api/fitting.md", "api/verbs.md"]
LONG = [
    *(pytest.param(guide, marks=pytest.mark.slow) for guide in SLOW),
    *(pytest.param(guide, marks=pytest.mark.thorough) for guide in THOROUGH),
]
NAMING = [*GUIDES, *SLOW, *THOROUGH, "choosing.md", "reading.md"]


@pytest.mark.parametrize("guide", [*GUIDES, *LONG])
def test_code_runs_and_prints_what_the_text_shows(guide, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    text = (DOCS / guide).read_text(encoding="utf-8")
    namespace = {"__name__": "lab"}
    for block in blocks(text):
        exec(block, namespace)
    assert capsys.readouterr().out == "".join(blocks(text, "text"))


def test_cycles_begin_where_the_page_on_structures_says(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    text = (DOCS / "start" / "structure.md").read_text(encoding="utf-8")
    namespace = {"__name__": "lab"}
    exec(blocks(text)[0], namespace)
    record = namespace["record"]
    first, turn, _ = record.u[hj.loops.reversals(record).cycles[0]]
    assert f"from one {'upper' if first > turn else 'lower'} turning point" in text


def test_commands_of_the_page_on_piezos_lead_the_stack(tmp_path, monkeypatch):
    """Typed as they stand, they end in voltages under which it goes where it should."""
    monkeypatch.chdir(tmp_path)
    text = (DOCS / "start" / "piezo.md").read_text(encoding="utf-8")
    namespace = {"__name__": "lab"}
    for block in blocks(text):
        exec(block, namespace)
    for line in blocks(text, "console")[0].splitlines():
        assert main(shlex.split(line.removeprefix("$ hystjax"))) == 0
    t, u = np.loadtxt("drive.csv", delimiter=",", skiprows=1, usecols=(0, 1)).T
    run = hj.simulate(namespace["stack"], hj.Recording(t, u, u))
    # From rest the first sample is a step, and has nothing that later ones are without.
    assert np.max(abs(run.w - namespace["wanted"])) < 0.01 * np.ptp(namespace["wanted"])
    assert "stack_follow" in Path("stack.c").read_text(encoding="utf-8")


@pytest.mark.parametrize("guide", NAMING)
def test_names_in_the_text_exist(guide):
    text = (DOCS / guide).read_text(encoding="utf-8")
    names = set(re.findall(r"`?hj\.([a-z_]+(?:\.[A-Za-z_]\w*)*)", text))
    assert names
    for name in names:
        thing = hj
        for part in name.split("."):
            thing = getattr(thing, part)


def test_tables_of_figures_are_what_programs_wrote():
    """As `make tables` puts them in, and nobody has typed them."""
    pages = {p.name: p.read_text(encoding="utf-8") for p in DOCS.rglob("*.md")}
    for name, text in pages.items():
        assert _tables.filled(text) == text, name
    for name in ("results.md", "speed.md"):
        typed = re.sub(r"(?s)<!-- table: .*?<!-- end of table -->", "", pages[name])
        assert not re.search(r"(?m)^\|", typed), name


def spoken(tree):
    """The texts in a module, with … where something is filled in."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            yield node.value
        elif isinstance(node, ast.JoinedStr):
            parts = (getattr(part, "value", None) for part in node.values)
            yield "".join(part if isinstance(part, str) else "…" for part in parts)


@cache
def sayings():
    paths = (ROOT / "hystjax").rglob("*.py")
    trees = (ast.parse(path.read_text(encoding="utf-8")) for path in paths)
    return [text for tree in trees for text in spoken(tree)]


def quoted():
    text = (DOCS / "troubleshooting.md").read_text(encoding="utf-8")
    return re.findall(r'\*\*"(.+?)"\*\*', text.replace("\n", " "))


@pytest.mark.parametrize("message", quoted())
def test_messages_in_the_text_are_the_library_s(message):
    assert any(message in text for text in sayings())
