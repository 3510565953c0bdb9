"""Columns of Parquet files, read a few row groups at a time."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from .._errors import InputError


def parquet_columns(path: Path, names: Mapping[str, str]) -> dict[str, "ParquetColumn"]:
    """Those of some names, both by argument.

    **Raises:** `InputError` without pyarrow, for a file that is missing or not Parquet,
    or a column that is not there or not of numbers.
    """
    pyarrow = _pyarrow()
    try:
        file = pyarrow.parquet.ParquetFile(path)
    except (OSError, pyarrow.ArrowInvalid) as error:
        raise InputError(f"{path} cannot be read: {error}.") from None
    kinds = {field.name: field.type for field in file.schema_arrow}
    for argument, name in names.items():
        if name not in kinds:
            there = ", ".join(f"`{known}`" for known in kinds)
            raise InputError(
                f"`{argument}`: {path} has no column `{name}`; its columns are {there}."
            )
        kind = kinds[name]
        if not (pyarrow.types.is_integer(kind) or pyarrow.types.is_floating(kind)):
            raise InputError(
                f"`{argument}`: column `{name}` of {path} holds {kind}, not numbers."
            )
    return {key: ParquetColumn(file, name) for key, name in names.items()}


class ParquetColumn:
    """A column of numbers, of which rows are read by slices."""

    def __init__(self, file: Any, name: str):
        metadata = file.metadata
        groups = [metadata.row_group(i).num_rows for i in range(file.num_row_groups)]
        self._file, self._name = file, name
        self._ends = np.cumsum(groups)  # of the row groups
        self.shape = (metadata.num_rows,)

    def __getitem__(self, rows: slice) -> np.ndarray:
        start, stop, step = rows.indices(self.shape[0])
        first, last = np.searchsorted(self._ends, [start, stop - 1], side="right")
        read = self._file.read_row_groups(
            range(first, last + 1), columns=[self._name], use_threads=False
        )
        skipped = int(self._ends[first - 1]) if first else 0
        column = read.column(0).to_numpy()
        return column[start - skipped : stop - skipped : step]


def _pyarrow() -> Any:
    try:
        import pyarrow
        import pyarrow.parquet
    except ImportError:
        raise InputError(
            "Parquet files are read by pyarrow, which is not installed; get it with "
            "`pip install hystjax[parquet]`."
        ) from None
    return pyarrow
