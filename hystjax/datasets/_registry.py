"""The registry: every recording with its files, checksums, terms and loader."""

import difflib
from collections.abc import Iterable

from .._errors import InputError
from ._devices import DEVICES
from ._entry import Dataset
from ._materials import MATERIALS

REGISTRY = {entry.name: entry for entry in (*DEVICES, *MATERIALS)}


def entry(name: str) -> Dataset:
    """The entry called `name`; raises `InputError` with the known names otherwise."""
    if name not in REGISTRY:
        raise InputError(f"there is no dataset {name!r}. {known(name, REGISTRY)}")
    return REGISTRY[name]


def known(name: str, names: Iterable[str]) -> str:
    """The known names in a sentence, with the one most like `name` before them."""
    closest = difflib.get_close_matches(name, list(names), n=1, cutoff=0.5)
    guess = f"Did you mean {closest[0]!r}? " if closest else ""
    return f"{guess}Known are: {', '.join(names)}."
