"""One equation a test function: the law, integrated by parts."""

import equinox as eqx
import jax
import jax.numpy as jnp

from .. import _checks
from ._base import AbstractFormulation

_FLATNESS = 4  # of the test functions' ends
_OVERLAP = 16  # test functions start this many to a half width


class WeakForm(AbstractFormulation):
    """The law weighed with test functions phi over short stretches of time,

        sum of c_j  integral of phi theta_j dt  =  - integral of phi' w dt,

    so that the noisy output is never differentiated. phi = (1 - x^2)^4 with x from -1
    to 1. The integrals are sums over the intervals between samples, in whose middle
    output and input are averages of their ends: a turning point at a sample costs no
    accuracy.

    **Attributes:**

    - `half_width`: of a test function, in samples, at least 2: a wide one averages much
        noise, and is blind to what happens within it. A third to a half of the samples
        from one turning point of the input to the next does well.

    **Source:** Messenger and Bortz (2021), doi 10.1137/20M1343166.
    """

    half_width: int = eqx.field(static=True, default=20)

    def __check_init__(self):
        _checks.positive("half_width", self.half_width - 1)

    def equations(self, library, path, w):
        n, m = path.t.shape[0], self.half_width
        _checks.enough_samples(f"`WeakForm({m})`", n, 2 * m + 1)
        h = jnp.diff(path.t)
        middle = path.t[:-1] + h / 2
        output = (w[:-1] + w[1:]) / 2
        u, du = path.at(middle)
        regressors = library(output, u, du, library.signals(path, middle))
        columns = jnp.concatenate([regressors, output[:, None]], axis=1)
        starts = jnp.arange(0, n - 2 * m, max(1, m // _OVERLAP))

        def weighed(start):
            rows = start + jnp.arange(2 * m)
            first, last = path.t[start], path.t[start + 2 * m]
            reach = (last - first) / 2
            x = (middle[rows] - first) / reach - 1
            phi = (1 - x**2) ** _FLATNESS
            slope = -2 * _FLATNESS * x * (1 - x**2) ** (_FLATNESS - 1) / reach
            left = (phi * h[rows]) @ columns[rows, :-1]
            return left, -(slope * h[rows]) @ columns[rows, -1]

        return jax.vmap(weighed)(starts)
