"""Which numbers of a model are fitted, and how."""

from collections.abc import Mapping, Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._errors import InputError
from ..models import AbstractModel

Bounds = Mapping[str, tuple[float, float]]
Ties = Mapping[str, tuple[float, str]]


class Parameters(eqx.Module):
    """The free parameters of a model as an unbounded vector.

    Bounded parameters are passed through a logistic or an exponential map; the fit
    never sees a bound, and never meets one.

    **Attributes:**

    - `model`: gives the fixed parameters their values.
    - `names`: free parameters, p of them, in the order of every vector.
    - `ties`: parameters that follow a free one, as (name, factor, name of that one).
    - `lower`, `upper`: bounds, shape (p,), infinite where there are none.
    """

    model: AbstractModel
    names: tuple[str, ...] = eqx.field(static=True)
    ties: tuple[tuple[str, float, str], ...] = eqx.field(static=True)
    lower: Float[Array, " p"]
    upper: Float[Array, " p"]

    def values(self) -> Float[Array, " p"]:
        """The model's own values of the free parameters."""
        parameters = self.model.parameters()
        return jnp.stack([parameters[name] for name in self.names])

    def build(self, values: Float[Array, " p"]) -> AbstractModel:
        """The model with these values, ties included."""
        free = {name: values[i] for i, name in enumerate(self.names)}
        tied = {name: factor * free[source] for name, factor, source in self.ties}
        return self.model.with_parameters(free | tied)

    def bounded(self, unbounded: Float[Array, " p"]) -> Float[Array, " p"]:
        """Values of the parameters at a point of the unbounded space."""
        below, above, width = self._ends()
        both = below + width * jax.nn.sigmoid(unbounded)
        growth = jnp.exp(jnp.minimum(unbounded, 700.0))
        one = jnp.where(jnp.isfinite(self.lower), below + growth, above - growth)
        return self._choose(both, one, unbounded)

    def unbounded(self, values: Float[Array, " p"]) -> Float[Array, " p"]:
        """Inverse of `bounded`; values on a bound or beyond are moved just inside."""
        below, above, width = self._ends()
        share = jnp.clip((values - below) / width, 1e-6, 1 - 1e-6)
        distance = jnp.where(jnp.isfinite(self.lower), values - below, above - values)
        least = 1e-6 * (1 + jnp.abs(values))
        both = jnp.log(share) - jnp.log1p(-share)
        return self._choose(both, jnp.log(jnp.maximum(distance, least)), values)

    def _ends(self):
        """Bounds with harmless numbers where there are none, and their distance."""
        below = jnp.where(jnp.isfinite(self.lower), self.lower, 0.0)
        above = jnp.where(jnp.isfinite(self.upper), self.upper, below + 1.0)
        return below, above, above - below

    def _choose(self, both, one, none):
        has_lower, has_upper = jnp.isfinite(self.lower), jnp.isfinite(self.upper)
        some = jnp.where(has_lower | has_upper, one, none)
        return jnp.where(has_lower & has_upper, both, some)


def parameters(
    model: AbstractModel, fixed: Sequence[str], bounds: Bounds, tied: Ties
) -> Parameters:
    """Sort a model's parameters into fixed, tied, and free ones with their bounds.

    **Raises:** `InputError` for a name that is none of the model's, bounds that cross,
    a tie to a parameter that is not free, or when nothing is left to fit.
    """
    known = tuple(model.parameters())
    sources = [source for _, source in tied.values()]
    _check_names(known, fixed=fixed, bounds=bounds, tied=[*tied, *sources])
    names = tuple(name for name in known if name not in fixed and name not in tied)
    if not names:
        raise InputError("nothing is left to fit: every parameter is fixed or tied.")
    lost = [source for source in sources if source not in names]
    if lost:
        raise InputError(f"`tied` refers to {lost}, which are not free themselves.")
    ends = jnp.array([bounds.get(name, (-jnp.inf, jnp.inf)) for name in names])
    lower, upper = ends.astype(float).T
    crossed = [name for name, (low, high) in bounds.items() if not low < high]
    if crossed:
        raise InputError(f"`bounds` of {crossed} must be (lower, upper) in this order.")
    ties = tuple((name, *tie) for name, tie in tied.items())
    return Parameters(model, names, ties, lower, upper)


def _check_names(known, **given) -> None:
    for argument, names in given.items():
        if isinstance(names, str):
            raise InputError(f"`{argument}` must be a list of names, got {names!r}.")
        unknown = [name for name in names if name not in known]
        if unknown:
            raise InputError(
                f"`{argument}` names {unknown}, but the model's parameters are "
                f"{', '.join(known)}."
            )
