"""What is given as a recording, or as several of one device: checked, and answered
with what was likely to be meant."""

import os
from collections.abc import Mapping, Sequence
from typing import Any

import equinox as eqx
import jax
import numpy as np

from .._core.checks import InputError, described
from ..signals.excitation import AbstractExcitation
from ._long import LongRecording
from ._recording import Recording


def as_recording(given: Any, call: str, name: str = "recording") -> Recording:
    """A recording, as it was given.

    **Arguments:** what was given; the `call`, with its arguments in order, such as
    `judge(model, recording)`; and the name of this one.

    **Raises:** `InputError` for a batch, and for something else, with what is likely to
    be meant.
    """
    if isinstance(given, Recording):
        if given.t.ndim != 1:
            raise InputError(
                f"`{name}` holds a batch, with arrays of shape {given.t.shape}; call "
                "this under `jax.vmap`, or take the recordings apart."
            )
        return given
    if isinstance(given, LongRecording):
        some = f"window(0, {min(len(given), 10_000)})"
        raise InputError(
            f"`{name}` must be a `Recording` in memory, and a `LongRecording` stays on "
            "disk, for `hystjax.identify` alone. `long.window(start, stop)` makes a "
            f"`Recording` of some rows, such as `long.{some}`."
        )
    raise InputError(
        f"`{name}` must be a `Recording`, got {described(given)}. {_likely(given)}"
        f"The order is `{call}`."
    )


def as_group(
    recordings: Recording | Sequence[Recording],
    call: str = "identify(recordings, library)",
) -> tuple[Recording, ...]:
    """One or several recordings as a tuple; the `call` is for messages.

    **Raises:** `InputError` when there is none, one is a batch, their units or names
    differ, or something else was given.
    """
    several = isinstance(recordings, list | tuple)
    group = tuple(recordings) if several else (recordings,)
    group = tuple(as_recording(each, call, "recordings") for each in group)
    if not group:
        raise InputError("`recordings` is empty; pass at least one recording.")
    _check_alike(group)
    return group


def _check_alike(group: tuple[Recording, ...]) -> None:
    """Raise `InputError` unless all recordings have the units and names of the first:
    a law has one unit for its input, and one for its output."""
    first = group[0]
    cures = {
        "units": "Convert the columns to one unit each, and give that as `units`.",
        "names": "If they are the same quantities, give them the same names: "
        "`dataclasses.replace(recording, names=...)`.",
    }
    for kind, cure in cures.items():
        for number, other in enumerate(group):
            if getattr(other, kind) != getattr(first, kind):
                raise InputError(
                    f"`recordings` must be of one device, and the {kind} of recording "
                    f"{number} are {getattr(other, kind)}, those of recording 0 "
                    f"{getattr(first, kind)}. {cure}"
                )


def _likely(value: Any) -> str:
    """What is likely to be wrong."""
    if isinstance(value, AbstractExcitation):
        return "`excitation.path(t)` is its input at times t. "
    if all(hasattr(value, name) for name in "tuw"):  # such as a trajectory
        return "`hystjax.Recording(x.t, x.u, x.w)` makes one of such an x. "
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
