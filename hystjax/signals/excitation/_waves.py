"""Sines, sweeps and straight lines: the excitations themselves."""

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float, PRNGKeyArray

from ..._core import checks
from ..._core.errors import InputError
from ._excitation import (
    AbstractPiecewiseLinear,
    AbstractSmooth,
    count,
    positive,
    scalar,
)


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
        if checks.is_concrete(self.depth) and self.depth > 1:
            raise InputError(
                f"`depth` must lie between 0 and 1, got {self.depth}: it is a share of "
                "the mean amplitude, not a percentage."
            )

    def __call__(self, t):
        modulation = 1 + self.depth * _sine(self.modulation_frequency, t, 0.0)
        return self.amplitude * modulation * _sine(self.frequency, t, self.phase)


def _sine(frequency, t, phase):
    return jnp.sin(2 * jnp.pi * frequency * t + phase)


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
        self.frequencies = checks.vector("frequencies", frequencies)
        self.rms = positive("rms")(rms)
        self.phases = jax.random.uniform(
            key, self.frequencies.shape, self.frequencies.dtype, maxval=2 * jnp.pi
        )

    def __check_init__(self):
        checks.enough_samples("a multisine (`frequencies`)", len(self.frequencies), 1)
        checks.finite("frequencies", self.frequencies)
        checks.positive("frequencies", self.frequencies)
        if not checks.is_concrete(self.frequencies):
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


class Triangle(AbstractPiecewiseLinear):
    """A triangle wave: from `offset` up, down through it, and back, `periods` times.

    **Attributes:**

    - `amplitude`, `offset`: input units.
    - `frequency`: Hz, positive.
    - `periods`: how many, from 1.
    """

    amplitude: Float[Array, ""] = eqx.field(converter=scalar("amplitude"))
    frequency: Float[Array, ""] = eqx.field(converter=positive("frequency"))
    periods: int = eqx.field(converter=count("periods"), static=True)
    offset: Float[Array, ""] = eqx.field(converter=scalar("offset"), default=0.0)

    def corners(self):
        """Times (s) and inputs at the ends and the extremes, shape (2 periods + 2,)."""
        extremes = jnp.arange(2 * self.periods)
        quarters = jnp.concatenate(
            [jnp.zeros(1), 2.0 * extremes + 1, jnp.full(1, 4.0 * self.periods)]
        )
        sign = jnp.pad(1.0 - 2 * (extremes % 2), 1)
        return quarters / (4 * self.frequency), self.offset + self.amplitude * sign


class FirstOrderReversalCurves(AbstractPiecewiseLinear):
    """From saturation down to a reversal point and back, for each reversal point in
    turn, at one speed.

    Pike, Roberts and Verosub (1999), doi:10.1063/1.370176. Bring the device to
    saturation first: the input starts there.

    **Attributes:**

    - `saturation`: input units.
    - `reversals`: shape (k,), input units, each below `saturation`.
    - `rate`: speed of the input, input units/s, positive.
    """

    saturation: Float[Array, ""]
    reversals: Float[Array, " k"]
    rate: Float[Array, ""]

    def __init__(
        self,
        saturation: ArrayLike,
        reversals: ArrayLike | Sequence[float],
        rate: ArrayLike,
    ):
        """**Arguments:** as the attributes.

        **Raises:** `InputError` when a reversal is not below `saturation`, or `rate`
        is not positive.
        """
        self.saturation = scalar("saturation")(saturation)
        self.reversals = checks.vector("reversals", reversals)
        self.rate = positive("rate")(rate)

    def __check_init__(self):
        checks.enough_samples("first-order reversal curves", len(self.reversals), 1)
        checks.finite("reversals", self.reversals)
        if not checks.is_concrete(self.saturation, self.reversals):
            return
        above = np.asarray(self.reversals)[self.reversals >= self.saturation]
        if above.size:
            raise InputError(
                f"`reversals` must lie below `saturation` ({float(self.saturation):g}),"
                f" got {above[0]:g}. Turn the signs round for curves from below."
            )

    def corners(self):
        """Times (s) and inputs where the input turns, shape (2 k + 1,): saturation,
        first reversal, saturation, and so on.
        """
        top = jnp.full_like(self.reversals, self.saturation)
        u = jnp.append(jnp.stack([top, self.reversals], axis=1).ravel(), top[0])
        t = jnp.cumsum(jnp.abs(jnp.diff(u))) / self.rate
        return jnp.concatenate([jnp.zeros_like(t[:1]), t]), u
