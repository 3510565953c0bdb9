"""Results as files."""

import os
from pathlib import Path

from .. import _files, plot
from ._document import AbstractDocument


def write(folder: str | os.PathLike, name: str, document: AbstractDocument) -> None:
    """Write `<name>.json`, `.md` and, where there is a figure, `.png`, each in one
    move; `experiment_<name>` for numbers.

    **Arguments:** the `folder`, made when it does not exist; the `name` of what was
    reproduced; its `document`.

    **Raises:** `InputError` when the folder cannot be written.
    """
    place = _files.made_folder(folder)
    stem = f"experiment_{name}" if name.isdigit() else name
    _files.write_text(Path(place, f"{stem}.json"), document.json())
    _files.write_text(Path(place, f"{stem}.md"), document.markdown())
    if document.drawing is not None:
        plot.save(document.drawing(), Path(place, f"{stem}.png"))
