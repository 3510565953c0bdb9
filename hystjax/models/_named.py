"""The numbers of a model by name, and the model with others in their place."""

from collections.abc import Mapping
from dataclasses import fields
from typing import Any, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from .._core.checks import is_concrete

Model = TypeVar("Model", bound=eqx.Module)


def leaf_parameters(tree: Any) -> dict[str, Array]:
    """Every real number in a PyTree by its place."""
    flat: dict[str, Array] = {}
    for path, leaf in _inexact(tree):
        # Each number that a device takes out is a program run: of tens of thousands,
        # such as relays have, that would be many seconds.
        host = np.asarray(leaf) if is_concrete(leaf) else None
        for name, index in _entries(path, leaf):
            flat[name] = leaf[index] if host is None else jnp.asarray(host[index])
    return flat


def replace_leaves(tree: Any, values: Mapping[str, Array]) -> Any:
    """The PyTree with other numbers at some of these places."""
    known = leaf_parameters(tree) | dict(values)

    def changed(path, leaf):
        if not eqx.is_inexact_array(leaf):
            return leaf
        entries = [known[name] for name, _ in _entries(path, leaf)]
        return jnp.stack(entries).reshape(leaf.shape) if entries else leaf

    return jax.tree_util.tree_map_with_path(changed, tree)


def _inexact(tree):
    every = jax.tree_util.tree_leaves_with_path(tree)
    return [(path, leaf) for path, leaf in every if eqx.is_inexact_array(leaf)]


def _entries(path, leaf: Array):
    """Names and indices of the numbers in one array."""
    place = jax.tree_util.keystr(path, simple=True, separator=".")
    for index in np.ndindex(leaf.shape):
        numbered = f"[{','.join(map(str, index))}]" if index else ""
        yield place + numbered, index


def field_parameters(model: eqx.Module) -> dict[str, Array]:
    """The numbers in a model's fields, by name: `n`, or `alpha[0]`, ... for those of a
    tuple."""
    flat: dict[str, Array] = {}
    for name, value in _numeric_fields(model).items():
        entries = value if isinstance(value, tuple) else (value,)
        flat |= dict(zip(_entry_names(name, value), entries, strict=True))
    return flat


def replace_fields(model: Model, values: Mapping[str, Array]) -> Model:
    """The model with other values for some of those numbers."""
    old = _numeric_fields(model)
    flat = field_parameters(model) | dict(values)

    def new(name):
        entries = tuple(flat[entry] for entry in _entry_names(name, old[name]))
        return entries if isinstance(old[name], tuple) else entries[0]

    return eqx.tree_at(
        lambda tree: [getattr(tree, name) for name in old], model, list(map(new, old))
    )


def _numeric_fields(model: eqx.Module) -> dict[str, Array | tuple[Array, ...]]:
    """Fields that are an array, or a tuple of arrays."""
    values = {field.name: getattr(model, field.name) for field in fields(model)}
    return {
        name: value
        for name, value in values.items()
        if eqx.is_array(value) or (isinstance(value, tuple) and eqx.is_array(value[0]))
    }


def _entry_names(name: str, value: Array | tuple[Array, ...]) -> tuple[str, ...]:
    if not isinstance(value, tuple):
        return (name,)
    return tuple(f"{name}[{i}]" for i in range(len(value)))
