"""Check standard errors by fitting the data again and again."""

from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int, PRNGKeyArray

from .._core import checks
from .._core.checks import InputError
from .._core.solution import RESULTS, Solution
from ..models import AbstractModel, as_model
from ..recording import Recording
from ..regression._regressors import as_group
from ..simulation import FixedStep, simulate
from ._certainty import Refined
from ._refine import refine


class Bootstrap(eqx.Module):
    """Parameters fitted to resampled data.

    **Attributes:**

    - `values`: by free parameter, shape (samples,).
    - `standard_errors`: standard deviations of those, over the fits that succeeded.
    - `failed`: number of fits that did not.
    """

    values: dict[str, Float[Array, " samples"]]
    standard_errors: dict[str, Float[Array, ""]]
    failed: Int[Array, ""]


def bootstrap(
    model: AbstractModel | Solution,
    recordings: Recording | Sequence[Recording],
    *,
    key: PRNGKeyArray,
    samples: int = 200,
    block: int | None = None,
    **options: Any,
) -> Bootstrap:
    """Resample blocks of a refined model's residuals, add them to its free run, and
    refine again.

    Blocks keep the correlation of the residuals, which the standard errors of `refine`
    do not know of: where the two differ much, believe these.

    **Arguments:**

    - `model`: what `refine` returned, or its value.
    - `recordings`: what it was refined on.
    - `key`: a `jax.random` key.
    - `samples`: number of fits, all in one `vmap`.
    - `block`: samples a block, several times the length over which residuals are
        correlated; the square root of the recording's length by default.
    - `options`: further arguments of `refine`.

    **Returns:** a `Bootstrap`.

    **Raises:** `InputError` for a block longer than a recording.

    **Source:** Künsch (1989), doi 10.1214/aos/1176347265.
    """
    model = as_model(model, "bootstrap(model, recordings)")
    group = as_group(recordings, "bootstrap(model, recordings)")
    checks.key("key", key)
    checks.positive("samples", samples)
    fits = [_free_run(model, recording) for recording in group]
    blocks = [block_length(block, len(recording)) for recording in group]

    keys = jax.random.split(key, samples)
    values, good = _refits(model, group, fits, blocks, options, keys)
    errors = {name: jnp.std(value, where=good) for name, value in values.items()}
    return Bootstrap(values, errors, jnp.sum(~good))


@eqx.filter_jit
def _refits(model, group, fits, blocks, options, keys):
    """The free parameters by resampled data, a set a key, and whether that ended."""

    def refit(key):
        keys = jax.random.split(key, len(group))
        resampled = [
            eqx.tree_at(lambda r: r.w, recording, w + redrawn(key, e, length))
            for recording, (w, e), length, key in zip(
                group, fits, blocks, keys, strict=True
            )
        ]
        fit = Refined.of(refine(model, resampled, throw=False, **options))
        good = fit.result == RESULTS.successful
        values = fit.value.parameters()
        return {name: values[name] for name in fit.standard_errors}, good

    return jax.vmap(refit)(keys)


def _free_run(model, recording):
    """The model's output, and what it leaves unexplained."""
    w = simulate(model, recording, method=FixedStep()).w
    return w, recording.w - w


def redrawn(key, residuals: Float[Array, " n"], length: int) -> Float[Array, " n"]:
    """Blocks from random places, end to end; the record is taken as a ring."""
    n = residuals.shape[0]
    starts = jax.random.randint(key, (-(-n // length),), 0, n)
    rows = (starts[:, None] + jnp.arange(length)).ravel()[:n] % n
    return (residuals - jnp.mean(residuals))[rows]


def block_length(block: int | None, n: int) -> int:
    length = round(n**0.5) if block is None else block
    if not 1 <= length <= n:
        raise InputError(f"`block` must lie between 1 and {n} samples, got {length}.")
    return length
