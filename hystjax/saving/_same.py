"""Whether two models are one and the same."""

import dataclasses
from typing import Any

import equinox as eqx
import jax
import numpy as np

from ._encoding import encoded
from ._storable import Storable


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
