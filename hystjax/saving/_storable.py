"""What a file can hold, and whether two of it are one and the same."""

import dataclasses
from typing import Any, TypeVar

import equinox as eqx
import jax
import numpy as np

from ._decoding import Context, made
from ._encoding import encoded, plain_fields
from ._registry import remember

Self = TypeVar("Self", bound="Storable")


class Storable(eqx.Module):
    """What `save` and `load` know as soon as it is defined: by its fields, unless it
    says otherwise. `register` gives it a name of its own."""

    def __init_subclass__(cls, **more: Any):
        super().__init_subclass__(**more)
        remember(cls)

    def to_fields(self) -> dict[str, Any]:
        """What a file holds of it, by name: arrays, numbers, text, `None`, what a file
        can hold, and tuples, lists and dictionaries of these; its fields by default."""
        return plain_fields(self)

    @classmethod
    def from_fields(cls: type[Self], fields: dict[str, Any], context: Context) -> Self:
        """The inverse of `to_fields`. The file may come from anyone: raise an error for
        what makes no sense.

        **Arguments:** what the file holds, whose numbers are Python's; and what is
        known of the file.
        """
        return made(cls, fields, context)


def difference(one: Any, other: Any, place: str = "") -> str | None:
    """Where two models differ, be it in a bit; `None` if nowhere."""
    here = place or "the model itself"
    if isinstance(one, np.generic | np.ndarray | jax.Array):
        return None if _same_array(one, other) else here
    if type(one) is not type(other):
        return here
    if isinstance(one, eqx.Module):
        # A class that has its own way of writing vouches for what it leaves out.
        own = getattr(type(one), "to_fields", None) not in (None, Storable.to_fields)
        if own:
            return None if encoded(one) == encoded(other) else here
        names = [f.name for f in dataclasses.fields(one)]  # pyright: ignore[reportArgumentType]
        pairs = [(n, getattr(one, n, None), getattr(other, n, None)) for n in names]
    elif isinstance(one, tuple | list):
        if len(one) != len(other):
            return here
        pairs = [
            (str(i), a, b) for i, (a, b) in enumerate(zip(one, other, strict=True))
        ]
    elif isinstance(one, dict):
        if list(one) != list(other):
            return here
        pairs = [(str(key), one[key], other[key]) for key in one]
    else:
        return None if one is other or one == other else here
    found = (difference(a, b, f"{place}.{name}".lstrip(".")) for name, a, b in pairs)
    return next((each for each in found if each is not None), None)


def _same_array(one: Any, other: Any) -> bool:
    if not isinstance(other, np.generic | np.ndarray | jax.Array):
        return False
    a, b = np.asarray(one), np.asarray(other)
    return (a.dtype, a.shape, a.tobytes()) == (b.dtype, b.shape, b.tobytes())
