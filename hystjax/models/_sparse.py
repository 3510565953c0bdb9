"""Laws that are linear in their coefficients."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from .._checks import is_concrete
from .._errors import InputError
from ..library import Library, Term
from ._base import AbstractLaw, AbstractModel


class SparseModel(AbstractLaw):
    """A sum of library terms with coefficients, most of them zero.

    **Attributes:**

    - `library`: the k candidate terms.
    - `coefficients`: shape (k,); that of a term has the unit of the output over that of
        the term, a second.
    - `support`: which terms take part, shape (k,). A mask, so that shapes never depend
        on values; `compact` drops the rest.
    - `names`, `units`: of input and output; keyword only.
    """

    library: Library
    coefficients: Float[Array | np.ndarray, " k"]
    support: Bool[Array | np.ndarray, " k"]

    @classmethod
    def from_terms(
        cls,
        terms: dict[str, float],
        *,
        names: tuple[str, str] = ("input", "output"),
        units: tuple[str, str] = ("", ""),
    ) -> "SparseModel":
        """A law from coefficients by term name, such as
        `{"du": 0.25, "u*|du|": 0.4, "w*|du|": -0.5}`.

        **Raises:** `InputError` for no terms or an unknown name.
        """
        library = Library(tuple(Term.parse(name) for name in terms))
        coefficients = jnp.asarray(list(terms.values()), dtype=float)
        return cls(
            library, coefficients, jnp.ones(len(terms), bool), names=names, units=units
        )

    def rate(self, w, u, du):
        coefficients = jnp.where(self.support, self.coefficients, 0)
        return self.library.weighted(coefficients, w, u, du)

    def parameters(self):
        values = jnp.unstack(jnp.asarray(self.coefficients))
        return {self.library.names[i]: values[i] for i in self._active()}

    def with_parameters(self, values):
        new = list(jnp.unstack(jnp.asarray(self.coefficients)))
        for name, value in values.items():
            new[self.library.names.index(name)] = value
        return eqx.tree_at(lambda model: model.coefficients, self, jnp.stack(new))

    def _active(self) -> list[int]:
        """Rows of the support; all rows while it is being traced."""
        if not is_concrete(self.support):
            return list(range(len(self.library)))
        return np.flatnonzero(self.support).tolist()

    def addends(self):
        coefficients = np.asarray(self.coefficients)
        if coefficients.ndim != 1:
            raise InputError(
                "this is a batch of laws, with coefficients of shape "
                f"{coefficients.shape}; pick one with"
                " `jax.tree.map(lambda x: x[i], model)`."
            )
        return tuple(
            (float(coefficients[i]), self.library.terms[i])
            for i in np.flatnonzero(self.support)
        )

    def compact(self) -> "SparseModel":
        """The same law over the library of its own terms, which simulates faster. The
        support must be concrete; without any term the law is returned as it is."""
        rows = tuple(np.flatnonzero(self.support).tolist())
        return self.restricted(rows) if 0 < len(rows) < len(self.library) else self

    def restricted(self, rows: tuple[int, ...]) -> "SparseModel":
        """The law over some of its library's terms, at least one, all taking part."""
        terms = tuple(self.library.terms[i] for i in rows)
        coefficients = jnp.asarray(self.coefficients)[jnp.array(rows)]
        everything = np.ones(len(rows), bool)
        return SparseModel(
            Library(terms), coefficients, everything, names=self.names, units=self.units
        )

    def coefficient_units(self) -> dict[str, str]:
        """Units of the non-zero coefficients, such as `µm V^-1`, by term name."""
        return {term.name: self._unit(term) for _, term in self.addends()}

    def _unit(self, term: Term) -> str:
        w, u, du, abs_du, abs_w = term.powers
        parts = (
            (self.units[1] or "[w]", 1 - w - abs_w),
            (self.units[0] or "[u]", -u - du - abs_du),
            ("s", du + abs_du - 1),
        )
        shown = [unit if p == 1 else f"{unit}^{p:g}" for unit, p in parts if p]
        return " ".join(shown) or "1"


def compacted(model: AbstractModel) -> AbstractModel:
    """A model whose laws with a known support have no other terms, wherever in it they
    are."""

    def shrink(node):
        known = isinstance(node, SparseModel) and is_concrete(node.support)
        return node.compact() if known else node

    return jax.tree.map(
        shrink, model, is_leaf=lambda node: isinstance(node, SparseModel)
    )
