"""How many independent samples correlated residuals are worth."""

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from .._jit import jit
from ..refinement import ljung_box

_LAGS = 40  # at most, and an even number
_WHITE = 0.01  # probability from which residuals are taken for white


@jit
def effective_samples(
    residuals: Float[Array, "r n"], used: Bool[Array, "r n"]
) -> Float[Array, ""]:
    """The number of independent samples with the same information about a mean.

    What a law leaves of measured data is seldom white, and criteria that count every
    sample then take any small structure for certain. White residuals count whole: the
    sum of their estimated autocorrelations is nothing but chance.

    **Arguments:** residuals of R recordings; and which of them are samples, where
    others fill up short recordings.

    **Source:** Geyer (1992), doi 10.1214/ss/1177011137: autocorrelations are summed in
    pairs up to the first that is not positive; Ljung and Box (1978), doi
    10.1093/biomet/65.2.297: whether they are white, at a level of 1 %.
    """
    correlation, total = _autocorrelation(residuals, used), jnp.sum(used)
    lags = min(_LAGS, len(correlation) - 1) // 2 * 2
    white = ljung_box(correlation[1 : lags + 1], total) > _WHITE
    return total / jnp.where(white, 1.0, _correlation_time(correlation))


def _autocorrelation(residuals, used) -> Float[Array, " n"]:
    """Of all recordings together, from lag 0 on."""
    length = 1 << (2 * residuals.shape[1]).bit_length()  # no lag wraps around
    power = jnp.abs(jnp.fft.rfft(jnp.where(used, residuals, 0.0), length)) ** 2
    products = jnp.sum(jnp.fft.irfft(power, length), axis=0)[: residuals.shape[1]]
    return products / jnp.where(products[0] > 0, products[0], 1.0)


def _correlation_time(correlation: Float[Array, " n"]) -> Float[Array, ""]:
    """In samples: the sum of autocorrelations at all lags, before and after."""
    even = correlation[: 2 * (len(correlation) // 2)]
    pairs = even.reshape(-1, 2).sum(axis=1)
    counted = jnp.cumprod(pairs > 0)
    return jnp.maximum(2 * jnp.sum(pairs * counted) - 1, 1.0)
