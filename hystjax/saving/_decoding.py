"""Models of plain values, which anyone may have written, and what a file can hold."""

import dataclasses
import math
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.tree_util as jtu
import numpy as np

from .._core.checks import InputError, described
from ._encoding import (
    ARRAY,
    DTYPES,
    Place,
    check_nesting,
    check_parameters,
    check_settings,
    class_of,
    exact,
    like_of,
    name_of,
    place_of,
    plain_fields,
    remember,
    static_fields,
)


class _Python(NamedTuple):
    """A number that is no array."""

    value: int | float


class _Leaves(NamedTuple):
    """Arrays of an opaque part, by their place in it."""

    arrays: dict[str, Any]


@dataclass(frozen=True)
class Context:
    """What is known where a model is made of fields.

    **Attributes:**

    - `functions`: the user's own, by name.
    - `dtype`: of plain numbers in the file.
    """

    functions: Mapping[str, Callable]
    dtype: str

    def module(self, raw: Any, place: Place = Place()) -> Any:
        """The module of a JSON object.

        **Raises:** `InputError` for what is none.
        """
        where = f"the field {place.path!r}" if place.path else "the model"
        if not isinstance(raw, dict):
            raise InputError(f"{where} must be an object, got {raw!r}.")
        if not isinstance(raw.get("kind"), str):
            raise InputError(f'{where} needs a "kind", which is text; got {raw!r}.')
        cls, inside = class_of(raw["kind"]), place.inside()
        others = {name: value for name, value in raw.items() if name != "kind"}
        fields = {
            name: self._value(value, inside.at(name), 0)
            for name, value in others.items()
        }
        own = getattr(cls, "from_fields", None)
        try:
            return made(cls, fields, self) if own is None else own(fields, self)
        except InputError:
            raise
        except Exception as error:  # whatever a constructor makes of such values
            raise InputError(f"these fields make no {raw['kind']}: {error}") from None

    def numbers(self, name: str, values: Mapping[str, Any]) -> np.ndarray:
        """Numbers by name as one array, of the type in which they were saved.

        **Raises:** `InputError` for what is no number, or not finite.
        """
        for key, value in values.items():
            if type(value) not in (int, float) and not _is_number(value):
                raise InputError(
                    f'"{key}" in "{name}" must be a number, got {value!r}.'
                )
        given = [_float(value) for value in values.values()]
        types = {np.dtype(getattr(x, "dtype", self.dtype)) for x in values.values()}
        dtype = np.result_type(*types) if types else np.dtype(self.dtype)
        rounded = _rounded(np.array(given, np.float64), dtype)
        bad = [
            f"{key} = {x}"
            for key, x in zip(values, rounded, strict=True)
            if not np.isfinite(x)
        ]
        if bad:
            raise InputError(f"a model's numbers must be finite, got {', '.join(bad)}.")
        return rounded

    def _value(self, raw: Any, place: Place, nesting: int) -> Any:
        check_nesting(nesting)
        if isinstance(raw, str):
            return _text(raw, place)
        if isinstance(raw, list):
            return self._each(raw, place, nesting)
        if not isinstance(raw, dict):
            return raw
        if "kind" in raw:
            return self.module(raw, place)
        if set(raw) == ARRAY:
            return _array(raw, place)
        (sole, inner), *_ = [*raw.items(), (None, None)]
        if len(raw) == 1 and sole == "python":
            return _Python(_number(inner, place))
        if len(raw) == 1 and sole == "list" and isinstance(inner, list):
            return list(self._each(inner, place, nesting))
        if len(raw) == 1 and sole in ("dict", "leaves") and isinstance(inner, dict):
            each = self._entries(inner, place, nesting)
            return each if sole == "dict" else _Leaves(each)
        return self._entries(raw, place, nesting)

    def _each(self, raw: list, place: Place, nesting: int) -> tuple:
        values = enumerate(raw)
        return tuple(self._value(x, place.at(str(i)), nesting + 1) for i, x in values)

    def _entries(self, raw: dict, place: Place, nesting: int) -> dict[str, Any]:
        return {
            _text(key, place): self._value(value, place.at(key), nesting + 1)
            for key, value in raw.items()
        }

    def leaf(self, value: Any, name: str, static: bool) -> Any:
        """A decoded value as a field has it: arrays for numbers, but in static ones."""
        match value:
            case _Python():
                return value.value
            case _Leaves():
                raise InputError(
                    f'"{name}" holds the arrays of a part that cannot be made anew '
                    "here: register the class with `like`."
                )
            case bool():
                return value
            case int() | float() if not static:
                return jnp.asarray(self.numbers("fields", {name: value})[0])
            case float() if not math.isfinite(value):
                raise InputError(
                    f"a model's numbers must be finite, got {name} = {value}."
                )
            case np.ndarray():
                return _on_device(value, name)
            case tuple() | list():
                return type(value)(self.leaf(x, name, static) for x in value)
            case dict():
                return {
                    k: self.leaf(x, f"{name}.{k}", static) for k, x in value.items()
                }
        return value


