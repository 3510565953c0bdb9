"""The interface that learned laws and classical models share."""

from abc import abstractmethod

import equinox as eqx
import jax
from jaxtyping import Array, Float

from .._checks import is_concrete
from ..library import Term


class AbstractModel(eqx.Module):
    """A law w' = f(w, u, u').

    **Attributes:**

    - `names`: what the input and the output are; keyword only.
    - `units`: units of the input and of the output; time is in s; keyword only.
    """

    names: tuple[str, str] = eqx.field(
        static=True, kw_only=True, default=("input", "output")
    )
    units: tuple[str, str] = eqx.field(static=True, kw_only=True, default=("", ""))

    @abstractmethod
    def rate(
        self, w: Float[Array, " *s"], u: Float[Array, " *s"], du: Float[Array, " *s"]
    ) -> Float[Array, " *s"]:
        """dw/dt in output units a second; arguments of one shape."""

    @abstractmethod
    def addends(self) -> tuple[tuple[float, Term], ...]:
        """The law as a sum: coefficients and terms. For concrete models only."""

    def terms(self) -> dict[str, float]:
        """Non-zero coefficients by the name of their term."""
        return {term.name: value for value, term in self.addends() if value != 0}

    def __str__(self) -> str:
        leaves = [leaf for leaf in jax.tree.leaves(self) if eqx.is_array(leaf)]
        return equation(self) if is_concrete(*leaves) else repr(self)


def equation(model: AbstractModel, digits: int = 4) -> str:
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
