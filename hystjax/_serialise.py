"""Models as files: readable, versioned JSON from which no code is ever run."""

import json
import os
import stat
from collections import Counter
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from ._errors import InputError
from ._fields import from_fields, to_fields
from ._files import write_text
from ._limits import MOST_BYTES, check_text
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
    NaN or inf, a name that is no text, a model too large for `load`, or a file that
    cannot be written.
    """
    fields = to_fields(model)
    document = {
        "format": _FORMAT,
        "version": _VERSION,
        "kind": fields.pop("kind"),
        "law": str(model),
        **fields,
    }
    text = _layout(document) + "\n"
    check_text(text)
    write_text(path, text)


def load(
    path: str | os.PathLike, functions: Mapping[str, Callable] | None = None
) -> AbstractModel:
    """The model that `save` wrote.

    **Arguments:**

    - `path`: the file.
    - `functions`: the functions of your own that occur in the law, by name, as they
        were given to `library.Custom`.

    **Raises:** `InputError` for a file that is missing, is not an ordinary file, has
    more than 4 MB, is not JSON or no model, comes from a newer version, lacks a field,
    or holds an unknown term or a number that is NaN or inf; whoever wrote it, soon.
    Warns where 64-bit numbers are rounded because JAX has them off.
    """
    document = _parsed(path, _read(path))
    try:
        _check_header(document)
        return from_fields(document, functions or {})
    except ValueError as error:
        raise InputError(f"{path}: {_shortened(str(error))}") from None
    except RecursionError:  # of a message that shows what came
        raise InputError(
            f"{path} is nested deeper than any model. Give a file that `hystjax.save` "
            "wrote."
        ) from None


def _read(path: str | os.PathLike) -> bytes:
    """All of a file, which a pipe or a device would not come to the end of."""
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
        what = "a folder" if Path(path).is_dir() else "not an ordinary file"
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


def _parsed(path: str | os.PathLike, content: bytes) -> Any:
    try:
        text = content.decode("utf-8-sig")
        return json.loads(text, parse_int=float, object_pairs_hook=_each_key_once)
    except (ValueError, RecursionError) as error:
        raise InputError(
            f"{path} is not JSON ({_shortened(str(error))}). Give a file that "
            "`hystjax.save` wrote; if it was edited by hand, look at that place."
        ) from None


def _each_key_once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    fields = dict(pairs)
    if len(fields) < len(pairs):
        counts = Counter(name for name, _ in pairs)
        twice = sorted(name for name, count in counts.items() if count > 1)
        raise ValueError(f"the same key twice: {', '.join(twice)}")
    return fields


def _shortened(message: str, most: int = 600) -> str:
    """A message without its middle, where a file is shown, if that is long."""
    if len(message) <= most:
        return message
    return f"{message[: most // 2]} [...] {message[-most // 2 :]}"


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
