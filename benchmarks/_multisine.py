"""A Duhem law along four sines."""

import jax
import jax.numpy as jnp

import hystjax as hj

_DURATION = 100.0  # s


@jax.jit
def simulated(t, w0):
    """Input and output at these times, shape (n,) each."""
    u = sum(jnp.sin(rate * t) / rate for rate in (1.0, 2.3, 5.1, 0.37))
    path = hj.interpolation.Linear().path(t, u)
    method = hj.simulation.FixedStep()
    law = hj.models.Duhem(0.4, 0.5, 0.25)
    return u, hj.simulate(law, path, w0=w0, method=method, throw=False).w


def recording(n: int) -> hj.Recording:
    """So many samples of 100 s."""
    t = jnp.linspace(0, _DURATION, n)
    return hj.Recording(t, *simulated(t, 0.0))
