"""Models as plain fields (text, numbers, lists), and back, checked on both ways."""

import dataclasses
import warnings
from collections.abc import Callable, Iterable, Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ._checks import is_concrete
from ._errors import InputError
from ._limits import check_candidates, check_depth, check_parameters
from .library import Library, Term
from .models import (
    AbstractModel,
    BoucWen,
    BoucWenOscillator,
    Butterfly,
    Duhem,
    Instrumented,
    SparseModel,
    field_parameters,
)

_WORDS = {dict: "an object", list: "a list", str: "text"}


def to_fields(model: AbstractModel) -> dict[str, Any]:
    """The fields of a model that tell it from others of its kind, which comes first."""
    check_depth(model, lambda outer: getattr(outer, "device", None))
    kind = type(model).__name__
    if kind not in _KINDS:
        raise InputError(
            f"`model` must be one of {', '.join(_KINDS)}, got {kind}. The model of a "
            "solution is its `value`."
        )
    described = {"kind": kind, "names": model.names, "units": model.units}
    return described | _KINDS[kind][0](model)


def from_fields(
    fields: Mapping[str, Any], functions: Mapping[str, Callable]
) -> AbstractModel:
    """The model of some fields; `functions` are the user's own, by name."""
    check_depth(fields, lambda o: o.get("device") if isinstance(o, dict) else None)
    kind = field(fields, "kind", str)
    if kind not in _KINDS:
        raise InputError(
            f"{kind!r} is no kind of model; this hystjax knows {', '.join(_KINDS)}."
        )
    names, units = _pair(fields, "names"), _pair(fields, "units")
    return _KINDS[kind][1](fields, functions, names, units)


def field(fields: Mapping[str, Any], name: str, expected: type) -> Any:
    """One field, which must be there and of the expected type."""
    if name not in fields:
        raise InputError(f'the field "{name}" is missing.')
    if not isinstance(fields[name], expected):
        raise InputError(
            f'the field "{name}" must be {_WORDS[expected]}, got {fields[name]!r}.'
        )
    return fields[name]


def _from_sparse(model: SparseModel) -> dict[str, Any]:
    names = model.library.names
    check_candidates(len(names))
    dtype, numbers = _exactly(names, [model.coefficients], 1)
    entries = zip(names, numbers, np.asarray(model.support), strict=True)
    terms = {name: number for name, number, active in entries if active}
    return {"dtype": dtype, "terms": terms, "candidates": names}


def _to_sparse(fields, functions, names, units) -> SparseModel:
    candidates = _texts(fields, "candidates")
    check_candidates(max(len(candidates), len(field(fields, "terms", dict))))
    library = Library(tuple(Term.parse(name, functions) for name in candidates))
    entries, numbers = _numbers(fields, "terms")
    places = {name: i for i, name in enumerate(library.names)}
    rows = [_row(name, places, functions) for name in entries]
    if len(set(rows)) < len(rows):
        raise InputError(f'"terms" lists a term twice: {", ".join(entries)}.')
    coefficients = np.zeros(len(library), numbers.dtype)
    support = np.zeros(len(library), bool)
    coefficients[rows], support[rows] = numbers, True
    leaves = jnp.asarray(coefficients), jnp.asarray(support)
    return SparseModel(library, *leaves, names=names, units=units)


def _row(name: str, places: Mapping[str, int], functions) -> int:
    if name in places:
        return places[name]
    canonical = Term.parse(name, functions).name  # by hand, `w*u` for `u*w`
    if canonical not in places:
        raise InputError(f'"{name}" is in "terms" but not in "candidates".')
    return places[canonical]


def _from_parameters(model: AbstractModel) -> dict[str, Any]:
    flat = field_parameters(model)
    check_parameters(len(flat))
    dtype, numbers = _exactly(flat, list(flat.values()), 0)
    return {"dtype": dtype, "parameters": dict(zip(flat, numbers, strict=True))}


def _to_parameters(kind: Callable[..., AbstractModel]):
    def model(fields, functions, names, units):
        given = _parameters(fields)
        known = [f.name for f in dataclasses.fields(kind)]  # pyright: ignore
        expected = [name for name in known if name not in ("names", "units")]
        if set(given) != set(expected):
            raise InputError(
                f"the parameters of this model are {', '.join(expected)}; got "
                f"{', '.join(given) or 'none'}."
            )
        return kind(**given, names=names, units=units)

    return model


def _from_wrapper(model) -> dict[str, Any]:
    return _from_parameters(model) | {"device": to_fields(model.device)}


