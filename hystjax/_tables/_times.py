"""When the rows of a table were sampled."""

import numpy as np

from .._errors import InputError
from ._mat import MatTable
from ._text import TextTable


def times(
    table: TextTable | MatTable, time, period, clock: bool, n: int
) -> np.ndarray | None:
    """The times of n rows, s: a column of a table, or from the sampling period, which
    is a number or, in a MATLAB file, the name of a variable; `None` without a clock.

    **Raises:** `InputError` unless one of the two is given, or neither without a clock,
    or for a period that is not one positive number.
    """
    if (time is None) + (period is None) != (1 if clock else 2):
        raise InputError(
            "give either `time`, a column, or `period`, the sampling period in s, or "
            "`clock=False` alone for a quasi-static recording, which has neither; got "
            f"time={time!r}, period={period!r}, clock={clock!r}."
        )
    if not clock:
        return None
    if time is not None:
        return table.column("time", time)
    if isinstance(period, str):
        period = _single(table.column("period", period), period)
    if not 0 < period < np.inf:
        raise InputError(f"`period` must be positive and finite, in s; got {period}.")
    return period * np.arange(n)


def _single(values: np.ndarray, name: str) -> float:
    if len(values) != 1:
        raise InputError(
            f"`period`={name!r} holds {len(values)} values; a sampling period is one "
            "number. For a column of times use `time`."
        )
    return float(values[0])
