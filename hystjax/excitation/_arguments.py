"""Converters for the fields of excitations: numbers in, checked arrays out."""

import operator
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp

from .. import _checks
from .._errors import InputError


def scalar(name: str) -> Callable[[Any], jax.Array]:
    """A converter to a floating scalar that is finite."""

    def convert(value: Any) -> jax.Array:
        try:
            array = jnp.asarray(value)
        except (TypeError, ValueError):
            array = None
        if array is None or array.ndim or jnp.iscomplexobj(array):
            raise InputError(
                f"`{name}` must be one real number, got {value!r}. Many excitations at "
                "once are made with `jax.vmap`."
            )
        if _checks.is_concrete(array) and not jnp.isfinite(array):
            raise InputError(f"`{name}` must be finite, got {value!r}.")
        return array.astype(jnp.result_type(float, array.dtype))

    return convert


def positive(name: str, *, zero: bool = False) -> Callable[[Any], jax.Array]:
    """A converter to a floating scalar that is finite and positive (or zero)."""
    to_scalar = scalar(name)

    def convert(value: Any) -> jax.Array:
        array = to_scalar(value)
        _checks.positive(name, array, zero=zero)
        return array

    return convert


def count(name: str) -> Callable[[Any], int]:
    """A converter that lets whole numbers from 1 pass."""

    def convert(value: Any) -> int:
        try:
            number = operator.index(value)
        except TypeError:
            number = 0
        if number < 1:
            raise InputError(f"`{name}` must be a whole number from 1, got {value!r}.")
        return number

    return convert
