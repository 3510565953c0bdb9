"""What the registry says of a recording."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

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
