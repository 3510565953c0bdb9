"""What a file of a model may hold, checked when it is written and when it is read: a
file may come from anyone, and must be read or refused soon."""

from typing import Any

from .._errors import InputError

MOST_BYTES = 4_000_000  # laws take hundreds
_MOST_CANDIDATES = 30_000  # far more than a regression has room for
_MOST_PARAMETERS = 1000
_DEEPEST = 16  # models or lists inside of others; instruments on a butterfly are 3


def check_text(text: str) -> None:
    """Raise `InputError` for text that cannot be written, or not be read back."""
    try:
        size = len(text.encode())
    except UnicodeEncodeError as error:
        around = text[max(0, error.start - 20) : error.end + 20]
        raise InputError(
            f"`model` has a name or unit with half a character, in {around!r}, which "
            "no file can hold. Make it, or the recording it came from, with another "
            "name."
        ) from None
    if size > MOST_BYTES:
        raise InputError(
            f"`model` takes {size / 1e6:.1f} MB as a file, and at most "
            f"{MOST_BYTES / 1e6:g} MB are read back. Save a law without the candidates "
            "that it does not use: `model.compact()`."
        )


def check_depth(depth: int) -> None:
    """Raise `InputError` for more models inside of each other than make sense."""
    if depth > _DEEPEST:
        raise InputError(
            f"this is a model inside of a model, and so on, {_DEEPEST} times or more, "
            "which nothing needs; several gains and offsets, for example, make one."
        )


def check_nesting(depth: int) -> None:
    """Raise `InputError` for more lists inside of each other than make sense."""
    if depth > _DEEPEST:
        raise InputError(
            f"these are lists inside of lists, and so on, {_DEEPEST} times or more, "
            "which no model needs."
        )


def check_settings(values: Any, numbers: int) -> None:
    """Raise `InputError` for settings that would make far more than `numbers`, those
    that the file holds: a layer has a number at least."""
    most = max(numbers, _MOST_PARAMETERS)
    if isinstance(values, dict | list | tuple):
        for each in values.values() if isinstance(values, dict) else values:
            check_settings(each, numbers)
    elif isinstance(values, int | float) and abs(values) > most:
        raise InputError(
            f"a model is made anew with settings of {most} at most, got {values:g}."
        )


def check_candidates(count: int) -> None:
    """Raise `InputError` for more candidate terms than a file may hold."""
    if count > _MOST_CANDIDATES:
        raise InputError(
            f"this law has {count} candidate terms, and files hold at most "
            f"{_MOST_CANDIDATES}; save it without those it does not use: "
            "`model.compact()`."
        )


def check_parameters(count: int) -> None:
    """Raise `InputError` for more parameters than a file may hold."""
    if count > _MOST_PARAMETERS:
        raise InputError(
            f"this model has {count} parameters, and files hold at most "
            f"{_MOST_PARAMETERS}; is that polynomial meant to be so long?"
        )
