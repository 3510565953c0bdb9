"""Figures as files."""

import os
from pathlib import Path

from matplotlib.figure import Figure

from .._errors import InputError
from .._files import write_atomically

_FORMATS = (".png", ".pdf", ".svg")


def save(figure: Figure, path: str | os.PathLike) -> None:
    """Write a figure; the file is there whole or not at all.

    **Arguments:**

    - `figure`: what a function of this module returned, or any other figure.
    - `path`: ends with `.png`, `.pdf` or `.svg`.

    **Raises:** `InputError` for another ending, or a file that cannot be written.
    """
    ending = Path(path).suffix.lower()
    if ending not in _FORMATS:
        raise InputError(
            f"`path` must end with one of {', '.join(_FORMATS)}, which says what to "
            f"write; got {str(path)!r}."
        )
    write_atomically(path, lambda out: figure.savefig(out, format=ending[1:], dpi=200))