def _to_wrapper(kind: Callable[..., AbstractModel]):
    def model(fields, functions, names, units):
        device = from_fields(field(fields, "device", dict), functions)
        given = _parameters(fields)
        known = [f.name for f in dataclasses.fields(kind)]  # pyright: ignore
        unknown = [name for name in given if name not in known or name == "device"]
        if unknown:
            raise InputError(f"{kind.__name__} has no {', '.join(unknown)}.")
        return kind(device, **given, names=names, units=units)

    return model


def _parameters(fields: Mapping[str, Any]) -> dict[str, Any]:
    """Parameters by name; `alpha[0]`, `alpha[1]`, ... come as one sequence."""
    check_parameters(len(field(fields, "parameters", dict)))
    entries, numbers = _numbers(fields, "parameters")
    given: dict[str, Any] = {}
    for entry, number in zip(entries, numbers, strict=True):
        name, bracket, place = entry.partition("[")
        if not bracket and name not in given:
            given[name] = number
        elif not bracket or not isinstance(given.setdefault(name, []), list):
            raise InputError(f'"{name}" in "parameters" is one number and several.')
        elif place == f"{len(given[name])}]":
            given[name].append(number)
        else:
            raise InputError(f'"{entry}" in "parameters" is out of its order.')
    return given


_KINDS = {
    "SparseModel": (_from_sparse, _to_sparse),
    "Duhem": (_from_parameters, _to_parameters(Duhem)),
    "BoucWen": (_from_parameters, _to_parameters(BoucWen)),
    "BoucWenOscillator": (_from_parameters, _to_parameters(BoucWenOscillator)),
    "Butterfly": (_from_wrapper, _to_wrapper(Butterfly)),
    "Instrumented": (_from_wrapper, _to_wrapper(Instrumented)),
}


def _exactly(names, values, ndim: int) -> tuple[str, list[float]]:
    """The type and the values of a model's numbers; Python's hold them to the bit."""
    if not is_concrete(*values):
        raise InputError("`model` is being traced; save it outside `jit` and `vmap`.")
    arrays = [np.asarray(value) for value in values]
    batch = [array.shape for array in arrays if array.ndim != ndim]
    if batch:
        raise InputError(
            f"this is a batch of models, with numbers of shape {batch[0]}; save them "
            "one by one, each picked with `jax.tree.map(lambda x: x[i], models)`."
        )
    numbers = np.hstack(arrays) if arrays else np.zeros(0)
    _check_finite(names, numbers)
    return np.result_type(np.float32, numbers).name, numbers.tolist()


def _numbers(fields: Mapping[str, Any], name: str) -> tuple[list[str], np.ndarray]:
    """Names and numbers of one field, in the type in which they were saved."""
    entries, dtype = field(fields, name, dict), field(fields, "dtype", str)
    if dtype not in ("float32", "float64"):
        raise InputError(f'"dtype" must be float32 or float64, got {dtype!r}.')
    for key, value in entries.items():
        if not isinstance(value, float):
            raise InputError(f'"{key}" in "{name}" must be a number, got {value!r}.')
    with np.errstate(over="ignore"):  # what does not fit is reported by the check
        numbers = np.array(list(entries.values()), dtype)
        rounded = numbers.astype(jax.dtypes.canonicalize_dtype(dtype))
    if rounded.dtype != numbers.dtype:
        warnings.warn(
            "this model was saved with 64-bit numbers, and they are rounded to 32 bits "
            "because JAX has 64-bit numbers off; switch them on first, with "
            "`jax.config.update('jax_enable_x64', True)`.",
            stacklevel=5,
        )
    _check_finite(entries, rounded)
    return list(entries), rounded


def _check_finite(names: Iterable[str], numbers: np.ndarray) -> None:
    values = zip(names, numbers, strict=True)
    bad = [f"{name} = {value}" for name, value in values if not np.isfinite(value)]
    if bad:
        raise InputError(f"a model's numbers must be finite, got {', '.join(bad)}.")


def _texts(fields: Mapping[str, Any], name: str) -> tuple[str, ...]:
    values = field(fields, name, list)
    if not all(isinstance(value, str) for value in values):
        raise InputError(f'the field "{name}" must hold text only, got {values!r}.')
    try:
        "".join(values).encode()
    except UnicodeEncodeError as error:
        half = error.object[error.start]
        raise InputError(
            f'the field "{name}" holds {half!r}, half a character, which nothing can '
            "show; write both halves, or the character itself."
        ) from None
    return tuple(values)


def _pair(fields: Mapping[str, Any], name: str) -> tuple[str, str]:
    values = _texts(fields, name)
    if len(values) != 2:
        raise InputError(
            f'the field "{name}" must hold two texts, of the input and of the output; '
            f"got {list(values)!r}."
        )
    return values[0], values[1]
