"""Models with another one inside, whose numbers are in part those of that one."""

from collections.abc import Collection, Container, Mapping
from typing import Any, TypeVar

import equinox as eqx
from jaxtyping import Array, ArrayLike

from ._base import AbstractModel
from ._numbers import check_names, field_parameters, replace_fields

Whole = TypeVar("Whole", bound="AbstractWhole")


class AbstractWhole(AbstractModel):
    """A model with another one inside, in the field that is named `_part`.

    Its parameters are those of the part, by their names there, and its own: its fields'
    by default. Of two of one name that of the part is told by its place, such as
    `device.offset`.
    """

    _part: eqx.AbstractClassVar[str]

    def _own(self) -> dict[str, Array]:
        """The parameters that are not the part's, by name."""
        return field_parameters(self)

    def _with_own(self: Whole, values: Mapping[str, ArrayLike]) -> Whole:
        """The model with other values for some of these."""
        return replace_fields(self, values)

    def _joined(self, inner: dict[str, Any], own: dict[str, Any]) -> dict[str, Any]:
        """What is told of the part's parameters and of its own, in their order."""
        return inner | own

    @property
    def _inside(self) -> AbstractModel:
        return getattr(self, self._part)

    def _around(self: Whole, inside: AbstractModel) -> Whole:
        return eqx.tree_at(lambda model: model._inside, self, inside)

    def _names(self, own: Container[str]) -> dict[str, str]:
        """The part's parameters, as they are called there and here."""
        return _outside(self._inside.parameters(), own, self._part)

    def parameters(self):
        inner, own = self._inside.parameters(), self._own()
        names = self._names(own)
        return self._joined({names[name]: x for name, x in inner.items()}, own)

    def with_parameters(self: Whole, values) -> Whole:
        own = self._own()
        names = self._names(own)
        check_names(self._joined(dict.fromkeys(names.values()), own), values)
        inner = {name: values[each] for name, each in names.items() if each in values}
        changed = self._with_own({k: x for k, x in values.items() if k in own})
        return changed._around(self._inside.with_parameters(inner))

    def bounds(self):
        names = self._names(self._own())
        bounds = self._inside.bounds()
        return {names[name]: ends for name, ends in bounds.items() if name in names}

    def powers(self):
        powers = self._inside.powers()
        names = self._names(self._own()) if powers else {}
        return {
            names[name]: (names.get(other, other), size)
            for name, (other, size) in powers.items()
            if name in names
        }

    @property
    def rows_in_use(self):
        return self._inside.rows_in_use

    def restricted(self, rows):
        return self._around(self._inside.restricted(rows)) if rows else self

    def settled(self):
        return self._around(self._inside.settled())


def _outside(inside: Collection[str], own: Container[str], part: str) -> dict[str, str]:
    """How the numbers of a part are called in a whole that has numbers of its own: as
    there, but for those that would be there twice, such as `spring.stiffness`."""
    place = f"{part}."
    twice = {name for name in inside if name.rpartition(place)[2] in own}
    return {name: place + name if name in twice else name for name in inside}
