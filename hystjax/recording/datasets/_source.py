"""What the registry says of a recording, and where its files are: in
`HYSTJAX_DATA_DIR`, in the cache, or at their source."""

import hashlib
import http.client
import os
import urllib.error
import urllib.request
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias
from urllib.parse import quote

from ..._core.checks import InputError
from ..._core.files import user_cache, write_atomically
from .._recording import Recording

Find: TypeAlias = Callable[[str], Path]
"""From a file's name to where the file is, fetched if need be."""


@dataclass(frozen=True)
class File:
    """A file, the SHA-256 of its bytes in hexadecimal, and where it comes from."""

    name: str
    sha256: str
    url: str


@dataclass(frozen=True)
class Dataset:
    """One entry of the registry.

    **Attributes:**

    - `name`: what `load` calls it.
    - `what`: the device and the experiment, in a line.
    - `columns`: what input and output are, with their units.
    - `rate`: sampling rate and length.
    - `licence`, `citation`: terms of the source, and whom to cite.
    - `source`: a page about the files.
    - `files`: the files, original and unchanged.
    - `loader`: makes the recording, from a finder of files and a record's name.
    - `records`: names of the records if there are several, the default first.
    """

    name: str
    what: str
    columns: str
    rate: str
    licence: str
    citation: str
    source: str
    files: tuple[File, ...]
    loader: Callable[[Find, str], Recording]
    records: tuple[str, ...] = ()


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


_TIMEOUT = 30.0  # s without a byte


def folders(name: str) -> tuple[Path, ...]:
    """Where the files of the dataset `name` may lie: first `HYSTJAX_DATA_DIR`, if it
    is set, and last the user's cache, to which downloads go.
    """
    given = os.environ.get("HYSTJAX_DATA_DIR")
    places = [Path(given).expanduser()] if given else []
    return tuple(place / name for place in [*places, user_cache()])


def on_disk(name: str, file: File) -> Path | None:
    """Where `file` of the dataset `name` lies, or None; nothing is downloaded."""
    places = (folder / file.name for folder in folders(name))
    return next((place for place in places if place.is_file()), None)


def find(name: str, file: File) -> Path:
    """Where `file` of the dataset `name` lies, its checksum verified, after a download
    to the cache if need be.

    **Raises:** `InputError` when the checksum differs, or the file cannot be read,
    downloaded or stored.
    """
    path = on_disk(name, file)
    if path is None:
        return _download(file, folders(name)[-1] / file.name)
    try:
        content = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror}.") from None
    if _differs(content, file):
        raise InputError(
            f"{path} is not the file that hystjax knows: its SHA-256 differs. It may "
            "be cut short or edited; delete it, and it will be downloaded again."
        )
    return path


def _download(file: File, path: Path) -> Path:
    content = _get(file, path)
    if _differs(content, file):
        raise InputError(
            f"what {file.url} sent is not the file that hystjax knows: its SHA-256 "
            "differs, and it was not kept. A proxy may have answered with a page of "
            f"its own; else the source has changed. {_by_hand(path)}"
        )
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_atomically(path, lambda stream: stream.write(content))
    except OSError as error:
        raise InputError(
            f"{path} cannot be written: {error.strerror}. Set XDG_CACHE_HOME to a "
            "folder where you may write."
        ) from None
    return path


def _get(file: File, path: Path) -> bytes:
    try:
        with urllib.request.urlopen(file.url, timeout=_TIMEOUT) as response:
            return response.read()
    except urllib.error.HTTPError as error:
        reason = f"the server refused it: {error.code} {error.reason}"
    except (OSError, http.client.HTTPException) as error:
        reason = f"is there a network? {error}"
    raise InputError(
        f"{file.name} is not on disk, and {file.url} could not be downloaded ({reason})"
        f". {_by_hand(path)}"
    )


def _by_hand(path: Path) -> str:
    return (
        f"Try again, or put the file at {path} yourself, or at "
        f"{path.parent.name}/{path.name} in a folder that HYSTJAX_DATA_DIR names."
    )


def _differs(content: bytes, file: File) -> bool:
    return hashlib.sha256(content).hexdigest() != file.sha256
