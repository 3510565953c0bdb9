"""Columns of a MATLAB file."""

import io
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from .._errors import InputError
from . import _file


@dataclass(frozen=True)
class MatTable:
    """The variables of a MATLAB file.

    **Attributes:**

    - `path`: the file.
    - `variables`: values by name.
    """

    path: Path
    variables: Mapping[str, Any]

    def column(self, argument: str, key: str | tuple[str, int]) -> np.ndarray:
        """The vector `key`, or a column of a matrix, as float64, shape (n,).

        **Arguments:**

        - `argument`: the caller's name for the column, for messages.
        - `key`: a variable that is a vector, or a pair of a matrix and the number of
            its column from 0.

        **Raises:** `InputError` when there is no such variable or column, or it holds
        something else than real numbers.
        """
        name, number = (key, None) if isinstance(key, str) else key
        said = f"`{argument}`={key!r}"
        matrix = self._matrix(said, name)
        if number is None and min(matrix.shape) > 1:
            raise InputError(
                f"{said} is a matrix of shape {matrix.shape}; give its column too, "
                f"such as {argument}=({name!r}, 0)."
            )
        if number is None:
            return matrix.ravel()
        if not 0 <= number < matrix.shape[1]:
            raise InputError(
                f"{said} is not in {self.path}: {name!r} has shape {matrix.shape}, so "
                f"its columns are numbered from 0 to {matrix.shape[1] - 1}."
            )
        return matrix[:, number]

    def _matrix(self, said: str, name: str) -> np.ndarray:
        if name not in self.variables:
            listed = ", ".join(self.variables) or "(none)"
            raise InputError(f"{said} is not in {self.path}; its variables: {listed}.")
        value = self.variables[name]
        is_array = isinstance(value, np.ndarray)
        if not is_array or value.dtype.kind not in "fiub" or value.ndim != 2:
            kind = value.dtype if is_array else type(value).__name__
            raise InputError(
                f"{said} of {self.path} is not a vector or matrix of real numbers: it "
                f"is of type {kind} and shape {np.shape(value)}. Save it as one."
            )
        return value.astype(np.float64)


def read_mat(path: str | os.PathLike) -> MatTable:
    """Read the variables of a MATLAB file, version 7.2 or older.

    **Raises:** `InputError` when there is no such file, or it is empty, broken, or of
    version 7.3.
    """
    import scipy.io  # slow to import, and rarely needed

    path = Path(path)
    content = _file.content(path)
    if content.startswith((b"MATLAB 7.3", b"\x89HDF")):
        raise InputError(
            f"{path} is a MATLAB 7.3 (HDF5) file, which hystjax does not read. In "
            "MATLAB, save it again with `save(file, '-v7')`."
        )
    try:
        loaded = scipy.io.loadmat(io.BytesIO(content))
    except Exception as error:  # SciPy raises almost anything on a broken file
        raise InputError(
            f"{path} cannot be read as a MATLAB file ({error}). It may be cut short or "
            "of another format; for text use `Recording.from_csv`."
        ) from None
    return MatTable(path, {k: v for k, v in loaded.items() if not k.startswith("__")})
