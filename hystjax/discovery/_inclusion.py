"""How sure the terms of a discovered law are."""

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PRNGKeyArray

from .. import refinement
from .._core import checks
from .._core.errors import InputError
from .._core.jit import jit
from .._core.solution import Solution
from ..models import SparseModel
from ..recording import Recording
from ..refinement._bootstrap import block_length, redrawn
from ..refinement._steps import steps
from ..regression._regressors import as_group, told_apart
from . import search

_SUPPORTS = 2000  # of each size: what no other record would choose is left out


def inclusion(
    found: Solution,
    recordings: Recording | Sequence[Recording],
    *,
    key: PRNGKeyArray,
    largest: int = 4,
    samples: int = 200,
    block: int | None = None,
) -> dict[str, float]:
    """How often each term would be chosen if the experiment were made again.

    Blocks of the law's residuals are drawn again and added to its free run; about the
    law, the free run is linear in the coefficients of all candidates, and for every
    drawn output a support is chosen, as `discover` does, among the 2000 that follow the
    recorded one best, of each size up to `largest`.

    **Arguments:**

    - `found`: the `Solution` of `discover`.
    - `recordings`: what it was found in.
    - `key`: a `jax.random` key.
    - `largest`: most terms of a law.
    - `samples`: number of drawn outputs.
    - `block`: samples a block, several times the length over which residuals are
        correlated; the square root of the recording's length by default.

    **Returns:** shares from 0 to 1 by term, the largest first. Terms that the free run
    cannot tell from those before them in the library have none.

    **Raises:** `InputError` for `samples` or `largest` below 1, for a block longer than
    a recording, and for a law that was found inside of another model.

    **Source:** Künsch (1989), doi 10.1214/aos/1176347265; Shao (1996), doi
    10.1080/01621459.1996.10476934.
    """
    checks.concrete("`inclusion`", found, recordings, key)
    for name, value in (("largest", largest), ("samples", samples)):
        checks.positive(name, value)
    if not isinstance(found, Solution) or not {"weights", "residuals"} <= set(
        found.stats
    ):
        raise InputError(
            "`found` must be what `discover` returned, which knows the law's residuals "
            f"and their weights; got {checks.described(found)}"
            f"{' of another verb' if isinstance(found, Solution) else ''}. The order "
            "is `inclusion(found, recordings)`."
        )
    checks.key("key", key)
    group, law = as_group(recordings, "inclusion(found, recordings)"), found.value
    if not isinstance(law, SparseModel):
        raise InputError(
            "`inclusion` is about laws of the recorded output, and what was found is a "
            f'{type(law).__name__} around a law; judge that by `stats["alike"]`.'
        )
    laid_out = refinement.samples(group, found.stats["weights"], steps(group, None))
    coefficients, starts = law.coefficients, found.stats["w0"]
    arguments = (laid_out, law.library, coefficients, starts)
    recorded = search.output_error(*arguments)
    kept = np.flatnonzero(np.asarray(told_apart(recorded)))
    lengths = [block_length(block, len(recording)) for recording in group]
    residuals, root = found.stats["residuals"], jnp.sqrt(laid_out.weight)
    drawn = _drawn(group, residuals, root, lengths, key, samples)
    problems = _of_candidates(search.output_error(*arguments, drawn), kept)
    independent = float(search.effective_samples(root * residuals, root > 0))
    rankings = search.rankings(recorded.columns(kept), largest, _SUPPORTS)
    supports = [np.asarray(ranking.rows) for ranking in rankings]
    library = law.library.part(kept.tolist())
    shares = search.inclusion(problems, library, supports, independent, len(group))
    order = np.argsort(-shares, kind="stable")
    return {library.names[i]: float(shares[i]) for i in order}


@jit
def _drawn(group, residuals, root, lengths, key, count: int) -> Float[Array, "b r n"]:
    """Outputs of the law with residuals drawn again, of the size that the root of a
    sample's weight makes them."""
    n = residuals.shape[1]

    def row(recording, residual, scale, key, length):
        residual, scale = residual[: len(recording)], scale[: len(recording)]
        noise = redrawn(key, -scale * residual, length) / scale
        return jnp.pad(recording.w + residual + noise, (0, n - len(recording)))

    def one(key):
        keys = jax.random.split(key, len(group))
        rows = zip(group, residuals, root, keys, lengths, strict=True)
        return jnp.stack([row(*each) for each in rows])

    return jax.vmap(one)(jax.random.split(key, count))


def _of_candidates(problems, kept):
    """The problems in some of their columns."""

    def one(target, remainder):
        each = eqx.tree_at(
            lambda p: (p.target, p.remainder), problems, (target, remainder)
        )
        return each.columns(kept)

    each = jax.vmap(one)(problems.target, problems.remainder)
    return eqx.tree_at(lambda p: p.triangle, each, each.triangle[0])
