import re
import shlex
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest

import hystjax as hj
from hystjax.cli._main import _parser

ROOT = Path(__file__).resolve().parents[1]
TEXT = (ROOT / "README.md").read_text(encoding="utf-8")


def blocks(language):
    return re.findall(rf"^```{language}\n(.*?)^```", TEXT, re.MULTILINE | re.DOTALL)


@pytest.mark.recordings
def test_code_prints_what_the_text_shows_and_draws_its_figure(
    tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    namespace = {}
    first, *others = blocks("python")
    exec(first, namespace)
    law, table = capsys.readouterr().out.split("\n", 1)
    assert re.search(rf"^    {re.escape(law)}$", TEXT, re.MULTILINE)
    assert table == blocks("text")[0]
    drawn = matplotlib.image.imread("report/overview.png")
    shown = matplotlib.image.imread(ROOT / "docs" / "overview.png")
    assert drawn.shape == shown.shape
    assert np.mean(np.abs(drawn - shown)) < 0.01  # fonts differ between releases
    for block in others:
        exec(block, namespace)


def commands():
    lines = re.sub(r"\\\n\s*", "", TEXT).splitlines()
    return [line.strip() for line in lines if line.startswith("    hystjax ")]


@pytest.mark.parametrize("line", commands())
def test_commands_are_understood(line):
    program, *arguments = shlex.split(line)
    assert program == "hystjax"
    assert callable(_parser().parse_args(arguments).run)


def test_names_in_the_text_exist():
    names = set(re.findall(r"`?hj\.([a-z_]+(?:\.[A-Za-z_]+)*)", TEXT))
    assert len(names) > 20
    for name in names:
        thing = hj
        for part in name.split("."):
            thing = getattr(thing, part)


def test_files_and_recordings_in_the_text_exist():
    for path in re.findall(r"\]\(([^)]+)\)|`(notebooks/[^`]+)`", TEXT):
        assert (ROOT / "".join(path)).is_file()
    listed = re.findall(r"^\| `([a-z0-9_]+)` \| .* \| (.*) \|$", TEXT, re.MULTILINE)
    licences = dict(listed)
    assert licences.keys() == set(hj.datasets.names())
    listing = hj.datasets.listing()
    for name, licence in licences.items():
        entry = listing[listing.index(f"{name}: ") :]
        assert re.search(r"licence +(.*)", entry)[1].startswith(licence)
