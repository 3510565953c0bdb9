"""The numbers of models: how they are taken, their bounds, their names, and a knee."""

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from .._core import checks
from .._core.checks import InputError, described, is_concrete, nearest
from ..library import Term


def number(value: ArrayLike) -> Array:
    """A parameter as an array of one float."""
    return _single("a parameter", numbers(value))


def _single(name: str, array: Array) -> Array:
    if array.ndim:
        raise InputError(
            f"{name} must be a number, got an array of shape {array.shape}; make "
            "batches of models with `jax.vmap`."
        )
    return array


def optional(value: ArrayLike | None) -> Array | None:
    """A parameter as an array of one float, if there is one."""
    return None if value is None else number(value)


Numbers = ArrayLike | Sequence[Any]
"""What becomes an array of floats: an array, or lists of numbers."""


def numbers(value: Numbers) -> Array:
    """Parameters as an array of floats. Infinite ones may have a sense, as the limit of
    a spring that never slips.

    **Raises:** `InputError` for what are no real numbers, or NaN.
    """
    array = floats(value)
    if is_concrete(array) and np.any(np.isnan(known := np.asarray(array))):
        bad = np.argwhere(np.isnan(known))[0].tolist()
        place = f" at {bad}" if bad else ""
        raise InputError(f"parameters must be numbers, and not NaN; got nan{place}.")
    return array


def floats(
    value: Numbers, wanted: str = "parameters must be real numbers, or arrays of them"
) -> Array:
    """Parameters as an array of floats; NaN too, which a fit that went astray leaves.

    **Raises:** `InputError` for what are no real numbers, which says what is `wanted`.
    """
    try:
        # JAX takes a text for the name of a type, and may warn of that type.
        texts = any(isinstance(x, str | bytes) for x in jax.tree.leaves(value))
        array = None if texts else jnp.asarray(value)
    except (TypeError, ValueError):
        array = None
    if array is None or jnp.iscomplexobj(array):
        raise InputError(f"{wanted}; got {described(value)}.")
    return array.astype(jnp.result_type(float, array))


def check_elements(**parameters: Array) -> None:
    """Raise `InputError` unless these have a number each for every element that a model
    is made of, and there is one."""
    shapes = [each.shape for each in parameters.values()]
    if len({*shapes}) > 1 or len(shapes[0]) != 1 or shapes[0] == (0,):
        named = " and ".join(f"`{name}`" for name in parameters)
        raise InputError(
            f"{named} must be arrays of one length, a number for each element; got "
            f"shapes {' and '.join(map(str, shapes))}."
        )


def check_rising(name: str, thresholds: Array) -> None:
    """Raise `InputError` unless these are two numbers and more, each above the last."""
    if thresholds.shape[-1:] in ((), (0,), (1,)) or (
        is_concrete(thresholds) and not np.all(np.diff(np.asarray(thresholds)) > 0)
    ):
        raise InputError(
            f"`{name}` must be two numbers or more, each above the last; got "
            f"{thresholds}."
        )


@dataclass(frozen=True)
class Bounded:
    """The converter of a field whose number must lie between two bounds, or on one that
    it `admits`: it refuses others, and `refine` keeps the number there. A fit may end
    on a bound: where a model has a sense there, it is to be one."""

    name: str
    lower: float = 0.0
    upper: float = np.inf
    admits: tuple[float, ...] = ()

    def __call__(self, value: ArrayLike) -> Array:
        name = f"`{self.name}`"
        array = _single(name, floats(value, f"{name} must be a real number"))
        if checks.is_concrete(array) and not self._holds(float(array)):
            raise InputError(f"{name} must be {self._in_words()}, got {value}.")
        return array

    def _holds(self, value: float) -> bool:
        return self.lower < value < self.upper or value in self.admits

    def _in_words(self) -> str:
        least = "positive" if self.lower == 0 else f"above {self.lower:g}"
        if self.lower in self.admits:
            least = f"at least {self.lower:g}"
        if np.isinf(self.upper):
            return f"{least} and finite"
        most = "at most" if self.upper in self.admits else "below"
        return f"{least} and {most} {self.upper:g}"


def field_bounds(module: eqx.Module, place: str = "") -> dict[str, tuple[float, float]]:
    """The bounds of such fields, by the names of parameters, those of parts too."""
    found = {}
    for field in fields(module):
        value, converter = getattr(module, field.name), field.metadata.get("converter")
        if isinstance(converter, Bounded):
            found[place + field.name] = converter.lower, converter.upper
        elif isinstance(value, eqx.Module):
            found |= field_bounds(value, f"{place}{field.name}.")
    return found


def from_zero(name: str, array: Float[Array, "*s k"]) -> dict[str, tuple[float, float]]:
    """Bounds of widths in an array. Below 0 they mean nothing, or what they do above:
    there one that a fit is to make smaller would get larger, and hold up all others."""
    return {f"{name}[{i}]": (0.0, np.inf) for i in range(array.shape[-1])}


def coefficients(
    value: ArrayLike | Sequence[ArrayLike],
) -> Array | tuple[Array, ...]:
    """One number, or those of a polynomial, lowest power first: a tuple, so that an
    axis of an array is always one of a batch."""
    if isinstance(value, Sequence):
        several = tuple(number(entry) for entry in value)
        if not several:
            raise InputError("a polynomial needs at least one coefficient, got none.")
        return several
    return _single("a coefficient, or each of a tuple of them,", numbers(value))


def polynomial(
    coefficients: tuple[Float[Array, ""], ...], u: Float[Array, "*s"]
) -> Float[Array, "*s"]:
    """coefficients[0] + coefficients[1] u + ..., by Horner's rule."""
    total = jnp.zeros_like(u)
    for coefficient in reversed(coefficients):
        total = total * u + coefficient
    return total


