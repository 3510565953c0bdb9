"""Models as plain values, that JSON has; which classes files know, and by what name.

Limits are checked when a file is written and when it is read: it may come from anyone,
and must be read or refused soon.
"""

import dataclasses
import difflib
import inspect
from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.tree_util as jtu
import numpy as np

from .._core.checks import InputError, is_concrete

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


Class = TypeVar("Class", bound=type)

RESERVED = ("kind", "like")  # keys of a file that fields cannot have

_CLASSES: dict[str, type] = {}
_NAMES: dict[type, str] = {}
_LIKE: dict[type, Callable] = {}


def register(
    cls: Any = None, *, name: str | None = None, like: Callable | None = None
) -> Any:
    """Let `hystjax.save` and `hystjax.load` know a class of one's own.

    Models and memories whose fields are arrays, numbers, text, `None`, other such
    models, and tuples, lists and dictionaries of these are known as soon as they are
    defined, by their module and name. To register them is needed for

    - a shorter name, which stays when the class moves to another module;
    - an `eqx.Module` of one's own that is part of a model, and neither a model nor a
        memory itself;
    - a model with parts whose structure a file cannot hold, such as an `eqx.nn.MLP`:
        these are made anew by `like`, and their arrays are filled in.

    A file never imports anything: `load` knows what has been imported before.

    **Arguments:**

    - `cls`: the class; it is returned, so that `register` is a decorator, with or
        without the other arguments.
    - `name`: for files; by default `module.Class`.
    - `like`: a function that makes a model of this class whose opaque parts are as
        those of the one that is saved, whatever their numbers. Its parameters are
        attributes of the model, and saved: `like(width, depth)` is called with
        `model.width` and `model.depth`.

    **Raises:** `InputError` for a name that another class has.
    """
    if cls is None:
        return lambda cls: register(cls, name=name, like=like)
    _remember(cls, _usual(cls) if name is None else _checked(name))
    if like is not None:
        _LIKE[cls] = like
    return cls


def remember(cls: type) -> None:
    """Register a class under its usual name, as soon as it is defined."""
    _remember(cls, _usual(cls))


def _remember(cls: type, name: str) -> None:
    known = _CLASSES.get(name)
    if known is not None and known is not cls and _where(known) != _where(cls):
        raise InputError(
            f"the name {name!r} is that of {'.'.join(_where(known))} already; register "
            f"{'.'.join(_where(cls))} under another `name`."
        )
    _CLASSES[name], _NAMES[cls] = cls, name  # of a class defined again, the last one


def _usual(cls: type) -> str:
    """The bare name of a class of this package, and that of others with its module."""
    module, name = _where(cls)
    return name if module.startswith("hystjax.") else f"{module}.{name}"


def _where(cls: type) -> tuple[str, str]:
    return cls.__module__, cls.__qualname__


def _checked(name: str) -> str:
    if not isinstance(name, str) or not name or not name.isprintable():
        raise InputError(f"`name` must be text that can be printed, got {name!r}.")
    return name


def name_of(cls: type) -> str | None:
    """The name of a class in files, if it is registered."""
    return _NAMES.get(cls)


def class_of(name: str) -> type:
    """The class of a name in files.

    **Raises:** `InputError` for a name that is not registered.
    """
    cls = _CLASSES.get(name)
    if cls is None or inspect.isabstract(cls):
        kinds = [
            name for name, each in _CLASSES.items() if not inspect.isabstract(each)
        ]
        alike = difflib.get_close_matches(name, kinds, cutoff=0.75)
        guess = f" Did you mean {' or '.join(alike)}?" if alike else ""
        raise InputError(
            f"{name!r} is no kind of model that is known here. Import the package that "
            "registers it before, by `hystjax.models.register` or as a subclass of "
            f"`AbstractModel`.{guess}"
        )
    return cls


def like_of(cls: type) -> Callable | None:
    """What makes the opaque parts of a class, if there are any."""
    return _LIKE.get(cls)


def settings(module: Any) -> dict[str, Any]:
    """The attributes of a model that `like` is called with."""
    cls = type(module)
    names = inspect.signature(_LIKE[cls]).parameters
    missing = [name for name in names if not hasattr(module, name)]
    if missing:
        raise InputError(
            f"`like` of {cls.__name__} takes {', '.join(names)}, and the model has no "
            f"attribute {', '.join(missing)}; add a field or a property."
        )
    return {name: getattr(module, name) for name in names}


def static_fields(cls: Any) -> dict[str, bool]:
    """The fields that tell a module of a class, and whether each is static: those that
    its constructor takes; all where it is made by `like`."""
    fields = [f for f in dataclasses.fields(cls) if f.init or cls in _LIKE]
    return {f.name: bool(f.metadata.get("static")) for f in fields}


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


def exact(module: Any) -> dict[str, Any]:
    """A model as values that JSON has, each float with its own type: equal where two
    files would be."""
    tree = _value(module, Place(), False)
    return _written(tree, lambda scalar: _listed(np.asarray(scalar)))


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
        instead = (
            " In place of a limit or a radius that is never reached, give one far "
            "beyond the input's range."
        )
        raise InputError(
            f"in a file a model's numbers must be finite, got {place.path} = {bad}."
            f"{instead if np.isinf(bad) else ''}"
        )


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
