"""Which column, rows and units of a table are meant."""

import re
from collections.abc import Sequence
from typing import Any

from .._core.checks import nearest
from .._core.errors import InputError

_UNIT = re.compile(r"\s*[\[(][^\])]*[\])]\s*$")


def chosen_rows(
    source: Any, held: int, rows: tuple[int | None, int | None]
) -> tuple[int, int]:
    """The first and last (not included) of some rows.

    **Raises:** `InputError` when they are not there.
    """
    first = 0 if rows[0] is None else rows[0]
    last = held if rows[1] is None else rows[1]
    if not 0 <= first < last <= held:
        raise InputError(
            f"`rows`={rows} is not inside {source}: it has {held} rows, counted "
            "from 0 after the header, and the first must be less than the last."
        )
    return first, last


def place(
    source: str, names: Sequence[str], width: int, argument: str, key: str | int
) -> int:
    """The number of a column, by a number from 0, as int or in digits, or by its name:
    exact, or without regard to case and without its unit in brackets.

    **Raises:** `InputError` when there is no such column, or more than one.
    """
    if isinstance(key, int) or key.strip().isdecimal():
        found = [int(key)] if 0 <= int(key) < width else []
    else:
        found = _matching(names, key.strip())
    if len(found) == 1:
        return found[0]
    problem = f"fits {len(found)} columns" if found else "is not a column"
    near = "" if found else nearest(key, names)
    raise InputError(
        f"`{argument}`={key!r} {problem} of {source}. {near}{_listed(names, width)}"
    )


def _listed(names: Sequence[str], width: int) -> str:
    numbers = f"Columns are numbered from 0 to {width - 1}"
    if not names:
        return f"{numbers}; the file has no header line, so they have no names."
    listed = ", ".join(f"{i} {name!r}" for i, name in enumerate(names))
    return f"{numbers}: {listed}."


def unit_in(name: str) -> str:
    """The unit in brackets behind a name, such as `ms` in `Time (ms)`, or nothing."""
    found = _UNIT.search(name)
    return found[0].strip().strip("[]()") if found else ""


def _matching(names: Sequence[str], key: str) -> list[int]:
    """The columns of that very name, or else those alike but for case and unit."""
    exact = [i for i, name in enumerate(names) if name == key]
    wanted = key.casefold()
    alike = [
        i
        for i, name in enumerate(names)
        if wanted in (name.casefold(), _UNIT.sub("", name).casefold())
    ]
    return exact or alike