def knee(
    z: Float[Array, "*s"],
    dx: Float[Array, "*s"],
    beta: Float[Array, ""],
    gamma: Float[Array, ""],
    n: Float[Array, ""],
) -> Float[Array, "*s"]:
    """What bends the loop of a Bouc-Wen law: beta |dx| z |z|^(n-1) + gamma dx |z|^n."""
    # Not by the sign of z, which has no slope at 0, where z has one.
    return (beta * jnp.abs(dx) * z + gamma * dx * jnp.abs(z)) * magnitude(z, n - 1)


_LEAST_POWER = 0.1  # of z, by which the size is told that it has at a knee


def knee_powers(
    beta: Float[Array, ""],
    gamma: Float[Array, ""],
    n: Float[Array, ""],
    slope: Float[ArrayLike, ""] = 1.0,
) -> dict[str, tuple[str, Array]]:
    """What `powers` tells of beta and gamma, by one over the size that z has at such a
    knee, where it starts by a `slope` over x; 1 where there is none."""
    share = (jnp.abs(beta) + jnp.abs(gamma)) / jnp.abs(slope)
    bends = (share > 0) & jnp.isfinite(share)
    # Towards n = 0, a bound that fits end on, that size is soon no number any more.
    size = jnp.where(bends, share, 1.0) ** (1 / jnp.maximum(n, _LEAST_POWER))
    return {"beta": ("n", size), "gamma": ("n", size)}


def magnitude(z: Float[Array, "*s"], n: Float[Array, ""]) -> Float[Array, "*s"]:
    """|z|^n, 1 for n = 0, with a derivative at 0: the logarithm must not see the
    zero; of negative powers 0 counts as 0."""
    moved = z != 0
    size = jnp.where(moved, jnp.abs(z), 1.0)
    at_zero = jnp.where(n == 0, 1.0, 0.0)
    return jnp.where(moved, jnp.exp(n * jnp.log(size)), at_zero)


def stack_of(
    weights: Iterable[float], radii: Iterable[float]
) -> tuple[tuple[float, Term], ...]:
    """Plays as addends; of radius 0 the input, and without those that never move, whose
    radius has no end."""
    pairs = zip(weights, radii, strict=True)
    moving = ((weight, radius) for weight, radius in pairs if math.isfinite(radius))
    return tuple(
        (weight, Term.parse(f"play(u,{radius!r})" if radius else "u"))
        for weight, radius in moving
    )


def together(addends: Iterable[tuple[float, Term]]) -> tuple[tuple[float, Term], ...]:
    """Addends in their order, those of one term as one."""
    sum_of: dict[Term, float] = {}
    for value, term in addends:
        sum_of[term] = sum_of.get(term, 0.0) + value
    return tuple((value, term) for term, value in sum_of.items())


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


def count_of_leaves(tree: Any) -> int:
    """How many `leaf_parameters` there are."""
    return sum(leaf.size for _, leaf in _inexact(tree))


def replace_leaves(tree: Any, values: Mapping[str, ArrayLike]) -> Any:
    """The PyTree with other numbers at some of these places.

    **Raises:** `InputError` for a place where there is none.
    """
    known = changed_alike(leaf_parameters(tree), values)

    def changed(path, leaf):
        if not _is_number(path, leaf):
            return leaf
        entries = [known[name] for name, _ in _entries(path, leaf)]
        return jnp.stack(entries).reshape(leaf.shape) if entries else leaf

    return jax.tree_util.tree_map_with_path(changed, tree)


def changed_numbers(
    known: Mapping[str, Array], values: Mapping[str, ArrayLike]
) -> dict[str, Array]:
    """Numbers by name, some of them changed.

    **Raises:** `InputError` for a name that is not known, or values without names.
    """
    check_named(known, values)
    return dict(known) | {name: floats(value) for name, value in values.items()}


def changed_alike(
    known: Mapping[str, Array], values: Mapping[str, ArrayLike]
) -> dict[str, Array]:
    """The same, of numbers that make an array together.

    **Raises:** `InputError` for several in the place of one, too.
    """
    new = changed_numbers(known, values)
    for name in values:
        if jnp.shape(new[name]) != jnp.shape(known[name]):
            raise InputError(
                f"{name!r} must be one number, got {described(new[name])}; make a "
                "batch of models by `jax.vmap`."
            )
    return new


def check_named(known: Collection[str], values: Any) -> None:
    """Raise `InputError` for values without names, and for a name that is not known."""
    if not isinstance(values, Mapping):
        raise InputError(
            "`values` must be parameters by their names, such as "
            f"`{{{next(iter(known), 'name')!r}: 1.0}}`; got {described(values)}."
        )
    unknown = [name for name in values if name not in known]
    if unknown:
        raise InputError(
            f"there is no parameter {unknown[0]!r}. {nearest(unknown[0], known)}The "
            f"parameters are {', '.join(known) or 'none'}."
        )


def _inexact(tree):
    every = jax.tree_util.tree_leaves_with_path(tree)
    return [(path, leaf) for path, leaf in every if _is_number(path, leaf)]


def _is_number(path, leaf) -> bool:
    """Whether a leaf is of a model itself, and not of what it was fitted on."""
    names = {getattr(key, "name", None) for key in path}
    return eqx.is_inexact_array(leaf) and "fitted_range" not in names


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


def replace_fields(model: Model, values: Mapping[str, ArrayLike]) -> Model:
    """The model with other values for some of those numbers.

    **Raises:** `InputError` for a name that is of none.
    """
    old = _numeric_fields(model)
    flat = changed_numbers(field_parameters(model), values)

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
