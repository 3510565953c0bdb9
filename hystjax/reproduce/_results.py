"""Results as files."""

import os
from pathlib import Path

from .. import _files
from ._comparison import Comparison


def write(folder: str | os.PathLike, number: str, comparison: Comparison) -> None:
    """Write `experiment_<number>.json` and `.md`, each in one move.

    **Arguments:** the `folder`, made when it does not exist; the `number` of the
    experiment; its `comparison`.

    **Raises:** `InputError` when the folder cannot be written.
    """
    place = _files.made_folder(folder)
    name = f"experiment_{number}"
    _files.write_text(Path(place, f"{name}.json"), comparison.json())
    _files.write_text(Path(place, f"{name}.md"), comparison.markdown())
