"""First models that are sums of operators, all of one sign, read off a record."""

from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._core import checks
from .._core.jit import jit
from ..least_squares import NonNegative, compress
from ..recording import Recording

_LEAST = 1e-3  # share of the sum of weights below which an operator is left out


def inputs_of(what: str, recording: Recording) -> tuple[float, float]:
    """The lowest and the highest input of a record that a first model can be read off.

    **Raises:** `InputError` where input or output never change, or samples are few.
    """
    checks.concrete(f"`{what}.guess`", recording)
    checks.enough_samples(f"`{what}.guess`", len(recording), 10)
    why = "there is no loop to read a model off."
    checks.not_constant("u", recording.u, why)
    checks.not_constant("w", recording.w, why)
    return float(jnp.min(recording.u)), float(jnp.max(recording.u))


_BINS = 2000  # of the input, in which the output's travel is counted
_EVEN = 0.2  # of what is shared, that goes to all inputs alike


def inputs_by_travel(
    what: str, recording: Recording, shares: Float[np.ndarray, " k"]
) -> Float[np.ndarray, " k"]:
    """Inputs up to which such shares of what the output travels lie, from 0, the lowest
    input, to 1, the highest; of records, and with what is raised, as `inputs_of`.

    So a grid is dense where the output changes, such as near the coercive field of a
    magnet that is driven far into saturation; a fifth is shared evenly over the range,
    so that it is nowhere empty.

    **Source:** de Boor (1974), doi 10.1007/BFb0069121: nodes that equidistribute a
    function's variation.
    """
    edges = np.linspace(*inputs_of(what, recording), _BINS + 1)
    u, w = np.asarray(recording.u), np.asarray(recording.w)
    middles, travel = (u[1:] + u[:-1]) / 2, np.abs(np.diff(w))
    counted, _ = np.histogram(middles, edges, weights=travel)
    part = np.cumsum([0.0, *counted]) / np.sum(counted)
    reached = _EVEN * np.linspace(0, 1, len(edges)) + (1 - _EVEN) * part
    return np.interp(shares, reached, edges)


@jit
def _sum(
    columns: Float[Array, "n k"], w: Float[Array, " n"], weight: Float[Array, " n"]
):
    """Weights of least squares, zero or more, but for that of a constant; what they
    leave, relative; and the constant."""
    # The constant may have either sign: without means, none is needed.
    total, root = jnp.sum(weight), jnp.sqrt(weight)
    means, mean = weight @ columns / total, weight @ w / total
    problem = compress(root[:, None] * (columns - means), root * (w - mean))
    weights = NonNegative().fit(problem).coefficients
    return weights, problem.residual(weights), mean - means @ weights


def best_sum(
    families: Sequence[Float[Array, "n _k"]],
    w: Float[Array, " n"],
    weight: Float[Array, " n"] | None = None,
) -> tuple[int, float, np.ndarray, float]:
    """The family of columns, and the sign, whose sum with weights of that sign is
    closest to an output.

    **Arguments:** the families, the output, and by what `weight` each sample counts,
    all the same by default.

    **Returns:** the number of the family; the sign; the weights, without small ones,
    which noise makes; and the constant beside them.
    """
    weight = jnp.ones_like(w) if weight is None else weight
    found = [
        (sign, family, *_sum(columns, sign * w, weight))
        for family, columns in enumerate(families)
        for sign in (1.0, -1.0)
    ]
    sign, family, weights, _, constant = min(found, key=lambda each: float(each[3]))
    kept = np.asarray(weights)
    kept = np.where(kept > _LEAST * np.sum(kept), kept, 0.0)
    return family, sign, sign * kept, sign * float(constant)
