"""Run a SciPy routine inside traced code."""

import functools
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np


def on_host(
    function: Callable, t: jax.Array, y: jax.Array, penalty: float | None
) -> tuple[jax.Array, jax.Array]:
    """`function(t, y, penalty)` -> (signal, derivative) by NumPy, under `jit` and
    `vmap` too.

    The result has no derivative with respect to `t` and `y`. The call has the name of
    `function` and closes over nothing else, so that a program that holds it, and its
    numbers, tell all.
    """
    t, y = jax.lax.stop_gradient((t, y))

    @functools.wraps(function)
    def call(t, y, penalty):
        number = None if penalty is None else float(penalty)
        value, slope = function(np.asarray(t, float), np.asarray(y, float), number)
        return value.astype(y.dtype), slope.astype(y.dtype)

    shapes = (jax.ShapeDtypeStruct(jnp.shape(y), y.dtype),) * 2
    return jax.pure_callback(call, shapes, t, y, penalty, vmap_method="sequential")
