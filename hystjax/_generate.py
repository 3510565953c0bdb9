"""Simulated recordings: a known law, an excitation, and noise."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, PRNGKeyArray

from . import _checks
from ._errors import InputError
from ._recording import Recording
from ._simulate import simulate
from .excitation import AbstractExcitation
from .models import AbstractModel
from .simulation import AbstractSimulation, Adaptive


def generate(
    model: AbstractModel,
    excitation: AbstractExcitation,
    t: ArrayLike,
    *,
    w0: ArrayLike = 0.0,
    additive: float = 0.0,
    multiplicative: float = 0.0,
    key: PRNGKeyArray | None = None,
    method: AbstractSimulation = Adaptive(),
) -> Recording:
    """The recording that a device with a known law would give.

    **Arguments:**

    - `model`: the law.
    - `excitation`: the input as a function of time.
    - `t`: sample times, shape (n,), s.
    - `w0`: output at the first sample, output units.
    - `additive`: standard deviation of white Gaussian noise on the output, relative to
        the output's own standard deviation.
    - `multiplicative`: standard deviation of noise that multiplies the output by
        1 + noise.
    - `key`: a `jax.random` key; needed with noise.
    - `method`: how the law is integrated.

    **Returns:** a `Recording` that knows its input between the samples.

    **Raises:** `InputError` for noise without a key or a negative level;
    `ComputationError` when the law diverges.
    """
    _checks.positive("additive", additive, zero=True)
    _checks.positive("multiplicative", multiplicative, zero=True)
    times = _checks.vector("t", t)
    trajectory = simulate(model, excitation.path(times), w0=w0, method=method)
    w = _with_noise(trajectory.w, additive, multiplicative, key)
    return Recording(
        times,
        trajectory.u,
        w,
        names=model.names,
        units=model.units,
        interpolation=excitation.interpolation,
    )


def _with_noise(w, additive, multiplicative, key) -> Array:
    if additive == 0 and multiplicative == 0:
        return w
    if key is None:
        raise InputError("noise needs a `key`, such as `key=jax.random.key(0)`.")
    first, second = jax.random.split(key)
    grown = w * (1 + multiplicative * jax.random.normal(first, w.shape, w.dtype))
    return grown + additive * jnp.std(w) * jax.random.normal(second, w.shape, w.dtype)
