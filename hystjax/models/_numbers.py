"""What classical models share: how their numbers are taken, and the Bouc-Wen knee."""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from .._core import checks
from .._core.errors import InputError


def number(value: ArrayLike) -> Array:
    """A parameter as an array of one float."""
    value = jnp.asarray(value)
    if value.ndim:
        raise InputError(
            f"a parameter must be a number, got an array of shape {value.shape}; make "
            "batches of models with `jax.vmap`."
        )
    return value.astype(jnp.result_type(float, value))


def optional(value: ArrayLike | None) -> Array | None:
    """A parameter as an array of one float, if there is one."""
    return None if value is None else number(value)


Numbers = ArrayLike | Sequence[Any]
"""What becomes an array of floats: an array, or lists of numbers."""


def numbers(value: Numbers) -> Array:
    """Parameters as an array of floats."""
    value = jnp.asarray(value)
    return value.astype(jnp.result_type(float, value))


@dataclass(frozen=True)
class Bounded:
    """The converter of a field whose number must lie between two bounds: it refuses
    others, and `refine` keeps the number there."""

    name: str
    lower: float = 0.0
    upper: float = np.inf

    def __call__(self, value: ArrayLike) -> Array:
        array = number(value)
        if checks.is_concrete(array) and not self.lower < float(array) < self.upper:
            least = "positive" if self.lower == 0 else f"above {self.lower:g}"
            most = "" if np.isinf(self.upper) else f" and below {self.upper:g}"
            raise InputError(f"`{self.name}` must be {least}{most}, got {value}.")
        return array


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
    return number(value)


def polynomial(
    coefficients: tuple[Float[Array, ""], ...], u: Float[Array, "*s"]
) -> Float[Array, "*s"]:
    """coefficients[0] + coefficients[1] u + ..., by Horner's rule."""
    total = jnp.zeros_like(u)
    for coefficient in reversed(coefficients):
        total = total * u + coefficient
    return total


def exponent(n: ArrayLike) -> Array:
    """The exponent of a knee, which must be positive."""
    n = number(n)
    checks.positive("n", n)
    return n


def knee(
    z: Float[Array, "*s"],
    dx: Float[Array, "*s"],
    beta: Float[Array, ""],
    gamma: Float[Array, ""],
    n: Float[Array, ""],
) -> Float[Array, "*s"]:
    """What bends the loop of a Bouc-Wen law: beta |dx| z |z|^(n-1) + gamma dx |z|^n."""
    power = magnitude(z, n)
    return (beta * jnp.abs(dx) * jnp.sign(z) + gamma * dx) * power


def magnitude(z: Float[Array, "*s"], n: Float[Array, ""]) -> Float[Array, "*s"]:
    """|z|^n, with a derivative at 0: the logarithm must not see the zero."""
    moved = z != 0
    size = jnp.where(moved, jnp.abs(z), 1.0)
    return jnp.where(moved, jnp.exp(n * jnp.log(size)), 0.0)
