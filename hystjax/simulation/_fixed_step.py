"""The fast way: classical Runge-Kutta steps on the sample grid."""

import equinox as eqx
import jax
import jax.numpy as jnp

from .._errors import InputError
from .._solution import RESULTS, outcome
from ._base import AbstractSimulation


class FixedStep(AbstractSimulation):
    """Runge-Kutta of fourth order with a fixed number of steps a sample interval.

    Jumps of du/dt fall between steps, so they cost no accuracy. There is no error
    control: for fitting, sweeps and well-sampled records.

    **Attributes:**

    - `substeps`: steps a sample interval; inputs that are smooth between samples need
        at least 2, one before and one after a turning point.
    """

    substeps: int = eqx.field(static=True, default=2)

    def __check_init__(self):
        if self.substeps < 1:
            raise InputError(f"`substeps` must be at least 1, got {self.substeps}.")

    def integrate(self, model, path, w0, scale):
        if self.substeps < 2 and not path.kinked:
            raise InputError(
                "`FixedStep(substeps=1)` cannot step around the turning points of an "
                "input that is smooth between samples; use `substeps=2` or more."
            )
        step, u, du = path.grid(self.substeps)

        def advance(w, inputs):
            w = _runge_kutta(model.rate, w, *inputs)
            return w, w

        _, later = jax.lax.scan(advance, w0, (step, u, du))
        later = later[self.substeps - 1 :: self.substeps]
        w = jnp.concatenate([w0[None], later])
        result = outcome(jnp.all(jnp.isfinite(w)), RESULTS.diverged)
        return w, result, {"num_steps": jnp.array(step.shape[0])}


def _runge_kutta(rate, w, step, u, du):
    k1 = rate(w, u[0], du[0])
    k2 = rate(w + step / 2 * k1, u[1], du[1])
    k3 = rate(w + step / 2 * k2, u[1], du[1])
    k4 = rate(w + step * k3, u[2], du[2])
    return w + step / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
