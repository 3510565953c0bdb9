"""Datasets by name: load, fetch, list, and where their files are: in
`HYSTJAX_DATA_DIR`, in the cache, or at their source."""

import hashlib
import http.client
import os
import urllib.error
import urllib.request
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from ..._core.checks import InputError, nearest
from ..._core.files import made_folder, user_cache, write_atomically
from .._recording import Recording
from . import _entries
from ._entries import ENTRIES, Dataset, File, Find

REGISTRY = {entry.name: entry for entry in ENTRIES}


def entry(name: str) -> Dataset:
    """The entry called `name`; raises `InputError` with the known names otherwise."""
    if name not in REGISTRY:
        raise InputError(f"there is no dataset {name!r}. {known(name, REGISTRY)}")
    return REGISTRY[name]


def known(name: str, names: Iterable[str]) -> str:
    """The known names in a sentence, with the one most like `name` before them."""
    return f"{nearest(name, names)}Known are: {', '.join(names)}."


def listing() -> str:
    """All datasets in plain text: what each is, its columns, units and rate, its
    licence, citation and source, and whether it is on disk.
    """
    return "\n\n".join(_described(dataset) for dataset in REGISTRY.values())


def _described(dataset: Dataset) -> str:
    facts = {
        "columns": dataset.columns,
        "rate": dataset.rate,
        "records": ", ".join(dataset.records),
        "licence": dataset.licence,
        "cite": dataset.citation,
        "source": dataset.source,
        "on disk": _whereabouts(dataset),
    }
    lines = [f"  {key:<8} {fact}" for key, fact in facts.items() if fact]
    return "\n".join([f"{dataset.name}: {dataset.what}", *lines])


def _whereabouts(dataset: Dataset) -> str:
    places = [on_disk(dataset.name, file) for file in dataset.files]
    found = [place for place in places if place is not None]
    if not found:
        return f"no; `hystjax data fetch {dataset.name}` downloads it"
    share = (
        "" if len(found) == len(places) else f"{len(found)} of {len(places)} files, "
    )
    return share + ", ".join(sorted({str(place.parent) for place in found}))


def load(name: str, record: str | None = None) -> Recording:
    """A recording by name: read from the folder in `HYSTJAX_DATA_DIR`, else from the
    cache (`$XDG_CACHE_HOME/hystjax`, by default `~/.cache/hystjax`), else downloaded
    there from its source.

    Names are `piezo_ayala`, `piezo_yan9a`, `mr_damper`, `friction_pin`,
    `boucwen_benchmark`, `friction_damper`, `no27_steel`, `steel_m130_27s`,
    `steel_coupon` and `forc_md00`; the last three have no clock. `listing()` describes
    them, with units, licence and citation. Files are checked against their SHA-256
    every time.

    **Arguments:**

    - `name`: which dataset.
    - `record`: which of its records, see `records`; by default the first.

    **Raises:** `InputError` for an unknown name or record, or a file that cannot be
    had; the message says what to do.
    """
    dataset = entry(name)
    return dataset.loader(_finder(dataset), _record(dataset, record))


def names() -> tuple[str, ...]:
    """Names of all datasets."""
    return tuple(REGISTRY)


def records(name: str) -> tuple[str, ...]:
    """Names of the records in a dataset, the default first; empty when it has one.

    **Raises:** `InputError` for an unknown name.
    """
    return entry(name).records


def fetch(name: str) -> tuple[Path, ...]:
    """Paths of all files of a dataset, downloaded where they are not on disk yet.

    **Raises:** `InputError` for an unknown name, or a file that cannot be had.
    """
    dataset = entry(name)
    return tuple(find(name, file) for file in dataset.files)


def path(name: str) -> Path:
    """The folder that holds the files of a dataset; nothing is downloaded.

    **Raises:** `InputError` for an unknown name, or when no folder holds them all.
    """
    dataset = entry(name)
    for folder in folders(name):
        if all((folder / file.name).is_file() for file in dataset.files):
            return folder
    looked = " or ".join(str(folder) for folder in folders(name))
    cure = f"Download them with `hystjax data fetch {name}`."
    if all(on_disk(name, file) for file in dataset.files):
        cure = "Each is in one of these: put them together, or ask for `fetch`."
    raise InputError(f"the files of {name!r} are not all in {looked}. {cure}")


def no27_hystlab_fit() -> np.ndarray:
    """The moment (A m²) that the program HystLab fitted to the record `"hystlab"` of
    `no27_steel`, shape (988,): a yardstick for laws of ours.
    """
    return _entries.hystlab_fit(_finder(entry("no27_steel")))


def forc_md00_curves() -> tuple[Recording, ...]:
    """The first-order reversal curves of `forc_md00`, a recording without a clock each,
    in the order of measurement: 296 of 297, for the first has but one point, and 3 make
    a recording. That point, 5.248e-6 A m² at 19.08 mT, is the first row of
    `load("forc_md00")`. The curves have 3, 5, ... and at last 458 rows.

    Before each the sample was saturated at 0.5 T and the field brought down to the
    curve's first row; neither that nor the drift measurement between is in a recording.
    """
    return _entries.forc_curves(_finder(entry("forc_md00")))


def _finder(dataset: Dataset) -> Find:
    files = {file.name: file for file in dataset.files}
    return lambda name: find(dataset.name, files[name])


def _record(dataset: Dataset, record: str | None) -> str:
    if record is None:
        return next(iter(dataset.records), "")
    if not dataset.records:
        raise InputError(
            f"`record`={record!r}: {dataset.name!r} is a single recording; leave "
            "`record` out."
        )
    if record not in dataset.records:
        raise InputError(
            f"{dataset.name!r} has no record {record!r}. "
            f"{known(record, dataset.records)}"
        )
    return record


_TIMEOUT = 30.0  # s without a byte


def folders(name: str) -> tuple[Path, ...]:
    """Where the files of the dataset `name` may lie: first `HYSTJAX_DATA_DIR`, if it
    is set, and last the user's cache; downloads go to the last that there is.

    **Raises:** `InputError` where there is neither.
    """
    given = os.environ.get("HYSTJAX_DATA_DIR")
    places = [Path(given).expanduser()] if given else []
    try:
        places.append(user_cache())
    except InputError:
        if not places:
            raise
    return tuple(place / name for place in places)


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
        made_folder(path.parent)
        write_atomically(path, lambda stream: stream.write(content))
    except InputError as error:
        raise InputError(
            f"{error} For downloads, set XDG_CACHE_HOME to such a folder."
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
