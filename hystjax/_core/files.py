"""Output files: there whole, or not at all."""

import contextlib
import os
import secrets
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any, BinaryIO

from .checks import InputError, described


def path_of(given: str | os.PathLike) -> Path:
    """The path of a file.

    **Raises:** `InputError` for what is none.
    """
    # Nothing, as of a shell's variable that is not set, would be the current folder.
    if not isinstance(given, str | os.PathLike) or not os.fspath(given):
        raise InputError(f"`path` must name a file, got {described(given)}.")
    return Path(given)


def each_key_once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """An object of JSON; raises `ValueError` where a key is there twice."""
    fields = dict(pairs)
    if len(fields) < len(pairs):
        counts = Counter(name for name, _ in pairs)
        twice = sorted(name for name, count in counts.items() if count > 1)
        raise ValueError(f"the same key twice: {', '.join(twice)}")
    return fields


def write_atomically(
    path: str | os.PathLike, writer: Callable[[BinaryIO], Any]
) -> None:
    """Let `writer` fill a temporary file beside `path`, and move it into place.

    **Arguments:**

    - `path`: the file; one that is there already is replaced.
    - `writer`: called with the temporary file, open for writing bytes.

    **Raises:** `InputError` when the folder is missing, when `path` is no path or that
    of something else than a file, or when it cannot be written. Whatever fails, an old
    file stays as it was and nothing temporary stays behind.
    """
    if not isinstance(path, str | os.PathLike):
        raise InputError(f"a file is given by its path, got {described(path)}.")
    if "\0" in os.fspath(path):
        raise InputError(f"{described(path)} is no path: it has a null in it.")
    target = Path(os.path.realpath(path))  # a link stays a link, its file is replaced
    try:
        _check(Path(path), target)
        _replace(target, writer)
    except OSError as error:
        raise InputError(
            f"{target} cannot be written: {error.strerror or error}. Choose a folder "
            "where you may write and that has room."
        ) from None


def check_folder(path: str | os.PathLike) -> Path:
    """A folder for results, before the work that they are of: whether it is there, or
    its place is, and may be written into.

    **Raises:** `InputError` when it is not, or has no name.
    """
    # Nothing, as of a shell's variable that is not set, would be the current folder.
    if not isinstance(path, str | os.PathLike) or not os.fspath(path):
        raise InputError(
            f"a folder is given by its path, got {described(path)}; the current one is "
            "'.'."
        )
    place = Path(path)
    there = next(x for x in (place, *place.parents) if os.path.exists(x))
    if not there.is_dir():
        raise _no_folder(place, f"{there} is a file")
    if not os.access(there, os.W_OK | os.X_OK):
        raise _no_folder(place, f"{there} may not be written into")
    return place


def made_folder(path: str | os.PathLike) -> Path:
    """A folder for results, made when it does not exist.

    **Raises:** `InputError` when it cannot be made, or has no name.
    """
    place = check_folder(path)
    try:
        place.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise _no_folder(place, str(error.strerror)) from None
    return place


def _no_folder(place: Path, why: str) -> InputError:
    return InputError(
        f"the folder {str(place)!r} cannot be made ({why}); choose another."
    )


def user_cache() -> Path:
    """The folder of the user's cache that is hystjax's; it may not be there yet.

    **Raises:** `InputError` for a user without a home, such as of a container.
    """
    cache = os.environ.get("XDG_CACHE_HOME", "")
    try:
        base = Path(cache) if os.path.isabs(cache) else Path.home() / ".cache"
    except RuntimeError:
        raise InputError(
            "this user has no home folder, in which the cache would be: set "
            "XDG_CACHE_HOME to a folder for it."
        ) from None
    return base / "hystjax"


def write_text(path: str | os.PathLike, text: str) -> None:
    """Write `text` as UTF-8; as `write_atomically` in everything else."""
    content = encoded(f"the text of {path}", text)
    write_atomically(path, lambda stream: stream.write(content))


def encoded(what: str, text: str) -> bytes:
    """Text as UTF-8; `what` it is goes into the message.

    **Raises:** `InputError` for what UTF-8 cannot hold.
    """
    try:
        return text.encode()
    except UnicodeEncodeError as error:
        raise InputError(
            f"{what} holds {text[error.start]!a}, which is no character and cannot be "
            "written; in the name of a file it stands for a byte that is not UTF-8. "
            "Rename the file, or correct the text."
        ) from None


def _replace(target: Path, writer: Callable[[BinaryIO], Any]) -> None:
    temporary = target.with_name(f".hystjax-{secrets.token_hex(8)}.tmp")
    try:
        with open(temporary, "xb") as stream:  # unlike mkstemp, with usual permissions
            writer(stream)
            stream.flush()
            os.fsync(stream.fileno())  # or a crash may leave an empty file of that name
        os.replace(temporary, target)
        _sync(target.parent)
    finally:
        temporary.unlink(missing_ok=True)


def _sync(folder: Path) -> None:
    """Let a move outlive a crash, where the system can do that for folders."""
    with contextlib.suppress(OSError):
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


def _check(given: Path, target: Path) -> None:
    if not target.parent.is_dir():
        raise InputError(
            f"{target} cannot be written: there is no folder {target.parent}. Create "
            "it first, or correct the path."
        )
    # As it was given: what /dev/stdout leads to is a pipe, which has no path.
    if given.exists() and not given.is_file():
        what = "a folder" if given.is_dir() else "not an ordinary file"
        raise InputError(f"{given} is {what}; give the path of a file.")
    # Redirected, /dev/stdout leads to a file that would be replaced.
    if given.is_absolute() and given.parts[1:2] in (("dev",), ("proc",)):
        raise InputError(f"{given} is a device; give the path of a file.")
