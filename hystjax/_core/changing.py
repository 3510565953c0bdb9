"""Modules with other values in some of their fields."""

from typing import Any, TypeVar

import equinox as eqx

_Module = TypeVar("_Module", bound=eqx.Module)


def changed(module: _Module, **fields: Any) -> _Module:
    """A module with other values for some of its fields, as they are.

    Nothing is converted or checked again, as by `dataclasses.replace`, and no tree is
    taken apart, as by `equinox.tree_at`: either takes longer than a short fit.
    """
    new = object.__new__(type(module))
    vars(new).update(vars(module), **fields)
    return new
