"""The code in the guides runs, and prints what they show."""

import re
from pathlib import Path

import pytest

import hystjax as hj

DOCS = Path(__file__).resolve().parents[1] / "docs"
GUIDES = [
    *("models.md", "classical.md", "machine.md", "loops.md", "comparison.md"),
    *("tasks.md", "diffrax.md"),
]
LONG = [
    pytest.param("hidden.md", marks=pytest.mark.thorough),
    pytest.param("hybrid.md", marks=pytest.mark.thorough),
]


def blocks(text, language):
    return re.findall(rf"^```{language}\n(.*?)^```", text, re.MULTILINE | re.DOTALL)


@pytest.mark.parametrize("guide", [*GUIDES, *LONG])
def test_code_runs_and_prints_what_the_text_shows(guide, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    text = (DOCS / guide).read_text(encoding="utf-8")
    namespace = {"__name__": "lab"}
    for block in blocks(text, "python"):
        exec(block, namespace)
    assert capsys.readouterr().out == "".join(blocks(text, "text"))


@pytest.mark.parametrize("guide", [*GUIDES, "hidden.md", "hybrid.md"])
def test_names_in_the_text_exist(guide):
    text = (DOCS / guide).read_text(encoding="utf-8")
    names = set(re.findall(r"`?hj\.([a-z_]+(?:\.[A-Za-z_]+)*)", text))
    assert names
    for name in names:
        thing = hj
        for part in name.split("."):
            thing = getattr(thing, part)
