"""What a first-order lag makes of a cubic over one step."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from ..signals import Signals

_SERIES = 18  # terms that are there to rounding where a step is shorter than the lag
_SHORT = 1.0  # step over time constant below which the series is taken


def cubic(before: Signals, now: Signals, h):
    """Coefficients, lowest power first, of the input over a step as a cubic of the
    share of the step: the one of its values and derivatives at both ends."""
    rise, first, last = now.u - before.u, h * before.du, h * now.du
    return (
        before.u,
        first,
        3 * rise - 2 * first - last,
        first + last - 2 * rise,
    )


def response(x: Float[Array, " k"]) -> list[Float[Array, " k"]]:
    """What inputs s^j, j = 0 to 3, of the share s of a step make of a lag that is x
    times shorter than the step: the integral of s^j x exp(-x (1 - s)) over s."""
    short = x < _SHORT
    near, far = jnp.where(short, x, 0.0), jnp.where(short, _SHORT, x)
    # By parts from one to the next, which loses all digits where x is small ...
    parts = [-jnp.expm1(-far)]
    for j in range(1, 4):
        parts.append(1 - j * parts[-1] / far)
    # ... and there by the series of the exponential for the last, and by parts from it
    # to the ones before, which loses none.
    term = total = near / 4
    for i in range(1, _SERIES):
        term = -term * near / (i + 4)
        total += term
    series = [total]
    for j in range(3, 0, -1):
        series.insert(0, (1 - series[0]) * near / j)
    return [jnp.where(short, a, b) for a, b in zip(series, parts, strict=True)]
