"""Curves in a text file of a MicroMag magnetometer."""

import re
from pathlib import Path

import numpy as np

from .._errors import InputError
from . import _file

_ROW = re.compile(r"[-+][\d.]+(?:E[-+]\d+)?(?:,[-+][\d.]+(?:E[-+]\d+)?)+")
_COUNT = re.compile(r"^Number of data +(\d+) *$", re.MULTILINE)


def micromag_segments(path: Path) -> list[np.ndarray]:
    """Field and moment of each segment, float64, shape (k, 2), in the file's order and
    units. Segments are runs of rows between blank lines, below the file's header.

    **Raises:** `InputError` when there is no such file, no row in it, or not as many as
    its header says.
    """
    text = _file.text(path)
    segments, open_segment = [], False
    for line in text.split("\n"):
        is_row = _ROW.fullmatch(line.strip()) is not None
        if is_row and not open_segment:
            segments.append([])
        if is_row:
            segments[-1].append([float(cell) for cell in line.split(",")[:2]])
        open_segment = is_row
    found, said = sum(map(len, segments)), _COUNT.search(text)
    if found == 0 or said is None or found != int(said[1]):
        promised = "none promised" if said is None else f"{said[1]} promised"
        raise InputError(
            f"{path} holds {found} rows of field and moment, with {promised} by its "
            "header (`Number of data`). It may be cut short or of another format."
        )
    return [np.array(segment) for segment in segments]
