"""Dates and durations, of Python and in text, as those of NumPy."""

import datetime
import re
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

_DATE = re.compile(r"\d{4}-\d{2}-\d{2}")
_ZONE = re.compile(r"(?<=\d)\s*(?:Z|([+-]\d\d):?(\d\d)?)$")
_LENGTHS = (datetime.timedelta, np.timedelta64)
_MOMENTS = (datetime.date, np.datetime64, *_LENGTHS)


def is_date(cell: Any) -> bool:
    """Whether text begins as a date does."""
    return isinstance(cell, str) and _DATE.match(cell.strip()) is not None


def is_moment(value: Any) -> bool:
    """Whether a value is a date or a duration."""
    return isinstance(value, _MOMENTS)


def moments_in(cells: Sequence[str]) -> np.ndarray:
    """Dates (ISO 8601) as `datetime64[ns]`, in UTC where they tell their time zone.

    **Raises:** `ValueError` for a cell that is no date, or where only some tell a zone.
    """
    cells = [cell.strip() for cell in cells]
    zones = [_ZONE.search(cell, len("2026-01-31")) for cell in cells]
    _check_alike(bool(zone) for zone, cell in zip(zones, cells, strict=True) if cell)
    bare = [
        cell[: zone.start()] if zone else cell
        for zone, cell in zip(zones, cells, strict=True)
    ]
    ahead = [_minutes(*zone.groups()) if zone else 0 for zone in zones]
    return np.array(bare, "datetime64[ns]") - np.array(ahead, "timedelta64[m]")


def moments_of(values: Sequence[Any]) -> np.ndarray:
    """Dates as `datetime64[ns]`, in UTC where they have a time zone, or durations as
    `timedelta64[ns]`.

    **Raises:** `ValueError` for something else among them, or where only some have a
    zone.
    """
    kind = "timedelta64[ns]" if isinstance(values[0], _LENGTHS) else "datetime64[ns]"
    bare, zoned = [], []
    for value in values:
        if value is None or value != value:  # missing, as NaT is
            bare.append(np.array("NaT", kind))
            continue
        if not is_moment(value):
            raise ValueError(f"{value!r} is among them")
        zoned.append(getattr(value, "tzinfo", None) is not None)
        bare.append(_in_utc(value) if zoned[-1] else value)
    _check_alike(zoned)
    return np.array(bare, kind)


def _in_utc(date: datetime.datetime) -> datetime.datetime:
    return date.astimezone(datetime.UTC).replace(tzinfo=None)


def _minutes(hours: str | None, minutes: str | None) -> int:
    """By which a zone is ahead of UTC, from text such as `-03` and `30`."""
    if hours is None:
        return 0
    return int(hours[0] + "1") * (60 * int(hours[1:]) + int(minutes or 0))


def _check_alike(zoned: Iterable[bool]) -> None:
    if len(set(zoned)) > 1:
        raise ValueError("some have a time zone, and others none")
