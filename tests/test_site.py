"""The documentation site: built strictly where its tools are (`make docs` installs
them), and complete in any case."""

import inspect
import operator
import re
import subprocess
import sys
from pathlib import Path

import pytest
from pages import ROOT, blocks

import hystjax as hj

NAV = (ROOT / "mkdocs.yml").read_text(encoding="utf-8").partition("\nnav:")[2]


def test_every_page_is_in_the_navigation():
    pages = {path.relative_to(ROOT / "docs") for path in ROOT.glob("docs/**/*.md")}
    pages -= {page for page in pages if page.parent.name == "reproduced"}
    notebooks = ROOT.glob("notebooks/*.ipynb")
    pages |= {path.relative_to(ROOT).with_suffix(".md") for path in notebooks}
    listed = {Path(name) for name in re.findall(r": (\S+\.md)$", NAV, re.MULTILINE)}
    assert listed == pages | {Path("index.md"), Path("hystjax/reproduce/CLAIMS.md")}


def told():
    """What the reference tells of, by name."""
    text = "".join(path.read_text() for path in ROOT.glob("docs/api/*.md"))
    names = re.findall(r"^::: hystjax\.(\S+)$", text, re.MULTILINE)
    return {name: operator.attrgetter(name)(hj) for name in names}


def test_the_reference_has_every_public_name():
    things = told()
    inner = {*things, *(name for thing in things.values() for name in dir(thing))}
    plain = [name for name in dir(hj) if not name.startswith("_")]
    # Folders whose verb is told for itself have no entry of their own.
    folders = [n for n in plain if n.islower() and not callable(getattr(hj, n))]
    untold = {*plain} - inner - {*folders} - {"InputError", "ComputationError"}
    assert not untold


def test_the_reference_has_an_example_of_every_public_name():
    things = told()
    pages = [path.read_text(encoding="utf-8") for path in ROOT.glob("docs/**/*.md")]
    examples = "".join(blocks("".join(pages)))  # which `test_docs.py` runs
    words = set(re.findall(r"\w+", examples))
    names = set()
    for name, thing in things.items():
        if not inspect.ismodule(thing):
            names.add(name.split(".")[-1])
            continue
        plain = (each for each in dir(thing) if not each.startswith("_"))
        names |= {n for n in plain if not inspect.ismodule(getattr(thing, n))}
    assert len(names) > 200
    assert names <= words, sorted(names - words)


def test_it_builds_without_a_warning(tmp_path):
    pytest.importorskip("mkdocs")
    pytest.importorskip("material")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "-d", str(tmp_path)]
    built = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert built.returncode == 0, built.stderr
    for page, name in (("verbs", "identify"), ("models", "models.Preisach")):
        text = (tmp_path / "api" / page / "index.html").read_text(encoding="utf-8")
        assert f'id="hystjax.{name}"' in text
    shown = (tmp_path / "notebooks/quickstart/index.html").read_text(encoding="utf-8")
    assert "quickstart_0.png" in shown and "<math" in shown


def test_without_a_browser_the_check_says_what_to_install(tmp_path):
    command = [sys.executable, str(ROOT / "docs" / "_check.py")]
    nothing = {"PATH": str(tmp_path)}
    ended = subprocess.run(command, env=nothing, capture_output=True, text=True)
    assert ended.returncode == 1 and "apt install chromium" in ended.stderr
