"""How time and units are written: dates, times of day and durations, of Python and in
text, as those of NumPy; and which text is a unit, which of these physics asks for, and
what others are in these."""

import datetime
import re
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

# ISO 8601, and the same with other marks between year, month and day.
_DATE = re.compile(r"(\d{4})([-/.])(\d{2})\2(\d{2})")
_DATE_BY_DAY = re.compile(
    r"(\d{1,2})([-/.])(\d{1,2}|[A-Za-z]{3,9})\2(\d{4}|\d\d)(?!\d)(?:[\sT,]+(.+))?"
)
_NAMES = "jan feb mar apr may jun jul aug sep oct nov dec"
_MONTHS = {name: place for place, name in enumerate(_NAMES.split())}
_TIME_OF_DAY = re.compile(
    r"(\d+):([0-5]?\d):([0-5]?\d)(?:[.,](\d{1,9}))?(?:\s*([AP])\.?M\.?)?", re.IGNORECASE
)
_ZONE = re.compile(r"(?<=\d)\s*(?:Z|([+-]\d\d):?(\d\d)?)$")
_LENGTHS = (datetime.timedelta, np.timedelta64)
_MOMENTS = (datetime.date, np.datetime64, *_LENGTHS)


def tells_time(cell: Any) -> bool:
    """Whether text begins as a date does, or as a time of day."""
    if not isinstance(cell, str):
        return False
    forms = (_DATE, _DATE_BY_DAY, _TIME_OF_DAY)
    return any(form.match(cell.strip()) for form in forms)


def is_time_of_day(cell: str) -> bool:
    """Whether text is one, and no more."""
    return _TIME_OF_DAY.fullmatch(cell) is not None


def is_moment(value: Any) -> bool:
    """Whether a value is a date, be it by a period of pandas, or a duration."""
    return isinstance(_begun(value), _MOMENTS)


def _begun(value: Any) -> Any:
    """A value as it is, and a period of pandas as the date on which it begins."""
    return getattr(value, "start_time", value)


def moments_in(cells: Sequence[str]) -> np.ndarray:
    """Dates (ISO 8601) as `datetime64[ns]`, in UTC where they tell their time zone;
    dates such as 31.1.2026 12:30:05.250, 1/31/2026 12:30:05 PM or 31-Jan-2026, all of
    which may have years of two digits; or times of day alone, as `timedelta64[ns]`.
    Empty ones are NaT.

    **Raises:** `ValueError` for a cell that is no date, or no time of day, as the first
    is; where only some tell a zone; or where days and months cannot be told apart.
    """
    cells = [cell.strip() for cell in cells]
    first = next(filter(None, cells), "")
    if _TIME_OF_DAY.match(first):
        return _through_midnight(_times_of_day(cells))
    if _DATE_BY_DAY.match(first):
        return _by_day(cells)
    cells = [_DATE.sub(r"\1-\3-\4", cell, 1).replace(",", ".") for cell in cells]
    zones = [_ZONE.search(cell, len("2026-01-31")) for cell in cells]
    _check_alike(bool(zone) for zone, cell in zip(zones, cells, strict=True) if cell)
    bare = [
        cell[: zone.start()] if zone else cell
        for zone, cell in zip(zones, cells, strict=True)
    ]
    ahead = [_minutes(*zone.groups()) if zone else 0 for zone in zones]
    return np.array(bare, "datetime64[ns]") - np.array(ahead, "timedelta64[m]")


def _times_of_day(cells: Sequence[str]) -> np.ndarray:
    found = [_TIME_OF_DAY.fullmatch(cell) for cell in cells]
    for time, cell in zip(found, cells, strict=True):
        if cell and (time is None or (time[5] and not 1 <= int(time[1]) <= 12)):
            raise ValueError(f"{cell!r} is no time of day")
    if len({time[5] is None for time in found if time}) > 1:
        raise ValueError("some say AM or PM, and others do not")
    return np.array(list(map(_since_midnight, found)))


def _since_midnight(time: re.Match | None) -> np.timedelta64:
    if time is None:
        return np.timedelta64("NaT", "ns")
    hours, minutes, seconds = map(int, time.groups()[:3])
    if time[5]:
        hours = hours % 12 + 12 * (time[5] in "pP")
    fraction = (time[4] or "").ljust(9, "0")
    whole = 3600 * hours + 60 * minutes + seconds
    return np.timedelta64(10**9 * whole + int(fraction), "ns")


