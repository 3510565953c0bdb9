"""Lanes as a labelled dataset."""

from collections.abc import Mapping, Sequence
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

import numpy as np

from .._errors import InputError
from .._solution import RESULTS
from ._space import AbstractSpace
from ._variables import RESULT, Variable

if TYPE_CHECKING:
    import xarray

_PACKAGES = ("jax", "equinox", "numpy")


def dataset(
    space: AbstractSpace,
    found: Mapping[str, np.ndarray],
    described: Mapping[str, Variable],
    dims: Mapping[str, Sequence[str]],
    coords: Mapping[str, Any],
) -> "xarray.Dataset":
    """A dataset with the axes of the space.

    **Arguments:** the space; arrays with an axis of lanes first, by name; what is known
    of them; and names and values of their further axes that go before that.

    **Raises:** `InputError` when those do not fit the arrays.
    """
    import xarray  # brings pandas: only those who sweep pay

    _check_known("dims", "array", dims, found)
    shape, labels = space.shape, dict(coords)
    data = {}
    for name, array in found.items():
        own = _own_axes(space, name, array.ndim - 1, described[name], dims)
        if described[name].labels and own == described[name].dims:
            labels.setdefault(own[-1], list(described[name].labels))
        whole = array.reshape(*shape.values(), *array.shape[1:])
        data[name] = ((*shape, *own), whole)
    data[RESULT] = _reasons(*data[RESULT])
    _check_names(space, data)
    own = {axis for axes, *_ in data.values() for axis in axes} - set(shape)
    _check_known("coords", "further axis", coords, own)
    attributes = {"lanes": len(space)} | {name: version(name) for name in _PACKAGES}
    try:
        return xarray.Dataset(data, {**labels, **space.coordinates()}, attributes)
    except ValueError as error:
        raise InputError(
            f"`dims` and `coords` do not fit what `function` returns: {error}"
        ) from None


def _own_axes(
    space: AbstractSpace, name: str, count: int, described: Variable, dims
) -> tuple[str, ...]:
    own = tuple(dims.get(name, described.dims))
    own = own or tuple(f"{name}_{i}" for i in range(count))
    if len(own) != count:
        raise InputError(
            f"`dims` names {len(own)} axes of {name!r} ({', '.join(own)}), and it has "
            f"{count} in each lane."
        )
    taken = [*space.shape, *space.axes]
    twice = [axis for i, axis in enumerate(own) if axis in (*taken, *own[:i])]
    if twice:
        raise InputError(
            f"`dims` gives an axis of {name!r} the name {twice[0]!r}, which is that of "
            "another axis or of a parameter; choose another."
        )
    return own


def _check_known(argument: str, what: str, given, known) -> None:
    unknown = [name for name in given if name not in known]
    if unknown:
        raise InputError(
            f"`{argument}` names {unknown[0]!r}, and no {what} of the results has that "
            f"name; there are: {', '.join(map(repr, sorted(known))) or 'none'}."
        )


def _reasons(axes: tuple[str, ...], codes: np.ndarray):
    """Results by name, and in words those that are no success."""
    items = {int(item._value): name for name, item in RESULTS._name_to_item.items()}
    reasons = {
        items[code]: RESULTS._index_to_message[code] for code in np.unique(codes)
    }
    reasons.pop("successful", None)
    return axes, np.array([items[code] for code in sorted(items)])[codes], reasons


def _check_names(space: AbstractSpace, data: Mapping[str, Any]) -> None:
    both = sorted((set(space.axes) | set(space.shape)) & set(data))
    if both:
        raise InputError(
            f"`function` returns {', '.join(map(repr, both))}, which is a parameter "
            "of the sweep too; give one of them another name."
        )
