"""Exact excitations: inputs known as functions of time, smooth or piecewise linear."""

from abc import abstractmethod
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float, PRNGKeyArray, Real

from .._core import checks
from .._core.checks import InputError
from .._core.show import moment
from .interpolation import (
    AbstractInputPath,
    AbstractInterpolation,
    Exact,
    FunctionPath,
    Linear,
)

__all__ = [
    "AbstractExcitation",
    "AbstractPiecewiseLinear",
    "AbstractSmooth",
    "Chirp",
    "DecayingSine",
    "FirstOrderReversalCurves",
    "GrowingSine",
    "ModulatedSine",
    "Multisine",
    "Sine",
    "Triangle",
]


def __dir__() -> list[str]:
    return __all__


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
        if checks.is_concrete(array) and not jnp.isfinite(array):
            raise InputError(f"`{name}` must be finite, got {value!r}.")
        return array.astype(jnp.result_type(float, array.dtype))

    return convert


def positive(name: str, *, zero: bool = False) -> Callable[[Any], jax.Array]:
    """A converter to a floating scalar that is finite and positive (or zero)."""
    to_scalar = scalar(name)

    def convert(value: Any) -> jax.Array:
        array = to_scalar(value)
        checks.positive(name, array, zero=zero)
        return array

    return convert


_OFF_GRID = 1e-6  # of a sample interval: what rounding leaves of a time on the grid


class AbstractExcitation(eqx.Module):
    """An input u(t) known at every time."""

    @abstractmethod
    def __call__(self, t: Real[ArrayLike, ""]) -> Float[Array, ""]:
        """The input at the time `t`, s. Differentiable; for arrays use `jax.vmap`."""

    @abstractmethod
    def path(self, t: Real[ArrayLike, " n"]) -> AbstractInputPath:
        """The input path over the sample times `t`, shape (n,), s, strictly
        increasing.

        **Raises:** `InputError` for times that are not so, or that leave out corners of
        straight lines.
        """

    @property
    @abstractmethod
    def interpolation(self) -> AbstractInterpolation:
        """How a recording under this excitation knows its input between samples."""


class AbstractSmooth(AbstractExcitation):
    """An excitation without corners. Sample it so that at most one turning point lies
    between two samples.
    """

    def path(self, t: Real[ArrayLike, " n"]) -> AbstractInputPath:
        """The exact path: between samples, too, it is this very function."""
        return FunctionPath(t=times_of(t, "an input path"), function=self)

    @property
    def interpolation(self):
        """The exact function."""
        return Exact(self)


class AbstractPiecewiseLinear(AbstractExcitation):
    """Straight lines between corners; before the first and after the last corner the
    input rests.
    """

    @abstractmethod
    def corners(self) -> tuple[Float[Array, " m"], Float[Array, " m"]]:
        """Times (s, increasing) and inputs at the corners, the two ends included."""

    def __call__(self, t: Real[ArrayLike, ""]) -> Float[Array, ""]:
        """The input at the time `t`, s."""
        return jnp.interp(t, *self.corners())

    def samples(self, n_per_segment: int) -> Float[Array, " n"]:
        """Sample times with every corner among them: `n_per_segment` equal steps on
        each of the m - 1 straight lines, shape ((m - 1) n_per_segment + 1,), s.
        """
        steps = checks.count("n_per_segment", n_per_segment)
        times, _ = self.corners()
        fraction = jnp.arange(steps) / steps
        inner = times[:-1, None] + fraction * jnp.diff(times)[:, None]
        return jnp.append(inner.ravel(), times[-1])

    @property
    def interpolation(self):
        """Straight lines: right when every corner is sampled, as `path` requires."""
        return Linear()

    def path(self, t: Real[ArrayLike, " n"]) -> AbstractInputPath:
        """The path of straight lines between samples.

        **Raises:** `InputError` when a corner lies between samples, where a straight
        line would cut it off.
        """
        times = times_of(t, "an input path")
        corners = self.corners()
        if checks.is_concrete(times, *corners):
            _check_corners(np.asarray(times), np.asarray(corners[0]))
        return Linear().path(times, jnp.interp(times, *corners))


def times_of(t: Real[ArrayLike, " n"], what: str) -> Float[Array, " n"]:
    """Times at which there can be an input; `what` is asked for at these."""
    times = checks.vector("t", t)
    checks.enough_samples(what, times.shape[0], 2)
    checks.finite("t", times)
    checks.increasing("t", times)
    return times


def _check_corners(times: np.ndarray, corners: np.ndarray) -> None:
    inside = corners[(corners > times[0]) & (corners < times[-1])]
    after = np.searchsorted(times, inside)
    step = times[after] - times[after - 1]
    distance = np.minimum(inside - times[after - 1], times[after] - inside)
    rounding = 4 * np.finfo(times.dtype).eps * np.abs(inside)
    cut = inside[distance > np.maximum(_OFF_GRID * step, rounding)]
    if cut.size:
        raise InputError(
            f"{cut.size} corner(s) of the excitation lie between samples of `t`, the "
            f"first at {moment(cut[0])} s; straight lines between samples would cut "
            "them off. Take `t` from `samples(n_per_segment)`, or choose a sampling "
            "period that divides the time between corners."
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

        **Raises:** `InputError` unless `frequencies` are distinct and positive, `rms`
        is positive, and `key` is one key.
        """
        self.frequencies = checks.vector("frequencies", frequencies)
        self.rms = positive("rms")(rms)
        checks.key("key", key)
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
    periods: int = eqx.field(converter=partial(checks.count, "periods"), static=True)
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
