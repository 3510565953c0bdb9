"""Pages and files of GitHub repositories, pinned to a commit."""

from typing import TypeAlias
from urllib.parse import quote

from ._entry import File

Place: TypeAlias = tuple[str, str, str]
"""A repository, a commit of it and a folder in that."""

NO_LICENCE = "none stated by the source; linked here, never redistributed"
SMART_HYSTERESIS = (
    "chandratue/SmartHysteresis",
    "56ccb389f852ca9858b2a34c06ee7eda7185cf1b",
    "Data",
)


def page(place: Place) -> str:
    """The address of a folder's page."""
    repository, commit, folder = place
    return f"https://github.com/{repository}/tree/{commit}/{quote(folder)}"


def file(place: Place, name: str, sha256: str) -> File:
    """The file `name` in a folder."""
    raw = "https://raw.githubusercontent.com"
    return File(name, sha256, "/".join([raw, *map(quote, place), name]))
