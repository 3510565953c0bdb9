"""The interface that learned laws and classical models share."""

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import fields
from typing import Any, TypeVar

import equinox as eqx
import jax
from jaxtyping import Array, Float

from .._checks import is_concrete
from ..library import Kind, Term, kind

Model = TypeVar("Model", bound="AbstractModel")


class AbstractModel(eqx.Module):
    """A device with memory: a state driven by the input, and an output made of it.

    **Attributes:**

    - `names`: what the input and the output are; keyword only.
    - `units`: units of the input and of the output; time is in s; keyword only.
    """

    names: tuple[str, str] = eqx.field(
        static=True, kw_only=True, default=("input", "output")
    )
    units: tuple[str, str] = eqx.field(static=True, kw_only=True, default=("", ""))

    @property
    @abstractmethod
    def hidden(self) -> bool:
        """Whether the output does not tell the state."""

    @abstractmethod
    def rate(self, state: Any, u: Float[Array, " *s"], du: Float[Array, " *s"]) -> Any:
        """Time derivative of the state, per s; a PyTree of the state's structure.

        **Arguments:** the state, and the input with its derivative, all leaves of one
        shape.
        """

    @abstractmethod
    def start(self, w0: Float[Array, ""], u0: Float[Array, ""]) -> Any:
        """The state at a first sample with output `w0` and input `u0`."""

    @abstractmethod
    def observe(self, t: Float[Array, " n"], states: Any) -> Float[Array, " n"]:
        """The output at the times `t`, of states with leading axis n."""

    @abstractmethod
    def parameters(self) -> dict[str, Float[Array, ""]]:
        """The numbers that define the model, by name."""

    @abstractmethod
    def with_parameters(self: Model, values: Mapping[str, Float[Array, ""]]) -> Model:
        """The model with other values for some of its parameters."""

    @abstractmethod
    def __str__(self) -> str:
        """The model for people, such as its equation."""


class AbstractLaw(AbstractModel):
    """A law w' = f(w, u, u'): the output is the state."""

    @property
    def hidden(self) -> bool:
        """No."""
        return False

    @abstractmethod
    def addends(self) -> tuple[tuple[float, Term], ...]:
        """The law as a sum: coefficients and terms. For concrete models only."""

    def terms(self) -> dict[str, float]:
        """Non-zero coefficients by the name of their term."""
        return {term.name: value for value, term in self.addends() if value != 0}

    @property
    def kind(self) -> Kind:
        """Whether there is hysteresis in the law, by its terms. For concrete models
        only."""
        return kind(term for value, term in self.addends() if value != 0)

    def start(self, w0, u0):
        return w0

    def observe(self, t, states):
        return states

    def __str__(self) -> str:
        leaves = [leaf for leaf in jax.tree.leaves(self) if eqx.is_array(leaf)]
        return equation(self) if is_concrete(*leaves) else repr(self)


def field_parameters(model: AbstractModel) -> dict[str, Array]:
    """The numbers in a model's fields, by name: `n`, or `alpha[0]`, ... for those of a
    tuple."""
    flat: dict[str, Array] = {}
    for name, value in _numeric_fields(model).items():
        entries = value if isinstance(value, tuple) else (value,)
        flat |= dict(zip(_entry_names(name, value), entries, strict=True))
    return flat


def replace_fields(model: Model, values: Mapping[str, Array]) -> Model:
    """The model with other values for some of those numbers."""
    old = _numeric_fields(model)
    flat = field_parameters(model) | dict(values)

    def new(name):
        entries = tuple(flat[entry] for entry in _entry_names(name, old[name]))
        return entries if isinstance(old[name], tuple) else entries[0]

    return eqx.tree_at(
        lambda tree: [getattr(tree, name) for name in old], model, list(map(new, old))
    )


def _numeric_fields(model: AbstractModel) -> dict[str, Array | tuple[Array, ...]]:
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


def equation(model: AbstractLaw, digits: int = 4) -> str:
    """The law in plain text, such as `w' = 0.25 u' + 0.4 u |u'| - 0.5 w |u'|`."""
    sum_of = [(c, term.text) for c, term in model.addends() if c != 0]
    return "w' = " + signed_sum(sum_of, lambda c: f"{c:.{digits}g}", " ")


def signed_sum(addends, number, space: str) -> str:
    """Coefficients and symbols as a sum with its signs between the addends."""
    text = ""
    for coefficient, symbol in addends:
        sign = "-" if coefficient < 0 else "+"
        size = number(abs(coefficient))
        product = size if symbol == "1" else f"{size}{space}{symbol}"
        text += f" {sign} {product}" if text else f"{sign.strip('+')}{product}"
    return text or "0"