_ORDERS = {  # places of day, month and year
    "the day": (0, 1, 2),
    "the month": (1, 0, 2),
    "the year": (2, 1, 0),
}


def _by_day(cells: Sequence[str]) -> np.ndarray:
    """Dates with the day or the month first, and then the year; or, of two digits, the
    year first.

    Which of them is first matters only where the date changes. It is the day before
    points and before the name of a month; else what makes days of all of them, none
    before the last.
    """
    found = [_DATE_BY_DAY.fullmatch(cell) for cell in cells]
    for date, cell in zip(found, cells, strict=True):
        if cell and date is None:
            raise ValueError(f"{cell!r} is no date")
    written = [date and (date[1], date[3], date[4]) for date in found]
    (one, mark, other, year, *_), *_ = (date.groups() for date in found if date)
    by_day = mark == "." or other.isalpha()
    long = len(one) < 2 or len(year) > 2
    orders = list(_ORDERS.items())[: 1 if by_day else 2 if long else 3]
    readings = {first: _days(written, order) for first, order in orders}
    known = {first: days for first, days in readings.items() if days is not None}
    if not known:
        raise ValueError(f"{one}{mark}{other} and others are not all days of a year")
    onwards = {first: days for first, days in known.items() if not _goes_back(days)}
    likely = onwards or known
    days, *others = likely.values()
    if others and len(set(days) - {_NO_DAY}) > 1:
        said = " or ".join(likely)
        raise ValueError(f"{one} in {one}{mark}{other}{mark}{year} may be {said}")
    times = _times_of_day([_with_seconds(date) for date in found])
    return np.array(days, "datetime64[ns]") + times


_NO_DAY = np.datetime64("NaT", "D")


def _days(
    written: Sequence[tuple[str, str, str] | None], order: tuple[int, int, int]
) -> list[np.datetime64] | None:
    """Dates with day, month and year at those places; `None` where one is none."""
    try:
        each = {
            date: _day(*(date[place] for place in order))
            for date in filter(None, {*written})
        }
    except ValueError:
        return None
    return [each[date] if date else _NO_DAY for date in written]


def _goes_back(days: Sequence[np.datetime64]) -> bool:
    known = np.array(days)
    return bool(np.any(np.diff(known[~np.isnat(known)]) < np.timedelta64(0, "D")))


_FIRST_YEAR = 69  # of two digits that is one of the last century, as POSIX has it


def _day(day: str, month: str, year: str) -> np.datetime64:
    if month.isalpha():
        month = str(1 + _MONTHS.get(month[:3].lower(), 12))
    if len(year) == 2:
        year = ("19" if int(year) >= _FIRST_YEAR else "20") + year
    return np.datetime64(f"{year}-{int(month):02}-{int(day):02}", "D")


def _with_seconds(date: re.Match | None) -> str:
    """The time of day behind a date, of which seconds or all may be missing."""
    if date is None:
        return ""
    return re.sub(r"^(\d+:\d+)(?![:\d])", r"\1:00", date[5] or "0:00:00")


_DAY = np.timedelta64(24, "h")


def _through_midnight(times: np.ndarray) -> np.ndarray:
    """Times that go on after midnight, where those of day begin again at zero: they
    come back by more than half a day."""
    steps = np.diff(times, prepend=times[:1])
    return times + np.cumsum(steps < -_DAY / 2) * _DAY


def moments_of(values: Sequence[Any]) -> np.ndarray:
    """Dates as `datetime64`, in UTC where they have a time zone, or durations as
    `timedelta64`, to the finest unit among them.

    **Raises:** `ValueError` for something else among them, or where only some have a
    zone.
    """
    kind = "timedelta64" if isinstance(values[0], _LENGTHS) else "datetime64"
    bare, zoned = [], []
    for value in map(_begun, values):
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


# -------------------------------------------------------------------------- units

