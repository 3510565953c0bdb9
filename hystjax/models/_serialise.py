"""Models as files: readable, versioned JSON from which no code is ever run."""

import json
import os
import stat
from collections.abc import Callable, Mapping
from typing import Any

import jax

from .._core.checks import InputError, described, warn
from .._core.files import each_key_once, path_of, write_text
from .._core.solution import Solution
from ..library import check_functions
from ..saving import MOST_BYTES, Context, check_text, difference, encoded
from ._base import AbstractModel
from ._sequence import as_model

_FORMAT, _VERSION = "hystjax model", 2
_IN_A_LINE = {"shape", "python"}


def save(path: str | os.PathLike, model: AbstractModel | Solution) -> None:
    """Write a model as JSON, for `load` and for the eye.

    Numbers are kept to the last bit. Coefficients off a `SparseModel`'s support, which
    take no part in the law, load as 0; terms are named by the numbers that are in them
    now; of functions of your own the name is kept. Before anything is written the model
    is read back in memory, and has to be the same.

    **Arguments:**

    - `path`: the file, replaced whole or not at all.
    - `model`: any model, or the `Solution` of a fit; your own too: `docs/models.md`
        says when it needs `hystjax.models.register`.

    **Raises:** `InputError` for a model that holds what a file cannot, or would not
    come back as it is, a batch of models, a number that is NaN or inf, a name that is
    no text, a model too large for `load`, or a file that cannot be written.
    """
    model = as_model(model, "save(path, model)")
    if not isinstance(model, AbstractModel):
        raise InputError(
            "`model` must be a model of memory, flow and output, got "
            f"{described(model)}, which maps sequences; keep its weights yourself."
        )
    fields, dtype = encoded(model)
    document = {"format": _FORMAT, "version": _VERSION, "dtype": dtype, "model": fields}
    check_text(json.dumps(document, ensure_ascii=False))
    _check_return(model, document)
    text = _layout({"law": str(model), **document}) + "\n"
    check_text(text)
    write_text(path, text)


def _check_return(model: AbstractModel, document: dict[str, Any]) -> None:
    """Raise `InputError` unless a model comes back from its file."""
    document = _parsed(json.dumps(document))
    exact = jax.config.jax_enable_x64 or document["dtype"] == "float64"  # pyright: ignore
    try:
        with jax.enable_x64(exact):
            back = _model(document, _Named())
    except InputError as error:
        raise InputError(
            f"this {type(model).__name__} could be written, but not read back: {error}"
        ) from None
    place = difference(model, back)
    if place is not None:
        raise InputError(
            f"this {type(model).__name__} would come back as another one: {place} "
            "would differ. Its class must make the same model of the same fields; for "
            "parts that are no arrays or plain values, `like` of "
            "`hystjax.models.register` must make the same ones."
        )


class _Named(dict):
    """Stand-ins for the functions of one's own, of which a file holds the names."""

    def __bool__(self):
        return True

    def __contains__(self, name):
        return str(name).isidentifier()

    def __missing__(self, name):
        return _no_function


def _no_function(w, u, du):
    raise NotImplementedError


def load(
    path: str | os.PathLike, functions: Mapping[str, Callable] | None = None
) -> AbstractModel:
    """The model that `save` wrote.

    Nothing in a file is run, and nothing is imported for it: import what defines or
    registers a model of your own before.

    **Arguments:**

    - `path`: the file.
    - `functions`: the functions of your own that occur in the law, by name, as they
        were given to `library.Custom`.

    **Raises:** `InputError` for a file that is missing, is not an ordinary file, has
    more than 4 MB, is not JSON or no model, comes from another version, lacks a field,
    is of a class that is not known here, or holds an unknown term or a number that is
    NaN or inf; whoever wrote it, soon; and for `functions` that are none. Warns where
    64-bit numbers are rounded because JAX has them off.
    """
    if functions is not None:
        check_functions(functions)
    content = _read(path)
    try:
        document = _parsed(content.decode("utf-8-sig"))
        _check_header(document)
        _warn_of_rounding(document["dtype"])
        return _model(document, functions or {})
    except (_NotJSON, UnicodeDecodeError) as error:
        raise InputError(
            f"{path} is not JSON ({_shortened(str(error))}). Give a file that "
            "`hystjax.save` wrote; if it was edited by hand, look at that place."
        ) from None
    except ValueError as error:
        raise InputError(f"{path}: {_shortened(str(error))}") from None
    except RecursionError:  # of a message that shows what came
        raise InputError(
            f"{path} is nested deeper than any model. Give a file that `hystjax.save` "
            "wrote."
        ) from None


