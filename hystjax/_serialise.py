"""Models as files: readable, versioned JSON from which no code is ever run."""

import json
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from ._errors import InputError
from ._fields import from_fields, to_fields
from ._files import write_text
from .models import AbstractModel

_FORMAT, _VERSION = "hystjax model", 1


def save(path: str | os.PathLike, model: AbstractModel) -> None:
    """Write a model as JSON, for `load` and for the eye.

    Numbers are kept to the last bit. Coefficients off a `SparseModel`'s support, which
    take no part in the law, load as 0; of functions of your own the name is kept.

    **Arguments:**

    - `path`: the file, replaced whole or not at all.
    - `model`: any of `hystjax.models`.

    **Raises:** `InputError` for another model, a batch of models, a coefficient that is
    NaN or inf, or a file that cannot be written.
    """
    fields = to_fields(model)
    document = {
        "format": _FORMAT,
        "version": _VERSION,
        "kind": fields.pop("kind"),
        "law": str(model),
        **fields,
    }
    write_text(path, _layout(document) + "\n")


def load(
    path: str | os.PathLike, functions: Mapping[str, Callable] | None = None
) -> AbstractModel:
    """The model that `save` wrote.

    **Arguments:**

    - `path`: the file.
    - `functions`: the functions of your own that occur in the law, by name, as they
        were given to `library.Custom`.

    **Raises:** `InputError` for a file that is missing, is not JSON or no model, comes
    from a newer version, lacks a field, or holds an unknown term or a number that is
    NaN or inf. Warns where 64-bit numbers are rounded because JAX has them off.
    """
    document = _read(path)
    try:
        _check_header(document)
        return from_fields(document, functions or {})
    except ValueError as error:
        raise InputError(f"{path}: {error}") from None


def _read(path: str | os.PathLike) -> Any:
    try:
        text = Path(path).read_text(encoding="utf-8-sig")
        return json.loads(text, parse_int=float, object_pairs_hook=_each_key_once)
    except FileNotFoundError:
        raise InputError(f"there is no file {path}.") from None
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror}.") from None
    except (ValueError, RecursionError) as error:
        raise InputError(
            f"{path} is not JSON ({error}). Give a file that `hystjax.save` wrote; if "
            "it was edited by hand, look at that place."
        ) from None


def _each_key_once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    names = [name for name, _ in pairs]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise ValueError(f"the same key twice: {', '.join(twice)}")
    return dict(pairs)


def _check_header(document: Any) -> None:
    if not isinstance(document, dict) or document.get("format") != _FORMAT:
        raise InputError(
            f'this is no model, whose field "format" would be "{_FORMAT}". Give a '
            "file that `hystjax.save` wrote."
        )
    version = document.get("version")
    if isinstance(version, float) and version > _VERSION:
        raise InputError(
            f"this is version {version:g} of the format, and this hystjax reads "
            f"version {_VERSION}. Update hystjax."
        )
    if not isinstance(version, float) or version != _VERSION:
        raise InputError(f'the field "version" must be {_VERSION}, got {version!r}.')


def _layout(document: dict[str, Any], margin: str = "") -> str:
    """JSON with one line a field, and one line a coefficient."""
    lines = []
    for name, value in document.items():
        text = json.dumps(value, ensure_ascii=False)
        if isinstance(value, dict) and value:
            text = _layout(value, margin + "  ")
        lines.append(f"{margin}  {json.dumps(name, ensure_ascii=False)}: {text}")
    return "{\n" + ",\n".join(lines) + f"\n{margin}}}"
