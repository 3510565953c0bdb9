"""What a file of a model may hold, checked when it is written and when it is read: a
file may come from anyone, and must be read or refused soon."""

from collections.abc import Callable
from typing import Any

from ._errors import InputError

MOST_BYTES = 4_000_000  # laws take hundreds
_MOST_CANDIDATES = 30_000  # far more than a regression has room for
_MOST_PARAMETERS = 1000
_DEEPEST = 16  # models inside of models; instruments around a butterfly are 3


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


def check_depth(outer: Any, device: Callable[[Any], Any]) -> None:
    """Raise `InputError` for more models inside of each other than make sense;
    `device` gives the next one, or None."""
    for _ in range(_DEEPEST):
        outer = device(outer)
        if outer is None:
            return
    raise InputError(
        f"this is a model inside of a model, and so on, {_DEEPEST} times or more, "
        "which nothing needs; several gains and offsets, for example, make one."
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