# Into SI: the unit, and by what values are multiplied.
_SI = {
    "Oe": ("A/m", 1e3 / (4 * np.pi)),
    "kOe": ("A/m", 1e6 / (4 * np.pi)),
    "kA/m": ("A/m", 1e3),
    "MA/m": ("A/m", 1e6),
    "mA/m": ("A/m", 1e-3),
    "A/cm": ("A/m", 1e2),
    "A/mm": ("A/m", 1e3),
    "mOe": ("A/m", 1 / (4 * np.pi)),
    "G": ("T", 1e-4),
    "kG": ("T", 1e-1),
    "mT": ("T", 1e-3),
    "µT": ("T", 1e-6),
    "nT": ("T", 1e-9),
    "T": ("T", 1.0),
    "emu": ("A m²", 1e-3),
    "memu": ("A m²", 1e-6),
    "emu/cm³": ("A/m", 1e3),
    "emu/g": ("A m²/kg", 1.0),
    "mA m²": ("A m²", 1e-3),
    "µA m²": ("A m²", 1e-6),
    "nA m²": ("A m²", 1e-9),
    "cm": ("m", 1e-2),
    "mm": ("m", 1e-3),
    "µm": ("m", 1e-6),
    "nm": ("m", 1e-9),
    "in": ("m", 0.0254),
    "ft": ("m", 0.3048),
    "mN": ("N", 1e-3),
    "kN": ("N", 1e3),
    "MN": ("N", 1e6),
    "kgf": ("N", 9.80665),
    "lbf": ("N", 4.4482216152605),
    "kip": ("N", 4448.2216152605),
    "kPa": ("Pa", 1e3),
    "MPa": ("Pa", 1e6),
    "GPa": ("Pa", 1e9),
    "bar": ("Pa", 1e5),
    "psi": ("Pa", 6894.757293168361),
    "ksi": ("Pa", 6894757.293168361),
    "kV": ("V", 1e3),
    "mV": ("V", 1e-3),
}


def to_si(unit: str) -> tuple[str, float]:
    """The SI unit of a unit, and by what values in it are multiplied; itself and 1 for
    one that is not known. In *hybrid SI* fields are in T, as µ0 H, and stay so."""
    return _BY_SPELLING.get(_spelt(unit), (unit, 1.0))


_WORDS = {"oe": "Oe", "oersted": "Oe", "gauss": "G", "tesla": "T"}


def _spelt(unit: str) -> str:
    """One spelling of a unit: `um` is `µm`, `cm^3` is `cm³`, and `gauss` is `G`."""
    letters = str.maketrans("μ²³", "µ23", "^")
    spelt = re.sub(r"^u(?=[a-zA-Z])", "µ", unit.translate(letters))
    return _WORDS.get(spelt.lower(), spelt)


_BY_SPELLING = {_spelt(unit): known for unit, known in _SI.items()}
_PRODUCT = str.maketrans("", "", "·* ")


def differ(one: str, other: str) -> bool:
    """Whether both units are known and not the same, however they are spelt: `um` is
    `µm`, and `A m²` is `A·m^2`."""
    if not (one and other):
        return False
    plain = [_spelt(unit).translate(_PRODUCT) for unit in (one, other)]
    return plain[0] != plain[1]


_SIMPLE = "V A T N Pa m g s min h Hz J W F H Ω Ohm G Oe K rad L bar C S Wb strain ε"
_ALONE = (
    "% ° °C °F deg rpm in inch mil ft lb lbf kgf kip psi ksi emu memu cc Nm kNm Nmm "
    "MNm Am"
)
_WRITTEN_OUT = "Volt Ampere Newton Pascal Meter Second"
_ONE = "|".join(
    [
        rf"[pnuµμmckMG]?(?:{'|'.join(_SIMPLE.split())})",
        *map(re.escape, _ALONE.split()),
        rf"(?i:{'|'.join([*_WRITTEN_OUT.split(), *_WORDS])})",
    ]
)
_POWER = r"(?:\^?-?\d|[²³]|⁻[¹²³])?"
_UNIT = re.compile(rf"(?:{_ONE}){_POWER}(?:\s*[/·*\s]\s*(?:{_ONE}){_POWER})*")


def is_unit(text: str) -> bool:
    """Whether text is a usual unit of what is measured, such as `A/m` or `N·m`."""
    return _UNIT.fullmatch(text) is not None
