"""Models as plain values, that JSON has."""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.tree_util as jtu
import numpy as np

from .._core.checks import is_concrete
from .._core.errors import InputError
from ._registry import RESERVED, check_depth, like_of, name_of, settings, static_fields

DTYPES = ("bool", "int8", "int16", "int32", "int64", "uint8", "uint16", "uint32")
DTYPES += ("uint64", "float16", "float32", "float64")
ARRAY = {"dtype", "shape", "numbers"}
_SOLE = ({"python"}, {"list"}, {"dict"}, {"leaves"}, ARRAY)


class Unfit(InputError):
    """What a file cannot hold as it is."""


class Place(NamedTuple):
    """Where in a model something is, and in how many models inside of each other."""

    path: str = ""
    depth: int = 0

    def at(self, name: str) -> "Place":
        """A named part."""
        return self._replace(path=f"{self.path}.{name}".lstrip("."))

    def inside(self) -> "Place":
        """Inside of one more model."""
        check_depth(self.depth + 1)
        return self._replace(depth=self.depth + 1)


def encoded(module: Any) -> tuple[dict[str, Any], str]:
    """A model as values that JSON has, and the type of its numbers: the widest of those
    that stand alone; plain numbers in the file are of that type.

    **Raises:** `InputError` for what a file cannot hold.
    """
    found: set[np.dtype] = set()
    tree = _value(module, Place(), False)
    _written(tree, lambda scalar: found.add(scalar.dtype))
    if not found:  # as in a law without terms
        leaves = jax.tree.leaves(eqx.filter(module, eqx.is_inexact_array))
        types = [np.asarray(leaf).dtype for leaf in leaves]
        found = set(sorted(types, key=lambda dtype: dtype.itemsize)[:1])
    dtype = np.result_type(np.float32, *found)
    return _written(tree, lambda scalar: _plain(scalar, dtype)), dtype.name


def _written(tree: Any, number: Callable[[Any], Any]) -> Any:
    """The values, with floats that stand alone as `number` has them."""
    if isinstance(tree, dict):
        return {key: _written(value, number) for key, value in tree.items()}
    if isinstance(tree, list):
        return [_written(value, number) for value in tree]
    return number(tree) if isinstance(tree, np.floating) else tree


def _plain(scalar: np.floating, dtype: np.dtype) -> Any:
    return float(scalar) if scalar.dtype == dtype else _listed(np.asarray(scalar))


def _value(value: Any, place: Place, static: bool) -> Any:
    """A value as JSON has it, but for floats that stand alone."""
    match value:
        case None | str() | bool():
            return value
        case int() | float() if type(value) in (int, float):
            _check_finite(np.asarray(value), place)
            return value if static else {"python": value}
        case np.generic() | np.ndarray() | jax.Array():
            return _array(value, place)
        case eqx.Module() if name_of(type(value)) is not None:
            return _module(value, place.inside())
    if type(value) is tuple:
        return _each(value, place, static)
    if type(value) is list:
        return {"list": _each(value, place, static)}
    if type(value) is dict and all(isinstance(key, str) for key in value):
        each = {key: _value(x, place.at(key), static) for key, x in value.items()}
        escaped = "kind" in each or set(each) in _SOLE
        return {"dict": each} if escaped else each
    raise Unfit(
        f"a file cannot hold the {type(value).__name__} that is the model's "
        f"{place.path or 'own'}. Register what holds it by "
        "`hystjax.models.register(..., like=...)`, with a function that makes such a "
        "part anew; `docs/models.md` shows how."
    )


def _each(values, place: Place, static: bool) -> list:
    return [_value(x, place.at(str(i)), static) for i, x in enumerate(values)]


def _array(value: Any, place: Place) -> Any:
    if not is_concrete(value):
        raise InputError("`model` is being traced; save it outside `jit` and `vmap`.")
    if jnp.issubdtype(value.dtype, jax.dtypes.extended):
        raise Unfit(f"a file cannot hold random keys, such as the model's {place.path}")
    array = np.asarray(value)
    if array.dtype.name not in DTYPES:
        raise InputError(
            f"a file holds real numbers of {', '.join(DTYPES)}, and the model's "
            f"{place.path} is {array.dtype.name}."
        )
    _check_finite(array, place)
    alone = array.ndim == 0 and np.issubdtype(array.dtype, np.floating)
    return array[()] if alone else _listed(array)


def _listed(array: np.ndarray) -> dict[str, Any]:
    numbers = array.ravel().tolist()
    return {"dtype": array.dtype.name, "shape": list(array.shape), "numbers": numbers}


def _check_finite(array: np.ndarray, place: Place) -> None:
    if not np.all(np.isfinite(array)):
        bad = array[~np.isfinite(array)].ravel()[0]
        raise InputError(f"a model's numbers must be finite, got {place.path} = {bad}.")


def _module(module: Any, place: Place) -> dict[str, Any]:
    cls = type(module)
    fields = to_fields(module)
    static, like = static_fields(cls), like_of(cls) is not None
    taken = [name for name in RESERVED if name in static]
    if taken:
        raise InputError(f"{cls.__name__} cannot have a field {taken[0]!r} in a file.")
    described: dict[str, Any] = {"kind": name_of(cls)}
    for name, value in fields.items():
        within, fixed = place.at(name), static.get(name, name == "like")
        try:
            described[name] = _value(value, within, fixed)
        except Unfit:
            if not like or name == "like":
                raise
            described[name] = _leaves(value, within)
    return described


def to_fields(module: Any) -> dict[str, Any]:
    """What a file holds of a module, by name."""
    own = getattr(module, "to_fields", None)
    return plain_fields(module) if own is None else own()


def plain_fields(module: Any) -> dict[str, Any]:
    """The fields of a module; and where some are opaque, how to make such ones."""
    cls = type(module)
    found = {name: getattr(module, name) for name in static_fields(cls)}
    return found if like_of(cls) is None else {"like": settings(module)} | found


def _leaves(part: Any, place: Place) -> dict[str, Any]:
    """The arrays in an opaque part, by their place in it."""
    every = jtu.tree_leaves_with_path(part)
    arrays = {place_of(path): leaf for path, leaf in every if eqx.is_array(leaf)}
    return {"leaves": {at: _array(x, place.at(at)) for at, x in arrays.items()}}


def place_of(path: Any) -> str:
    """The place of a leaf, such as `layers.0.weight`."""
    return jtu.keystr(path, simple=True, separator=".")
