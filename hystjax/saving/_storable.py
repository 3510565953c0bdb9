"""What a file can hold."""

from typing import Any, TypeVar

import equinox as eqx

from ._decoding import Context, made
from ._encoding import plain_fields
from ._registry import remember

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
