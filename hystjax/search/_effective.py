"""How many independent samples correlated residuals are worth."""

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float


def effective_samples(
    residuals: Float[Array, "r n"], used: Bool[Array, "r n"]
) -> Float[Array, ""]:
    """The number of independent samples with the same information about a mean.

    What a law leaves of measured data is seldom white, and criteria that count every
    sample then take any small structure for certain.

    **Arguments:** residuals of R recordings; and which of them are samples, where
    others fill up short recordings.

    **Source:** Geyer (1992), doi 10.1214/ss/1177011137: autocorrelations are summed in
    pairs up to the first that is not positive.
    """
    length = 1 << (2 * residuals.shape[1]).bit_length()  # no lag wraps around
    power = jnp.abs(jnp.fft.rfft(jnp.where(used, residuals, 0.0), length)) ** 2
    products = jnp.sum(jnp.fft.irfft(power, length), axis=0)[: residuals.shape[1]]
    size = jnp.where(products[0] > 0, products[0], 1.0)
    correlation = products / size
    even = correlation[: 2 * (len(correlation) // 2)]
    pairs = even.reshape(-1, 2).sum(axis=1)
    counted = jnp.cumprod(pairs > 0)
    time = jnp.maximum(2 * jnp.sum(pairs * counted) - 1, 1.0)
    return jnp.sum(used) / time
