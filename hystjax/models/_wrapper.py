"""Models around other models."""

from abc import abstractmethod
from typing import TypeVar

import equinox as eqx
import jax

from .._core.checks import is_concrete
from .._core.errors import InputError
from ._base import AbstractModel
from ._named import field_parameters, replace_fields

Wrapper = TypeVar("Wrapper", bound="AbstractWrapper")


class AbstractWrapper(AbstractModel):
    """A device of which something else is seen; its parameters are those of the device
    and its own.

    **Attributes:** `device`, the model inside.
    """

    device: eqx.AbstractVar[AbstractModel]

    def __check_init__(self):
        if not isinstance(self.device, AbstractModel):
            raise InputError(f"`device` must be a model, got {self.device!r}.")

    @property
    def memory(self):
        return self.device.memory

    @property
    def rate_independent(self):
        return self.device.rate_independent

    def kinks(self, x):
        return self.device.kinks(x)

    def rows_in_use(self):
        return self.device.rows_in_use()

    def restricted(self, rows):
        if not rows:
            return self
        device = self.device.restricted(rows)
        return eqx.tree_at(lambda model: model.device, self, device)

    def settled(self):
        return eqx.tree_at(lambda model: model.device, self, self.device.settled())

    def parameters(self):
        return self.device.parameters() | field_parameters(self)

    def with_parameters(self: Wrapper, values) -> Wrapper:
        own = field_parameters(self)
        changed = replace_fields(self, {k: x for k, x in values.items() if k in own})
        inner = {name: x for name, x in values.items() if name not in own}
        device = self.device.with_parameters(inner)
        return eqx.tree_at(lambda model: model.device, changed, device)

    def bounds(self):
        return self.device.bounds()

    def __str__(self) -> str:
        leaves = jax.tree.leaves(eqx.filter(self, eqx.is_array))
        return self.text() if is_concrete(*leaves) else repr(self)

    @abstractmethod
    def text(self) -> str:
        """The model for people. For concrete models only."""
