"""Excitations with many frequencies: all at once, or one after the other."""

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float, PRNGKeyArray

from .. import _checks
from .._errors import InputError
from ._arguments import positive, scalar
from ._excitation import AbstractSmooth


class Multisine(AbstractSmooth):
    """u = rms sqrt(2 / k) Σ cos(2π frequencies[i] t + phases[i]) over k frequencies:
    equal amplitudes, random phases.

    Over a whole period its root mean square is `rms`. See Pintelon and Schoukens,
    System Identification (2012), doi:10.1002/9781118287422.

    **Attributes:**

    - `frequencies`: shape (k,), Hz; multiples of one frequency make it periodic.
    - `rms`: input units, positive.
    - `phases`: shape (k,), rad, in [0, 2π).
    """

    frequencies: Float[Array, " k"]
    rms: Float[Array, ""]
    phases: Float[Array, " k"]

    def __init__(
        self,
        frequencies: ArrayLike | Sequence[float],
        rms: ArrayLike,
        *,
        key: PRNGKeyArray,
    ):
        """**Arguments:** `frequencies` and `rms` as the attributes; `key`, from
        `jax.random.key`, draws the phases.

        **Raises:** `InputError` unless `frequencies` are distinct and positive, and
        `rms` is positive.
        """
        self.frequencies = _checks.vector("frequencies", frequencies)
        self.rms = positive("rms")(rms)
        self.phases = jax.random.uniform(
            key, self.frequencies.shape, self.frequencies.dtype, maxval=2 * jnp.pi
        )

    def __check_init__(self):
        _checks.enough_samples("a multisine (`frequencies`)", len(self.frequencies), 1)
        _checks.finite("frequencies", self.frequencies)
        _checks.positive("frequencies", self.frequencies)
        if not _checks.is_concrete(self.frequencies):
            return
        lines, counts = np.unique(np.asarray(self.frequencies), return_counts=True)
        if np.any(counts > 1):
            raise InputError(
                f"`frequencies` must be distinct, but {lines[counts > 1][0]:g} Hz is "
                "there more than once."
            )

    def __call__(self, t):
        angles = 2 * jnp.pi * self.frequencies * t + self.phases
        amplitude = self.rms * jnp.sqrt(2 / len(self.frequencies))
        return amplitude * jnp.sum(jnp.cos(angles))


class Chirp(AbstractSmooth):
    """A sine whose frequency runs evenly from `start` to `stop`:
    u = amplitude sin(2π (start t + (stop - start) t² / (2 duration)) + phase).

    **Attributes:**

    - `amplitude`: input units.
    - `start`, `stop`: frequencies at t = 0 and t = `duration`, Hz, not negative.
    - `duration`: s, positive; the frequency runs on after it.
    - `phase`: rad.
    """

    amplitude: Float[Array, ""] = eqx.field(converter=scalar("amplitude"))
    start: Float[Array, ""] = eqx.field(converter=positive("start", zero=True))
    stop: Float[Array, ""] = eqx.field(converter=positive("stop", zero=True))
    duration: Float[Array, ""] = eqx.field(converter=positive("duration"))
    phase: Float[Array, ""] = eqx.field(converter=scalar("phase"), default=0.0)

    def __call__(self, t):
        slope = (self.stop - self.start) / self.duration
        cycles = self.start * t + slope * t**2 / 2
        return self.amplitude * jnp.sin(2 * jnp.pi * cycles + self.phase)
