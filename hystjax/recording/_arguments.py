"""Recordings as arguments, and what comes in their place."""

import os
from collections.abc import Mapping, Sequence
from typing import Any

import equinox as eqx
import jax
import numpy as np

from .._core.checks import described
from .._core.errors import InputError
from ..signals.excitation import AbstractExcitation
from ._recording import Recording


def as_recording(given: Any, call: str, name: str = "recording") -> Recording:
    """A recording, as it was given.

    **Arguments:** what was given; the `call`, with its arguments in order, such as
    `judge(model, recording)`; and the name of this one.

    **Raises:** `InputError` for something else, with what is likely to be meant.
    """
    if isinstance(given, Recording):
        return given
    raise InputError(
        f"`{name}` must be a `Recording`, got {described(given)}. {_likely(given)}"
        f"The order is `{call}`."
    )


def _likely(value: Any) -> str:
    """What is likely to be wrong."""
    if isinstance(value, AbstractExcitation):
        return "`excitation.path(t)` is its input at times t. "
    if isinstance(value, eqx.Module):
        return "Were the arguments swapped? "
    if isinstance(value, np.ndarray | jax.Array):
        return "`hystjax.Recording(t, u, w)` makes one of three columns. "
    if isinstance(value, str | os.PathLike):
        return "`hystjax.Recording.from_csv` reads a file. "
    if hasattr(value, "columns"):
        return "`hystjax.Recording.from_pandas` makes one of a frame. "
    if isinstance(value, Sequence | Mapping):
        return "Give one recording at a time. "
    return ""
