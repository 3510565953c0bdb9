"""The README and the pages that it hands on to: what they run, name and link to."""

import re
import shlex

import matplotlib.image
import numpy as np
import pytest
from pages import ROOT, blocks

import hystjax as hj
from hystjax.cli._main import _parser

PAGES = {
    path: path.read_text(encoding="utf-8")
    for path in (
        ROOT / "README.md",
        *sorted((ROOT / "docs").glob("*.md")),
        *sorted((ROOT / "docs" / "start").glob("*.md")),
    )
}
TEXT = PAGES[ROOT / "README.md"]
ALL = "\n".join(PAGES.values())


def page(name):
    return PAGES[ROOT / "docs" / name]


def test_it_is_short():
    assert len(TEXT.splitlines()) <= 110


def test_the_citation_is_of_this_version():
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert f"\nversion: {hj.__version__}\n" in citation


@pytest.mark.recordings
def test_code_prints_what_the_text_shows_and_draws_its_figure(
    tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    namespace = {}
    first, *others = blocks(TEXT) + blocks(page("sweeps.md"))
    exec(first, namespace)
    law, table = capsys.readouterr().out.split("\n", 1)
    assert re.search(rf"^    {re.escape(law)}$", TEXT, re.MULTILINE)
    assert table == blocks(TEXT, "text")[0]
    drawn = matplotlib.image.imread("report/overview.png")
    shown = matplotlib.image.imread(ROOT / "docs" / "overview.png")
    assert drawn.shape == shown.shape
    if matplotlib.__version_info__ >= (3, 11):  # older ones set text otherwise
        assert np.mean(np.abs(drawn - shown)) < 0.01  # fonts differ between releases
    for block in others:
        exec(block, namespace)


def commands():
    lines = re.sub(r"\\\n\s*", "", ALL).splitlines()
    lines = [*lines, *(f"$ {line}" for line in "".join(blocks(ALL, "sh")).splitlines())]
    found = (re.fullmatch(r"(?:    |\$ )(hystjax .*)", line) for line in lines)
    return [match[1] for match in found if match]


@pytest.mark.parametrize("line", commands())
def test_commands_are_understood(line):
    program, *arguments = shlex.split(line)
    assert program == "hystjax"
    assert callable(_parser().parse_args(arguments).run)


def test_names_in_the_text_exist():
    names = set(re.findall(r"`?hj\.([a-z_]+(?:\.[A-Za-z_]+)*)", ALL))
    assert len(names) > 20
    for name in names:
        thing = hj
        for part in name.split("."):
            thing = getattr(thing, part)


@pytest.mark.parametrize("path", PAGES, ids=lambda path: path.name)
def test_files_in_the_text_exist(path):
    for link in re.findall(r"\]\(([^)#]+)", PAGES[path]):
        assert link.startswith("http") or (path.parent / link).is_file(), link


def test_every_page_is_linked_to_from_another():
    for path in PAGES:
        others = "".join(text for other, text in PAGES.items() if other != path)
        assert path.name == "README.md" or path.name in others


def test_the_recordings_in_the_text_are_those_there_are():
    rows = page("recordings.md")
    licences = dict(
        re.findall(r"^\| `([a-z0-9_]+)` \| .* \| (.*) \|$", rows, re.MULTILINE)
    )
    assert licences.keys() == set(hj.datasets.names())
    listing = hj.datasets.listing()
    for name, licence in licences.items():
        entry = listing[listing.index(f"{name}: ") :]
        assert re.search(r"licence +(.*)", entry)[1].startswith(licence)
