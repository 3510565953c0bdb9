"""Laws that are linear in their coefficients."""

from collections.abc import Mapping

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from .._core.checks import InputError, described, is_concrete
from ..library import Library, Term
from ..saving import check_candidates, check_known
from ._base import AbstractModel, AbstractSum, coefficient_dimension
from ._numbers import changed_alike, check_named, number

_BATCH = (
    "this is a batch of laws, with coefficients of shape {}; pick one with "
    "`jax.tree.map(lambda x: x[i], model)`."
)
_FIELDS = ("names", "units", "target", "fitted_range", "terms", "candidates")


class SparseModel(AbstractSum):
    """A sum of library terms with coefficients, most of them zero: the rate of the
    output, or the output itself.

    **Attributes:**

    - `library`: the k candidate terms.
    - `coefficients`: shape (k,); that of a term has the unit of the output over that of
        the term, and if the law gives the rate, a second.
    - `support`: which terms take part, shape (k,). A mask, so that shapes never depend
        on values; `compact` drops the rest.
    - `target`: what the law gives, the `"rate"` w' or the `"value"` w; keyword only. A
        value can only be made of what the input decides.
    - `fitted_range`: how far and how fast the inputs went that it was fitted on, a
        `models.FittedRange`, which `simulate` says when an input leaves; `None` for a
        law that was fitted to nothing; keyword only.
    - `names`, `units`: of input and output; keyword only.

    Its parameters are the coefficients, by the names of their terms, and the numbers in
    the variables of these terms, such as `play(u,0.1).radius`.
    """

    library: Library
    coefficients: Float[Array | np.ndarray, " k"]
    support: Bool[Array | np.ndarray, " k"]
    target: str = eqx.field(static=True, kw_only=True, default="rate")

    def __check_init__(self):
        if self.target not in ("rate", "value"):
            raise InputError(
                f"`target` must be 'rate' or 'value', got {self.target!r}."
            )
        looped = [term.name for term in self.library.terms if not term.driven]
        if self.target == "value" and looped:
            raise InputError(
                f"a law of the value w cannot hold w: leave out {looped}, and "
                "functions of your own, which might."
            )
        # A gradient has none.
        if isinstance(self.support, list | tuple | np.ndarray | jax.Array):
            _check_support(self)

    @classmethod
    def from_terms(
        cls,
        terms: dict[str, float],
        *,
        target: str = "rate",
        names: tuple[str, str] = ("input", "output"),
        units: tuple[str, str] = ("", ""),
    ) -> "SparseModel":
        """A law from coefficients by term name, such as
        `{"du": 0.25, "u*|du|": 0.4, "w*|du|": -0.5}`.

        **Raises:** `InputError` for no terms, an unknown name, or a coefficient that is
        no real number.
        """
        if not isinstance(terms, Mapping):
            raise InputError(
                '`terms` must be coefficients by the names of terms, such as `{"du": '
                f"0.25}}`; got {described(terms)}."
            )
        for each in terms.values():
            number(each)
        library = Library(tuple(Term.parse(name) for name in terms))
        coefficients = jnp.asarray(list(terms.values()), dtype=float)
        everything = jnp.ones(len(terms), bool)
        named = {"names": names, "units": units, "target": target}
        return cls(library, coefficients, everything, **named)

    @property
    def memory(self):
        return self.library.memory

    @property
    def rate_independent(self):
        terms = [self.library.terms[i] for i in _active(self)]
        independent = all(t.rate_degree == (self.target == "rate") for t in terms)
        return independent if is_concrete(self.support) or independent else None

    def kinks(self, x):
        terms = (self.library.terms[i] for i in _active(self))
        kinked = any(v.kinked for term in terms for v, _ in term.factors)
        return (x,) if kinked else ()

    def made(self, w, m, now):
        coefficients = jnp.where(self.support, self.coefficients, 0)
        signals = self.memory.values(m, now)
        return self.library.weighted(coefficients, w, now.u, now.du, signals)

    def parameters(self):
        values = _one_by_one(self.coefficients)
        active = _active(self)
        own = {}
        if active:
            part = self.library.part(active)
            # As terms are, not as their names sort: names change with what they show.
            own = {name: part.numbers[name] for name in part.number_dimensions}
        return {self.library.names[i]: values[i] for i in active} | own

    def with_parameters(self, values):
        every = dict(
            zip(self.library.names, _one_by_one(self.coefficients), strict=True)
        )
        check_named({**every, **self.library.numbers}, values)
        numbers = {n: x for n, x in values.items() if n in self.library.numbers}
        new = changed_alike(
            every, {n: x for n, x in values.items() if n not in numbers}
        )
        library = self.library.with_numbers(numbers) if numbers else self.library
        return eqx.tree_at(
            lambda model: (model.library, model.coefficients),
            self,
            (library, jnp.stack(list(new.values()))),
        )

    def to_fields(self):
        if not is_concrete(self.coefficients, self.support):
            raise InputError(
                "`model` is being traced; save it outside `jit` and `vmap`."
            )
        if np.ndim(self.coefficients) != 1:
            raise InputError(_BATCH.format(np.shape(self.coefficients)))
        law = self.settled()
        names = law.library.names
        check_candidates(len(names))
        rows, values = _active(law), np.asarray(law.coefficients)
        known = self.fitted_range
        return {
            "names": self.names,
            "units": self.units,
            "target": self.target,
            **({} if known is None else {"fitted_range": known}),
            "terms": {names[i]: values[i] for i in rows},
            "candidates": names,
        }

    @classmethod
    def from_fields(cls, fields, context):
        check_known(cls, fields, _FIELDS)
        terms, names = fields.get("terms"), fields.get("candidates")
        if not isinstance(terms, dict):
            raise InputError(f'"terms" must be an object, got {terms!r}.')
        check_candidates(len(terms))
        library = Library.from_fields({"terms": names}, context)
        places = {term: i for i, term in enumerate(library.terms)}
        rows = [_row(name, places, context.functions) for name in terms]
        if len(set(rows)) < len(rows):
            raise InputError(f'"terms" lists a term twice: {", ".join(terms)}.')
        numbers = context.numbers("terms", terms)
        coefficients = np.zeros(len(library), numbers.dtype)
        support = np.zeros(len(library), bool)
        coefficients[rows], support[rows] = numbers, True
        others = {k: x for k, x in fields.items() if k not in ("terms", "candidates")}
        return cls(library, jnp.asarray(coefficients), jnp.asarray(support), **others)

    def settled(self):
        terms = self.library.settled_terms()
        if terms is None:
            return self
        once = dict.fromkeys(terms)
        coefficients, support = self.coefficients, self.support
        if len(once) < len(terms):  # plays have come to one radius: they are one
            same = np.array([[each == term for each in once] for term in terms])
            coefficients = jnp.where(support, coefficients, 0) @ same
            support = support @ same
        return self._over(Library(tuple(once)), coefficients, support)

    def _over(self, library: Library, coefficients, support) -> "SparseModel":
        """The same law in other terms."""
        return SparseModel(
            library,
            coefficients,
            support,
            target=self.target,
            fitted_range=self.fitted_range,
            names=self.names,
            units=self.units,
        )

    def addends(self):
        coefficients = np.asarray(self.coefficients)
        if coefficients.ndim != 1:
            raise InputError(_BATCH.format(coefficients.shape))
        return tuple(
            (float(coefficients[i]), self.library.terms[i])
            for i in np.flatnonzero(self.support)
        )

    def compact(self) -> "SparseModel":
        """The same law over the library of its own terms, which simulates faster. The
        support must be concrete; without any term the law is returned as it is."""
        rows = tuple(np.flatnonzero(self.support).tolist())
        return self.restricted(rows) if 0 < len(rows) < len(self.library) else self

    @property
    def rows_in_use(self):
        return tuple(_active(self)) if is_concrete(self.support) else ()

    def restricted(self, rows: tuple[int, ...]) -> "SparseModel":
        """The law over some of its library's terms, all taking part; for no rows the
        law as it is."""
        if not rows:
            return self
        coefficients = self.coefficients
        if is_concrete(coefficients):  # without a program for each number of rows
            coefficients = np.asarray(coefficients)
        coefficients = jnp.asarray(coefficients[np.array(rows)])
        return self._over(
            self.library.part(rows), coefficients, np.ones(len(rows), bool)
        )

    def tabulated(self):
        names = self.library.names
        return {
            "coefficients": (jnp.asarray(self.coefficients), names),
            "support": (jnp.asarray(self.support), names),
        }

    def dimensions(self):
        terms = (self.library.terms[i] for i in _active(self))
        own = {term.name: coefficient_dimension(term, self.target) for term in terms}
        known = {name: each for name, each in own.items() if each is not None}
        return known | self.library.number_dimensions