def made(cls: Any, fields: Mapping[str, Any], context: Context) -> Any:
    """A module of its decoded fields, by its constructor; converters and checks run."""
    statics, name, like = static_fields(cls), name_of(cls), like_of(cls)
    given = {key: value for key, value in fields.items() if key != "like" or not like}
    own = dataclasses.fields(cls)
    # What `like` makes has what it makes, but for what is `None` unless it is given.
    left_out = (lambda f: f.default is None) if like else _has_default
    optional = [f.name for f in own if left_out(f)]
    check_known(cls, given, statics)
    missing = [key for key in statics if key not in given and key not in optional]
    if missing:
        raise InputError(
            f"{name} needs {', '.join(missing)}; got {', '.join(given) or 'nothing'}."
        )
    check_parameters(sum(map(_count, given.values())))
    if like is not None:
        return _filled(cls, like, fields.get("like", {}), given, context)
    # Defaults are left to the constructor, which may be one's own and not take them.
    usual = {f.name: f.default for f in own if statics.get(f.name)}
    told = {
        key: value
        for key, value in given.items()
        # No default is an array, of which `!=` would be one too.
        if key not in usual or hasattr(value, "shape") or value != usual[key]
    }
    return cls(**{k: context.leaf(x, k, statics[k]) for k, x in told.items()})


def check_known(cls: type, given: Iterable[str], known: Collection[str]) -> None:
    """Raise `InputError` for fields that those of a class are not among."""
    unknown = [key for key in given if key not in known]
    if unknown:
        raise InputError(
            f"{name_of(cls)} has no {', '.join(unknown)}; its fields are "
            f"{', '.join(known)}."
        )


def _has_default(field: dataclasses.Field) -> bool:
    missing = dataclasses.MISSING
    return field.default is not missing or field.default_factory is not missing


def _count(value: Any) -> int:
    """Numbers that stand alone in a field."""
    match value:
        case bool():
            return 0
        case int() | float():
            return 1
        case tuple() | list():
            return sum(map(_count, value))
        case dict():
            return sum(map(_count, value.values()))
    return 0


def _filled(cls, like: Callable, settings: Any, given, context: Context) -> Any:
    """A module whose opaque parts are those that `like` makes, with other numbers."""
    statics = static_fields(cls)
    parts = [value for value in given.values() if isinstance(value, _Leaves)]
    sizes = [np.size(leaf) for part in parts for leaf in part.arrays.values()]
    if not isinstance(settings, dict):
        raise InputError(f'"like" must be an object, got {settings!r}.')
    check_settings(settings, sum(sizes))
    known = {name: context.leaf(x, name, True) for name, x in settings.items()}
    try:
        blank = eqx.filter_eval_shape(like, **known)
    except jax.errors.ConcretizationTypeError:
        raise InputError(
            f"`like` of {name_of(cls)} is run by `jax.eval_shape`, where arrays have "
            "shapes but no values: let it, and `__check_init__`, look at none, or pass "
            "where they are instances of `jax.core.Tracer`."
        ) from None
    except Exception as error:
        raise InputError(
            f"`like` makes no {name_of(cls)} of the settings {known}: {error}"
        ) from None
    if type(blank) is not cls:
        raise InputError(f"`like` must make a {name_of(cls)}, got {blank!r}.")
    values = {
        name: _like(getattr(blank, name), value.arrays, name, context)
        if isinstance(value, _Leaves)
        else context.leaf(value, name, statics[name])
        for name, value in given.items()
    }
    return _placed(cls, blank, values)


