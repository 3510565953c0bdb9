"""Where the chunks of a sweep are kept: in memory, or in a folder that outlives it."""

import hashlib
import io
import json
import os
import re
import warnings
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from .._core.checks import InputError
from .._core.files import made_folder, write_atomically, write_text

_MANIFEST, _FORMAT, _VERSION = "sweep.json", "hystjax sweep", 2
_TEMPORARY = ".hystjax-"  # of files that a killed process was writing
_OURS = re.compile(rf"{re.escape(_TEMPORARY)}.*|chunk-\d+\.npz")

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
    """Chunks as files, beside a file that says what of.

    Each holds its number and the fingerprint of its sweep. One that is damaged is not
    there, with a warning, and will be made again: nothing is lost by that. One of
    another number or sweep is refused: somebody may have put it there on purpose.
    """

    def __init__(self, place: Path, manifest: Mapping[str, Any]):
        self._place = place
        self._names, self._sweep = manifest["names"], manifest["fingerprint"]

    def __contains__(self, number):
        file = self._file(number)
        if not file.is_file():
            return False
        if self._read(number) is None:
            warnings.warn(f"{file} is damaged and will be made again.", stacklevel=4)
            return False
        return True

    def put(self, number, chunk):
        arrays = [chunk[name] for name in self._names]
        stamp = {"number": number, "sweep": self._sweep}
        write_atomically(
            self._file(number), lambda file: np.savez(file, *arrays, **stamp)
        )

    def get(self, number):
        chunk = self._read(number)
        if chunk is None:
            raise InputError(
                f"{self._file(number)} is damaged. Delete it and call `sweep` again: "
                "it will be made again."
            )
        return chunk

    def _read(self, number: int) -> Chunk | None:
        """A chunk, or None where its file is damaged."""
        file = self._file(number)
        try:
            content = file.read_bytes()
        except OSError as error:
            raise InputError(
                f"{file} cannot be read ({error.strerror}). Let it be read, or delete "
                "it: it will be made again."
            ) from None
        try:
            with np.load(io.BytesIO(content)) as arrays:
                stamp = int(arrays["number"]), str(arrays["sweep"])
                chunk = {n: arrays[f"arr_{i}"] for i, n in enumerate(self._names)}
        except Exception:  # where bytes are lost or changed, anything may be raised
            return None
        if stamp != (number, self._sweep):
            raise InputError(
                f"{file} holds chunk {stamp[0]} of "
                f"{'this' if stamp[1] == self._sweep else 'another'} sweep; it was "
                "copied or renamed. Move it away and call `sweep` again: chunk "
                f"{number} will be made again."
            )
        return chunk

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
        content = {"format": _FORMAT, "version": _VERSION, "chunk": chunk}
        content |= {"inputs": dict(inputs), "names": list(names)}
        found = {**content, "fingerprint": _fingerprint(content)}
        write_text(place / _MANIFEST, json.dumps(found, indent=2) + "\n")
    changed = [name for name in inputs if found["inputs"].get(name) != inputs[name]]
    if changed:
        raise InputError(
            f"the folder {str(place)!r} holds a sweep with another "
            f"{' and another '.join(changed)}. Choose another folder, or remove that "
            "one; to go on, call it with the same inputs, code and versions as before."
        )
    return Folder(place, found)


def tidied(out: str | os.PathLike) -> None:
    """Remove what killed processes left half written."""
    for file in Path(out).glob(f"{_TEMPORARY}*"):
        file.unlink(missing_ok=True)


def _manifest(place: Path) -> dict[str, Any] | None:
    file = place / _MANIFEST
    if not file.is_file():
        return None
    try:
        found = json.loads(file.read_bytes())
    except OSError as error:
        raise InputError(f"{file} cannot be read ({error.strerror}).") from None
    except (ValueError, RecursionError):
        raise _damaged(file) from None
    if not isinstance(found, dict) or found.get("format") != _FORMAT:
        raise InputError(f"{file} is not of a sweep; choose another folder.")
    if found.get("version") != _VERSION:
        raise InputError(
            f"{file} has version {found.get('version')!r}, and this hystjax reads "
            f"version {_VERSION}; choose another folder."
        )
    content = {name: value for name, value in found.items() if name != "fingerprint"}
    if found.get("fingerprint") != _fingerprint(content):
        raise _damaged(file)
    return found


def _fingerprint(content: Mapping[str, Any]) -> str:
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def _damaged(file: Path) -> InputError:
    return InputError(
        f"{file} is damaged. Delete it and call `sweep` again as before: it will be "
        "made again, and the chunks beside it are kept."
    )


def _check_empty(place: Path) -> None:
    # Chunks may be there: a damaged manifest was deleted, and they know their sweep.
    others = [f.name for f in place.iterdir() if not _OURS.fullmatch(f.name)]
    if others:
        raise InputError(
            f"the folder {str(place)!r} holds no sweep but other files, such as "
            f"{others[0]!r}; choose an empty one, or one that does not exist."
        )
