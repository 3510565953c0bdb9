"""What corrects an input by the errors that it leaves: at once, or the next time."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._core import checks
from .._core.errors import InputError
from ..models._numbers import number


class Loop(NamedTuple):
    """What a loop keeps from sample to sample.

    **Attributes:** the `integral`, input units; the `error` before, and its derivative
    as it was filtered, `slope`.
    """

    integral: Float[Array, ""]
    error: Float[Array, ""]
    slope: Float[Array, ""]


class Now(NamedTuple):
    """What a loop is given at a sample.

    **Attributes:** the `error` that was measured; lengths of the sample intervals
    `behind` (0 at the first sample) and `ahead`, s; the feedforward input at the end of
    the one ahead; and the lowest and highest input there.
    """

    error: Float[Array, ""]
    behind: Float[Array, ""]
    ahead: Float[Array, ""]
    feedforward: Float[Array, ""]
    low: Float[Array, ""]
    high: Float[Array, ""]


class PID(eqx.Module):
    """Feedback: proportional, integral, derivative.

    What is measured at a sample decides the input at the next: with the error
    e = reference - measured and the sample interval h

        u[k + 1] = feedforward[k + 1] + kp e[k] + z[k + 1] + kd d[k],
        z[k + 1] = z[k] + ki h e[k],    z[0] = 0,
        d[k] = (filter d[k - 1] + e[k] - e[k - 1]) / (filter + h),    d[0] = 0.

    The integral goes as far as the limits of u, and not beyond.

    **Attributes:** scalars.

    - `kp`: input over output units.
    - `ki`: the same, per s.
    - `kd`: the same, times s.
    - `filter`: time constant of a low-pass of the derivative, s, 0 for none.

    **Source:** Åström and Hägglund (1995), *PID Controllers: Theory, Design, and
    Tuning*, ISBN 1-55617-516-7, of which this is the conditional integration.
    """

    kp: Float[Array, ""] = eqx.field(converter=number, default=0.0)
    ki: Float[Array, ""] = eqx.field(converter=number, default=0.0)
    kd: Float[Array, ""] = eqx.field(converter=number, default=0.0)
    filter: Float[Array, ""] = eqx.field(converter=number, default=0.0)

    def __check_init__(self):
        checks.positive("filter", self.filter, zero=True)

    def __call__(self, loop: Loop, now: Now) -> tuple[Float[Array, ""], Loop]:
        """The next input, and what is kept."""
        usual = self.filter + now.behind
        changed = self.filter * loop.slope + now.error - loop.error
        known = now.behind > 0
        slope = jnp.where(known, changed / jnp.where(known, usual, 1.0), 0.0)
        rest = now.feedforward + self.kp * now.error + self.kd * slope
        more = self.ki * now.ahead * now.error
        # Upwards no further than the upper limit, which may be behind already.
        up = jnp.clip(now.high - rest - loop.integral, 0, jnp.maximum(more, 0))
        down = jnp.clip(now.low - rest - loop.integral, jnp.minimum(more, 0), 0)
        integral = loop.integral + jnp.where(more > 0, up, down)
        u = jnp.clip(rest + integral, now.low, now.high)
        return u, Loop(integral, now.error, slope)


class Learning(eqx.Module):
    """Iterative learning: the reference is repeated, each time from the same state, and
    the error of one time corrects the feedforward of the next,

        feedforward += gain * smoothed(reference - measured).

    On a device of slope s errors fall by the factor 1 - gain s each time; of noise
    learning keeps the less, the smaller the gain and the longer the smoothing.
    Smoothing looks ahead as well as back, so that it shifts nothing: one low-pass run
    forwards and then backwards. Slow errors pass it whole and fast ones are learned
    later, but none is learned with the wrong sign.

    **Attributes:**

    - `gain`: input over output units, a scalar.
    - `smoothing`: time constant of the low-pass, s, a scalar; 0 for none.
    - `repetitions`: how many times the reference is run, the first included.

    **Source:** Arimoto, Kawamura and Miyazaki (1984), doi 10.1002/rob.4620010203.
    """

    gain: Float[Array, ""] = eqx.field(converter=number)
    smoothing: Float[Array, ""] = eqx.field(converter=number, default=0.0)
    repetitions: int = eqx.field(static=True, default=10)

    def __check_init__(self):
        checks.positive("smoothing", self.smoothing, zero=True)
        if checks.whole("repetitions", self.repetitions) < 1:
            raise InputError(
                "`repetitions` counts the first run too and must be at least 1, got "
                f"{self.repetitions}."
            )

    def correction(
        self, t: Float[Array, " n"], error: Float[Array, " n"]
    ) -> Float[Array, " n"]:
        """What is added to the feedforward after errors, reference - measured, at the
        times `t`."""
        some = self.smoothing > 0
        kept = jnp.exp(-jnp.diff(t) / jnp.where(some, self.smoothing, 1.0))
        kept = jnp.where(some, kept, 0.0)

        def follow(before, row):
            kept, now = row
            now = now + kept * (before - now)
            return now, now

        def low_pass(x, kept):
            later = jax.lax.scan(follow, x[0], (kept, x[1:]))[1]
            return jnp.concatenate([x[:1], later])

        forward = low_pass(error, kept)
        return self.gain * low_pass(forward[::-1], kept[::-1])[::-1]