def _check_support(law: SparseModel) -> None:
    """Raise `InputError` for a support that is no mask, or not of the terms."""
    kind = getattr(law.support, "dtype", None)
    if kind not in (np.bool_, jax.dtypes.float0):
        of = "" if kind is None else f" of {kind}"
        raise InputError(
            "`support` must be a mask, as `numpy.asarray(support, bool)` makes one; "
            f"got {described(law.support)}{of}."
        )
    shapes = np.shape(law.coefficients), np.shape(law.support)
    if any(shape[-1:] != (len(law.library),) for shape in shapes):
        raise InputError(
            "`coefficients` and `support` must have an entry for each of the "
            f"{len(law.library)} terms of `library`; got shapes {shapes[0]} and "
            f"{shapes[1]}."
        )


def _active(law: SparseModel) -> list[int]:
    """Rows of the support; all rows while it is being traced, and of a gradient, which
    has none. No method, which Equinox would bind anew in each call: of a short
    simulation that would be a tenth."""
    mask = getattr(law.support, "dtype", None) == np.bool_
    if not mask or not is_concrete(law.support):
        return list(range(len(law.library)))
    if np.ndim(law.support) != 1:
        raise InputError(_BATCH.format(np.shape(law.coefficients)))
    return np.flatnonzero(law.support).tolist()


def _row(name: str, places: Mapping[Term, int], functions) -> int:
    """The place of a term, whose factors may come in any order."""
    row = places.get(Term.parse(name, functions))
    if row is None:
        raise InputError(f'"{name}" is in "terms" but not in "candidates".')
    return row


def compacted(model: AbstractModel) -> AbstractModel:
    """A model whose laws with a known support have no other terms, wherever in it they
    are."""

    def shrink(node):
        known = isinstance(node, SparseModel) and is_concrete(node.support)
        return node.compact() if known else node

    return jax.tree.map(
        shrink, model, is_leaf=lambda node: isinstance(node, SparseModel)
    )


def _one_by_one(coefficients: Array | np.ndarray) -> list[Array]:
    """Each by itself: of known ones without a program for each number of them.

    **Raises:** `InputError` for those of a batch of laws.
    """
    if np.ndim(coefficients) != 1:
        raise InputError(_BATCH.format(np.shape(coefficients)))
    if not is_concrete(coefficients):
        return list(jnp.unstack(jnp.asarray(coefficients)))
    return [jnp.asarray(each) for each in np.asarray(coefficients)]
