"""Sines of constant, growing, decaying and modulated amplitude."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from .. import _checks
from .._errors import InputError
from ._arguments import positive, scalar
from ._excitation import AbstractSmooth


class Sine(AbstractSmooth):
    """u = amplitude sin(2π frequency t + phase) + offset.

    **Attributes:**

    - `amplitude`, `offset`: input units.
    - `frequency`: Hz, positive.
    - `phase`: rad.
    """

    amplitude: Float[Array, ""] = eqx.field(converter=scalar("amplitude"))
    frequency: Float[Array, ""] = eqx.field(converter=positive("frequency"))
    phase: Float[Array, ""] = eqx.field(converter=scalar("phase"), default=0.0)
    offset: Float[Array, ""] = eqx.field(converter=scalar("offset"), default=0.0)

    def __call__(self, t):
        return self.amplitude * _sine(self.frequency, t, self.phase) + self.offset


class GrowingSine(AbstractSmooth):
    """u = rate t sin(2π frequency t + phase): loops that grow from nothing.

    With rate 1 and frequency 1/(2π) this is t sin t, the excitation of Chandra et al.
    (2023), doi:10.1063/5.0146134.

    **Attributes:**

    - `rate`: growth of the amplitude, input units/s.
    - `frequency`: Hz, positive.
    - `phase`: rad.
    """

    rate: Float[Array, ""] = eqx.field(converter=scalar("rate"))
    frequency: Float[Array, ""] = eqx.field(converter=positive("frequency"))
    phase: Float[Array, ""] = eqx.field(converter=scalar("phase"), default=0.0)

    def __call__(self, t):
        return self.rate * t * _sine(self.frequency, t, self.phase)


class DecayingSine(AbstractSmooth):
    """u = amplitude exp(-t / time_constant) sin(2π frequency t + phase): nested loops
    that shrink to nothing, as in demagnetisation.

    **Attributes:**

    - `amplitude`: at t = 0, input units.
    - `frequency`: Hz, positive.
    - `time_constant`: s, positive.
    - `phase`: rad.
    """

    amplitude: Float[Array, ""] = eqx.field(converter=scalar("amplitude"))
    frequency: Float[Array, ""] = eqx.field(converter=positive("frequency"))
    time_constant: Float[Array, ""] = eqx.field(converter=positive("time_constant"))
    phase: Float[Array, ""] = eqx.field(converter=scalar("phase"), default=0.0)

    def __call__(self, t):
        envelope = self.amplitude * jnp.exp(-(t / self.time_constant))
        return envelope * _sine(self.frequency, t, self.phase)


class ModulatedSine(AbstractSmooth):
    """u = amplitude (1 + depth sin(2π modulation_frequency t)) sin(2π frequency t +
    phase): major and minor loops in turn.

    **Attributes:**

    - `amplitude`: the mean one, input units.
    - `frequency`, `modulation_frequency`: Hz, positive.
    - `depth`: swing of the amplitude as a share of its mean, 0 to 1.
    - `phase`: rad.
    """

    amplitude: Float[Array, ""] = eqx.field(converter=scalar("amplitude"))
    frequency: Float[Array, ""] = eqx.field(converter=positive("frequency"))
    depth: Float[Array, ""] = eqx.field(converter=positive("depth", zero=True))
    modulation_frequency: Float[Array, ""] = eqx.field(
        converter=positive("modulation_frequency")
    )
    phase: Float[Array, ""] = eqx.field(converter=scalar("phase"), default=0.0)

    def __check_init__(self):
        if _checks.is_concrete(self.depth) and self.depth > 1:
            raise InputError(
                f"`depth` must lie between 0 and 1, got {self.depth}: it is a share of "
                "the mean amplitude, not a percentage."
            )

    def __call__(self, t):
        modulation = 1 + self.depth * _sine(self.modulation_frequency, t, 0.0)
        return self.amplitude * modulation * _sine(self.frequency, t, self.phase)


def _sine(frequency, t, phase):
    return jnp.sin(2 * jnp.pi * frequency * t + phase)
