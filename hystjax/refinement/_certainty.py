"""How well the data determine what was fitted."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float

from ..regression import compress
from ._objective import Objective, Unknowns

_LAGS = 40


class Certainty(eqx.Module):
    """Linearised uncertainty of q unknowns: p values, then free starts.

    **Attributes:**

    - `covariance`: shape (q, q), natural units.
    - `singular_values`: of the Jacobian with columns of length 1, largest first,
        relative to the largest, shape (q,). Near 0: the data do not determine the
        combination of unknowns in the same row of `directions`.
    - `directions`: shape (q, q); rows are combinations of the scaled unknowns.
    - `output`: standard errors of the simulated outputs, shape (R, n), output units.
    - `noise`: standard deviation of the residuals, output units.
    """

    covariance: Float[Array, "q q"]
    singular_values: Float[Array, " q"]
    directions: Float[Array, "q q"]
    output: Float[Array, "r n"]
    noise: Float[Array, ""]


def linearised(
    objective: Objective, unknowns: Unknowns, free_starts: bool
) -> tuple[Float[Array, "r n"], Float[Array, "m q"]]:
    """Simulated outputs, shape (R, n), and their Jacobian, shape (R n, q)."""

    def outputs(values, starts):
        return objective.outputs(Unknowns(values, starts))[0]

    if free_starts:
        flat, restore = ravel_pytree((unknowns.values, unknowns.starts))
        function = lambda x: outputs(*restore(x))  # noqa: E731
    else:
        flat = unknowns.values
        function = lambda x: outputs(x, unknowns.starts)  # noqa: E731
    value, push = jax.linearize(function, flat)
    columns = jax.vmap(push, out_axes=-1)(jnp.eye(len(flat), dtype=flat.dtype))
    return value, columns.reshape(-1, len(flat))


def certainty(
    objective: Objective, outputs: Float[Array, "r n"], jacobian: Float[Array, "m q"]
) -> Certainty:
    """Covariance from the Jacobian at the solution, for independent residuals.

    For robust losses the residual variance is that of M-estimates.

    **Arguments:** the objective, and what `linearised` returns.

    **Source:** Seber and Wild (2003), doi 10.1002/0471725315; Huber (1973),
    doi 10.1214/aos/1176342503.
    """
    samples = objective.samples
    root = jnp.sqrt(samples.weight).ravel()
    noise = _noise(objective, outputs, jacobian.shape[-1])
    lengths = jnp.linalg.norm(root[:, None] * jacobian, axis=0)
    lengths = jnp.where(lengths > 0, lengths, 1.0)
    scaled = jacobian / lengths
    problem = compress(root[:, None] * scaled, jnp.zeros_like(root))
    _, sizes, directions = jnp.linalg.svd(problem.triangle)
    floor = jnp.finfo(sizes.dtype).eps * sizes[0]
    spread = directions.T / jnp.maximum(sizes, floor)
    half = noise * spread / lengths[:, None]
    output = jnp.linalg.norm(jacobian @ half, axis=-1).reshape(samples.w.shape)
    return Certainty(half @ half.T, sizes / sizes[0], directions, output, noise)


def _noise(objective, outputs, unknowns: int):
    """Residual standard deviation in units of the output, per unit of weight."""
    samples, loss = objective.samples, objective.loss
    residuals = outputs - samples.w
    influence, slope = jax.jvp(
        loss.influence, (residuals,), (jnp.ones_like(residuals),)
    )
    free = jnp.maximum(samples.scored - unknowns, 1)
    mean = jnp.sum(samples.weight * influence**2) / free
    share = jnp.sum(samples.weight * slope) / jnp.sum(samples.weight)
    return jnp.sqrt(mean) / share


def autocorrelation(residuals: Float[Array, " n"], weight: Float[Array, " n"]):
    """Autocorrelation of residuals at lags 1 to 40, and the Ljung-Box probability that
    white noise would show as much.

    **Source:** Ljung and Box (1978), doi 10.1093/biomet/65.2.297.
    """
    used = weight > 0
    n = jnp.sum(used)
    centred = jnp.where(used, residuals - jnp.sum(residuals * used) / n, 0.0)
    lags = min(_LAGS, residuals.shape[0] - 1)
    length = 1 << (residuals.shape[0] + lags).bit_length()  # no lag wraps around
    power = jnp.abs(jnp.fft.rfft(centred, length)) ** 2
    products = jnp.fft.irfft(power, length)[1 : lags + 1]
    correlation = products / jnp.sum(centred**2)
    left = jnp.maximum(n - jnp.arange(1, lags + 1), 1)
    statistic = n * (n + 2) * jnp.sum(correlation**2 / left)
    return correlation, jax.scipy.stats.chi2.sf(statistic, lags)
