"""Where the chunks of a sweep are kept: in memory, or in a folder that outlives it."""

import json
import os
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from .._errors import InputError
from .._files import made_folder, write_atomically, write_text

_MANIFEST, _FORMAT, _VERSION = "sweep.json", "hystjax sweep", 1
_TEMPORARY = ".hystjax-"  # of files that a killed process was writing

Chunk = Mapping[str, np.ndarray]


class AbstractStore(ABC):
    """Chunks by number, each there whole or not at all."""

    @abstractmethod
    def __contains__(self, number: int) -> bool:
        """Whether a chunk is there."""

    @abstractmethod
    def put(self, number: int, chunk: Chunk) -> None:
        """Keep a chunk."""

    @abstractmethod
    def get(self, number: int) -> Chunk:
        """A chunk that is there."""


class Memory(AbstractStore):
    """Chunks of this process, gone with it."""

    def __init__(self):
        self._chunks: dict[int, Chunk] = {}

    def __contains__(self, number):
        return number in self._chunks

    def put(self, number, chunk):
        self._chunks[number] = chunk

    def get(self, number):
        return self._chunks[number]


class Folder(AbstractStore):
    """Chunks as files, beside a file that says what of."""

    def __init__(self, place: Path, names: Sequence[str]):
        self._place, self._names = place, tuple(names)

    def __contains__(self, number):
        return self._file(number).is_file()

    def put(self, number, chunk):
        arrays = [chunk[name] for name in self._names]
        write_atomically(self._file(number), lambda file: np.savez(file, *arrays))

    def get(self, number):
        with np.load(self._file(number)) as arrays:
            return {name: arrays[f"arr_{i}"] for i, name in enumerate(self._names)}

    def _file(self, number: int) -> Path:
        return self._place / f"chunk-{number:06d}.npz"


def kept_chunk(out: str | os.PathLike, chunk: int | None) -> int | None:
    """Lanes a chunk of the sweep in a folder, or else `chunk`.

    **Raises:** `InputError` when the folder has chunks of another size.
    """
    found = _manifest(Path(out))
    kept = chunk if found is None else found["chunk"]
    if chunk not in (None, kept):
        raise InputError(
            f"the sweep in {str(out)!r} has chunks of {kept} lanes, and `chunk` is "
            f"{chunk}; leave it out to go on there, or choose another folder."
        )
    return kept


def begun(out: str | os.PathLike) -> bool:
    """Whether a folder holds a sweep."""
    return _manifest(Path(out)) is not None


def opened(
    out: str | os.PathLike, inputs: Mapping[str, Any], chunk: int, names: Sequence[str]
) -> Folder:
    """A folder for the sweep with these inputs; one that was begun there goes on.

    **Arguments:** the folder, made if need be; what the sweep depends on, by name, as
    JSON has it; the lanes a chunk; and the names of the arrays.

    **Raises:** `InputError` for a folder with another sweep, or with other files.
    """
    place = made_folder(out)
    found = _manifest(place)
    if found is None:
        _check_empty(place)
        document = {"format": _FORMAT, "version": _VERSION, "chunk": chunk}
        text = json.dumps(
            {**document, "inputs": inputs, "names": list(names)}, indent=2
        )
        write_text(place / _MANIFEST, text + "\n")
        return Folder(place, names)
    changed = [name for name in inputs if found["inputs"].get(name) != inputs[name]]
    if changed:
        raise InputError(
            f"the folder {str(place)!r} holds a sweep with another "
            f"{' and another '.join(changed)}. Choose another folder, or remove that "
            "one; to go on, call it with the same inputs, code and versions as before."
        )
    return Folder(place, found["names"])


def tidied(out: str | os.PathLike) -> None:
    """Remove what killed processes left half written."""
    for file in Path(out).glob(f"{_TEMPORARY}*"):
        file.unlink(missing_ok=True)


def _manifest(place: Path) -> dict[str, Any] | None:
    file = place / _MANIFEST
    if not file.is_file():
        return None
    try:
        found = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InputError(f"{file} cannot be read ({error}).") from None
    if not isinstance(found, dict) or found.get("format") != _FORMAT:
        raise InputError(f"{file} is not of a sweep; choose another folder.")
    if found.get("version") != _VERSION:
        raise InputError(
            f"{file} has version {found.get('version')!r}, and this hystjax reads "
            f"version {_VERSION}; choose another folder."
        )
    return found


def _check_empty(place: Path) -> None:
    others = [f.name for f in place.iterdir() if not f.name.startswith(_TEMPORARY)]
    if others:
        raise InputError(
            f"the folder {str(place)!r} holds no sweep but other files, such as "
            f"{others[0]!r}; choose an empty one, or one that does not exist."
        )
