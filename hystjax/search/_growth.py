"""Noise that grows with the output."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Bool, Float, Shaped

from .._jit import jit

# Natural logarithms of the shares looked at: the likelihood is flat at its maximum.
_SHARES = np.arange(-4.0, 7.05, 0.1)


def weights(
    outputs: Float[Array, "r n"],
    residuals: Float[Array, "r n"],
    used: Bool[Array, "r n"],
    samples: Shaped[ArrayLike, ""],
) -> Float[Array, "r n"] | None:
    """The inverse of each sample's variance, of mean 1, if that grows with the output;
    `None` if it does not.

    The variance is taken for s^2 (1 + a w^2 / mean(w^2)) of the simulated output w. By
    the likelihood of Gaussian noise with the best s, the best a is found; it counts if
    the Bayesian information criterion prefers it to none.

    **Arguments:** simulated outputs, and their residuals; which of them are samples;
    and how many independent ones they are worth.

    **Source:** Davidian and Carroll (1987), doi 10.1080/01621459.1987.10478543, for
    estimates of variance functions; Schwarz (1978), doi 10.1214/aos/1176344136.
    """
    gain, inverse = _likeliest(outputs, residuals, used)
    return inverse if samples * gain > np.log(samples) else None


@jit
def _likeliest(outputs, residuals, used):
    """What the best share gains in twice the logarithm of the likelihood, a sample; and
    the inverse of the variance there, of mean 1."""
    deviance, variances = _profile(outputs, residuals, used)
    best, total = jnp.argmin(deviance), jnp.sum(used)
    inverse = jnp.where(used, 1 / variances[best], 0.0)
    gain = (_even(residuals, used) - deviance[best]) / total
    return gain, inverse * total / jnp.sum(inverse)


def _profile(outputs, residuals, used):
    """Twice the negative logarithm of the likelihood at each share, up to what all have
    in common; and variances there, up to a factor."""
    size = jnp.where(used, outputs**2, 0.0)
    relative = size * jnp.sum(used) / jnp.sum(size)
    variances = 1 + jnp.exp(_SHARES)[:, None, None] * relative
    logarithms = jnp.sum(jnp.where(used, jnp.log(variances), 0.0), axis=(1, 2))
    scaled = residuals / jnp.sqrt(variances)
    return logarithms + jax.vmap(_even, (0, None))(scaled, used), variances


def _even(residuals, used):
    """The same for even noise."""
    total = jnp.sum(used)
    return total * jnp.log(jnp.sum(jnp.where(used, residuals**2, 0.0)) / total)