def _like(part: Any, arrays: Mapping[str, Any], name: str, context: Context) -> Any:
    """A part with its arrays, of which only shapes were known."""
    paths = jtu.tree_leaves_with_path(part)
    blanks = {place_of(p): x for p, x in paths if isinstance(x, jax.ShapeDtypeStruct)}
    if set(blanks) != set(arrays):
        raise InputError(
            f'"{name}" has arrays {", ".join(arrays)}, and `like` makes '
            f"{', '.join(blanks)}."
        )

    def filled(path, leaf):
        place = place_of(path)
        if place not in blanks:
            return leaf
        array = context.leaf(arrays[place], place, False)
        if not hasattr(array, "dtype"):
            raise InputError(
                f'"{name}" needs an array at {place}, got {described(array)}.'
            )
        same_kind = array.dtype.kind == np.dtype(leaf.dtype).kind
        if array.shape != leaf.shape or not same_kind:
            raise InputError(
                f'"{name}" has an array {place} of {array.dtype} and shape '
                f"{array.shape}, and `like` makes {leaf.dtype}, {leaf.shape}."
            )
        return array

    return jtu.tree_map_with_path(filled, part)


def _placed(cls: Any, blank: Any, values: Mapping[str, Any]) -> Any:
    """A module with these values in its fields, as after its own constructor."""
    module = object.__new__(cls)
    for field in dataclasses.fields(cls):
        value = values.get(field.name, getattr(blank, field.name))
        converter = field.metadata.get("converter")
        value = value if converter is None else converter(value)
        object.__setattr__(module, field.name, value)
    for each in cls.__mro__:
        if "__check_init__" in vars(each):
            vars(each)["__check_init__"](module)
    return module


def _array(raw: Mapping[str, Any], place: Place) -> np.ndarray:
    dtype, shape, numbers = raw["dtype"], raw["shape"], raw["numbers"]
    if dtype not in DTYPES:
        raise InputError(f"{place.path} has numbers of no known type: {dtype!r}.")
    if not isinstance(numbers, list) or not isinstance(shape, list):
        raise InputError(f'"shape" and "numbers" of {place.path} must be lists.')
    most = max(len(numbers), 1000)  # of an empty array other lengths may be any
    sound = all(type(n) is int and 0 <= n <= most for n in shape)
    if not sound or len(shape) > 32 or math.prod(shape) != len(numbers):
        raise InputError(
            f"{place.path} has {len(numbers)} numbers, which make no array of shape "
            f"{shape!r}."
        )
    kinds = (bool,) if dtype == "bool" else (int, float)
    odd = [x for x in numbers if type(x) not in kinds]
    if odd:
        raise InputError(f"{place.path} must hold {dtype} only, got {odd[0]!r}.")
    if dtype.startswith(("int", "uint")) and any(type(x) is float for x in numbers):
        raise InputError(f"{place.path} must hold whole numbers only.")
    try:
        array = np.array(numbers, object if "int" in dtype else None).astype(dtype)
    except OverflowError:
        raise InputError(f"{place.path} has numbers too large for {dtype}.") from None
    if not np.all(np.isfinite(array)):
        bad = array[~np.isfinite(array)][0]
        raise InputError(f"a model's numbers must be finite, got {place.path} = {bad}.")
    return array.reshape(shape)


