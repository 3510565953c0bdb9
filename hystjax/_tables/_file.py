"""Files as bytes and as lines, with messages where they cannot be had."""

from pathlib import Path

from .._errors import InputError

_COMMENTS = ("#", "%")


def content(path: Path) -> bytes:
    """The bytes of a file; raises `InputError` when there are none to be had."""
    try:
        read = path.read_bytes()
    except FileNotFoundError:
        raise InputError(
            f"there is no file {path} (looked from {Path.cwd()}); check the path."
        ) from None
    except IsADirectoryError:
        raise InputError(f"{path} is a folder; give a file in it.") from None
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror}.") from None
    if not read:
        raise InputError(f"{path} is empty (0 bytes).")
    return read


def numbered_lines(path: Path) -> list[tuple[int, str]]:
    """The lines of a text file that are neither blank nor comments, each with its
    number from 1; raises `InputError` when there are none.
    """
    lines = [
        (number, line)
        for number, line in enumerate(text(path).split("\n"), 1)
        if (start := line.lstrip()[:1]) and start not in _COMMENTS
    ]
    if not lines:
        raise InputError(f"{path} has no rows: all its lines are blank or comments.")
    return lines


def text(path: Path) -> str:
    """The text of a file, a line feed after each line; raises `InputError` when there
    is none to be had, or it is binary.
    """
    read = content(path)
    if b"\0" in read:
        raise InputError(
            f"{path} is binary, not text. Read a MATLAB file with "
            "`Recording.from_mat`; export a spreadsheet as CSV; save UTF-16 as UTF-8."
        )
    try:
        decoded = read.decode("utf-8-sig")
    except UnicodeDecodeError:
        decoded = read.decode("latin-1")
    return decoded.replace("\r\n", "\n").replace("\r", "\n")
