"""Which classes files know, by what name, and how much a file may hold.

Limits are checked when a file is written and when it is read: it may come from anyone,
and must be read or refused soon.
"""

import dataclasses
import difflib
import inspect
from collections.abc import Callable
from typing import Any, TypeVar

from .._core.errors import InputError

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
