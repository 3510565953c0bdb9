"""Finding a file: in `HYSTJAX_DATA_DIR`, in the cache, or at its source."""

import hashlib
import http.client
import os
import urllib.error
import urllib.request
from pathlib import Path

from .._errors import InputError
from .._files import user_cache, write_atomically
from ._entry import File

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