def _on_device(array: np.ndarray, name: str) -> jax.Array:
    rounded = _rounded(array, array.dtype)
    same = (
        np.all(np.isfinite(rounded))
        if array.dtype.kind == "f"
        else np.array_equal(rounded, array)
    )
    if not same:
        raise InputError(f'"{name}" has numbers too large for {rounded.dtype}.')
    return jnp.asarray(rounded)


def _rounded(array: np.ndarray, dtype: Any) -> np.ndarray:
    """Numbers in the type that JAX has for a type; `load` says if that is shorter."""
    with np.errstate(over="ignore"):  # what does not fit is reported by the caller
        return array.astype(dtype).astype(jax.dtypes.canonicalize_dtype(dtype))


def _is_number(value: Any) -> bool:
    return isinstance(value, np.ndarray) and value.ndim == 0 and value.dtype.kind == "f"


def _float(value: Any) -> float:
    try:
        return float(value)
    except OverflowError:
        return math.inf


def _number(value: Any, place: Place) -> int | float:
    if type(value) not in (int, float) or not math.isfinite(_float(value)):
        raise InputError(
            f"a model's numbers must be finite, got {place.path} = {value!r}."
        )
    return value


def _text(text: str, place: Place) -> str:
    try:
        text.encode()
    except UnicodeEncodeError as error:
        half = error.object[error.start]
        raise InputError(
            f"the field {place.path!r} holds {half!r}, half a character, which nothing "
            "can show; write both halves, or the character itself."
        ) from None
    return text


Self = TypeVar("Self", bound="Storable")


class Storable(eqx.Module):
    """What `save` and `load` know as soon as it is defined: by its fields, unless it
    says otherwise. `register` gives it a name of its own."""

    def __init_subclass__(cls, **more: Any):
        super().__init_subclass__(**more)
        remember(cls)

    def to_fields(self) -> dict[str, Any]:
        """What a file holds of it, by name: arrays, numbers, text, `None`, what a file
        can hold, and tuples, lists and dictionaries of these; its fields by default."""
        return plain_fields(self)

    @classmethod
    def from_fields(cls: type[Self], fields: dict[str, Any], context: Context) -> Self:
        """The inverse of `to_fields`. The file may come from anyone: raise an error for
        what makes no sense.

        **Arguments:** what the file holds, whose numbers are Python's; and what is
        known of the file.
        """
        return made(cls, fields, context)


def difference(one: Any, other: Any, place: str = "") -> str | None:
    """Where two models differ, be it in a bit; `None` if nowhere."""
    here = place or "the model itself"
    if isinstance(one, np.generic | np.ndarray | jax.Array):
        return None if _same_array(one, other) else here
    if type(one) is not type(other):
        return here
    if isinstance(one, eqx.Module):
        # A class that has its own way of writing vouches for what it leaves out.
        own = getattr(type(one), "to_fields", None) not in (None, Storable.to_fields)
        if own:
            return None if exact(one) == exact(other) else here
        names = [f.name for f in dataclasses.fields(one)]  # pyright: ignore[reportArgumentType]
        pairs = [(n, getattr(one, n, None), getattr(other, n, None)) for n in names]
    elif isinstance(one, tuple | list):
        if len(one) != len(other):
            return here
        pairs = [
            (str(i), a, b) for i, (a, b) in enumerate(zip(one, other, strict=True))
        ]
    elif isinstance(one, dict):
        if list(one) != list(other):
            return here
        pairs = [(str(key), one[key], other[key]) for key in one]
    else:
        return None if one is other or one == other else here
    found = (difference(a, b, f"{place}.{name}".lstrip(".")) for name, a, b in pairs)
    return next((each for each in found if each is not None), None)


def _same_array(one: Any, other: Any) -> bool:
    if not isinstance(other, np.generic | np.ndarray | jax.Array):
        return False
    a, b = np.asarray(one), np.asarray(other)
    return (a.dtype, a.shape, a.tobytes()) == (b.dtype, b.shape, b.tobytes())