def _model(
    document: dict[str, Any], functions: Mapping[str, Callable]
) -> AbstractModel:
    model = Context(functions, document["dtype"]).module(document.get("model"))
    if not isinstance(model, AbstractModel):
        raise InputError(f"this is no model, but {described(model)}.")
    return model


def _read(path: str | os.PathLike) -> bytes:
    """All of a file, which a pipe or a device would not come to the end of."""
    path = path_of(path)
    try:
        if ordinary := stat.S_ISREG(os.stat(path).st_mode):
            with open(path, "rb") as stream:
                content = stream.read(MOST_BYTES + 1)
    except FileNotFoundError:
        raise InputError(f"there is no file {path}.") from None
    except (OSError, ValueError) as error:  # the latter for a path that cannot be
        why = getattr(error, "strerror", None) or error
        raise InputError(f"{str(path)!r} cannot be read: {why}.") from None
    if not ordinary:
        what = "a folder" if path.is_dir() else "not an ordinary file"
        raise InputError(
            f"{path} cannot be read: it is {what}. Give the path of a file; what comes "
            "through a pipe, write to a file first."
        )
    if len(content) > MOST_BYTES:
        raise InputError(
            f"{path} has more than {MOST_BYTES / 1e6:g} MB, and no model that "
            "`hystjax.save` writes has. Give a file that it wrote; a law with more "
            "candidates than that, save again without those it does not use: "
            "`hystjax.save(path, model.compact())`."
        )
    return content


class _NotJSON(InputError):
    """What came is no JSON at all."""


def _parsed(text: str) -> Any:
    try:
        return json.loads(text, parse_int=_whole, object_pairs_hook=each_key_once)
    except (ValueError, RecursionError) as error:
        raise _NotJSON(str(error)) from None


def _whole(digits: str) -> int | float:
    return int(digits) if len(digits) < 25 else float(digits)


_LONG = 600  # letters of a message


def _shortened(message: str) -> str:
    """A message without its middle, where a file is shown, if that is long."""
    if len(message) <= _LONG:
        return message
    return f"{message[: _LONG // 2]} [...] {message[-_LONG // 2 :]}"


def _check_header(document: Any) -> None:
    if not isinstance(document, dict) or document.get("format") != _FORMAT:
        raise InputError(
            f'this is no model, whose field "format" would be "{_FORMAT}". Give a '
            "file that `hystjax.save` wrote."
        )
    version = document.get("version")
    if isinstance(version, bool) or not isinstance(version, int | float):
        raise InputError(f'the field "version" must be {_VERSION}, got {version!r}.')
    if version > _VERSION:
        raise InputError(
            f"this is version {version:g} of the format, and this hystjax reads "
            f"version {_VERSION}. Update hystjax."
        )
    if version != _VERSION:
        raise InputError(f'the field "version" must be {_VERSION}, got {version!r}.')
    if document.get("dtype") not in ("float32", "float64"):
        raise InputError(
            f'"dtype" must be float32 or float64, got {document.get("dtype")!r}.'
        )


def _warn_of_rounding(dtype: str) -> None:
    if jax.dtypes.canonicalize_dtype(dtype) != dtype:
        warn(
            "this model was saved with 64-bit numbers, and they are rounded to 32 bits "
            "because JAX has 64-bit numbers off; switch them on first, with "
            "`jax.config.update('jax_enable_x64', True)`.",
        )


def _layout(document: dict[str, Any], margin: str = "") -> str:
    """JSON with one line a field, and one line a coefficient."""
    lines = []
    for name, value in document.items():
        text = json.dumps(value, ensure_ascii=False)
        if isinstance(value, dict) and value and not _IN_A_LINE & set(value):
            text = _layout(value, margin + "  ")
        lines.append(f"{margin}  {json.dumps(name, ensure_ascii=False)}: {text}")
    return "{\n" + ",\n".join(lines) + f"\n{margin}}}"
