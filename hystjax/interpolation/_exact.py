"""Input paths known as a function of time."""

from collections.abc import Callable

import jax
import jax.numpy as jnp

from ._path import AbstractInputPath


class FunctionPath(AbstractInputPath):
    """A path given by a smooth function of time.

    **Attributes:**

    - `t`: sample times, shape (n,), s; they say where the path is looked at, and
        there is at most one turning point between two of them.
    - `function`: the input at a scalar time, differentiable by JAX.
    """

    function: Callable

    @property
    def kinked(self):
        """Smooth functions are not."""
        return False

    def segments(self):
        return self.t[:-1], jnp.diff(self.t)

    def evaluate(self, segment, fraction):
        start, length = segment
        time = start + fraction * length
        return jax.jvp(self.function, (time,), (jnp.ones_like(time),))
