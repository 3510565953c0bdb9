"""Matrices in a JSON file."""

import json
from pathlib import Path

import numpy as np

from .._errors import InputError
from . import _file


def json_matrix(path: Path, name: str) -> np.ndarray:
    """The list of rows under `name` in a JSON file, as float64, shape (n, m).

    **Raises:** `InputError` when there is no such file or name, the file is not JSON,
    or the rows differ in length or hold something else than numbers.
    """
    try:
        read = json.loads(_file.content(path))
    except ValueError as error:  # of the syntax, or of the encoding
        raise InputError(
            f"{path} cannot be read as JSON ({error}). It may be cut short or of "
            "another format."
        ) from None
    if not isinstance(read, dict) or name not in read:
        names = ", ".join(read) if isinstance(read, dict) and read else "(none)"
        raise InputError(f"{name!r} is not in {path}; its names: {names}.")
    try:
        matrix = np.array(read[name], np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(
            f"{name!r} of {path} is not a matrix of numbers ({error}). Its rows may "
            "differ in length, or hold text; correct or remove them."
        ) from None
    if matrix.ndim != 2:
        raise InputError(
            f"{name!r} of {path} must be a list of rows of numbers, got shape "
            f"{matrix.shape}."
        )
    return matrix
