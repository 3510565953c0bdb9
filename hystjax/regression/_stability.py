"""Which terms are chosen again and again from halves of the equations."""

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Bool, Float, Int, PRNGKeyArray

from .._core import checks
from .._core.checks import InputError, is_concrete
from .._core.compiling import jit
from .._core.show import Card, Shown
from ..least_squares import STLSQ, LeastSquaresProblem, merged, part, threshold_path
from ..library import Library
from ..recording import Recording, as_group
from ._identify import admitted, check, equations, told_apart, weak_form
from .formulation import AbstractFormulation

_BLOCKS = 20  # with many different halves, and long beside what shares its noise
# Shares of the derivative: below, noise keeps many terms; above, the law loses its own.
_THRESHOLDS = tuple(np.geomspace(0.1, 2.0, 40).tolist())
_SHOWN = 0.55  # share of the halves, from which a term is told of


class Stability(Shown):
    """How often terms are selected from halves of the equations.

    **Attributes:**

    - `names`: of the k terms.
    - `thresholds`: shape (m,).
    - `probabilities`: share of the halves from which a threshold selects a term, shape
        (m, k).
    - `number`: terms that a half selects at one threshold or another, their mean.
    - `candidates`: number of terms that the recordings tell apart.
    """

    names: tuple[str, ...] = eqx.field(static=True)
    thresholds: Float[Array, " m"]
    probabilities: Float[Array, "m k"]
    number: Float[Array, ""]
    candidates: Float[Array, ""]

    @property
    def largest(self) -> Float[Array, " k"]:
        """Of each term the largest probability over the thresholds, shape (k,)."""
        return jnp.max(self.probabilities, axis=0)

    def _card(self) -> Card | None:
        if np.ndim(self.probabilities) != 2 or not is_concrete(self.probabilities):
            return None
        title = (
            f"Stability: a half of the equations selects {float(self.number):.3g} of "
            f"{int(self.candidates)} terms, at {len(self.thresholds)} thresholds"
        )
        shares = self.terms(_SHOWN).items()
        return Card(title, tuple((name, f"{100 * x:.3g} %") for name, x in shares))

    def terms(self, cutoff: float = 0.9) -> dict[str, float]:
        """The largest probability of each term that reaches the cut-off, by name, the
        largest first.

        **Raises:** `InputError` for a cut-off that is not above 0.5 and at most 1.
        """
        _check_cutoff(cutoff)
        largest = np.asarray(self.largest)
        order = np.argsort(-largest, kind="stable")
        kept = (i for i in order if largest[i] >= cutoff)
        return {self.names[i]: float(largest[i]) for i in kept}

    def bound(self, cutoff: float = 0.9) -> Float[Array, ""]:
        """How many of `terms(cutoff)` are expected to be false, at most: q^2 / ((2
        cutoff - 1) p), of p `candidates` and the `number` q that a half selects.

        False are terms that a half selects no more often than a guess of q out of p
        would. For few candidates the bound is far above what happens.

        **Raises:** `InputError` for a cut-off that is not above 0.5 and at most 1.

        **Source:** Meinshausen and Bühlmann (2010), theorem 1, doi
        10.1111/j.1467-9868.2010.00740.x; without its assumptions Shah and Samworth
        (2013), theorem 1, doi 10.1111/j.1467-9868.2011.01034.x.
        """
        _check_cutoff(cutoff)
        return self.number**2 / ((2 * cutoff - 1) * self.candidates)


def stability(
    recordings: Recording | Sequence[Recording],
    library: Library,
    regression: STLSQ = STLSQ(),
    *,
    key: PRNGKeyArray,
    thresholds: ArrayLike | Sequence[float] = _THRESHOLDS,
    samples: int = 100,
    block: int | None = None,
    formulation: AbstractFormulation | None = None,
) -> Stability:
    """Select terms from one half of the equations and from the other, again and again.

    The equations are cut into blocks, because neighbours share their noise, and the
    blocks are dealt at random into two halves. From each, sequentially thresholded
    least squares selects terms at every threshold. Where the excitation tells all terms
    apart, those of the law are selected from almost all halves, and those that noise
    lets in from few. Where it hardly does, as under a single sine, no small number of
    terms is stable, or with a ridge the wrong ones may be: `discover` looks further.

    **Arguments:**

    - `recordings`: one, or several of one device.
    - `library`: the candidate terms, k of them. Terms that the recordings cannot tell
        from those before them are left out.
    - `regression`: what selects; its own threshold is not used.
    - `key`: a `jax.random` key.
    - `thresholds`: shape (m,), positive. The smaller the smallest, the more terms a
        half selects, and the larger `bound`.
    - `samples`: number of pairs of halves.
    - `block`: equations a block, a twentieth of all by default; more than share noise,
        which in the weak form are those within a test function, 32 to 63.
    - `formulation`: as for `identify`; by default the weak form that `discover` would
        take, which under `jit` must be given.

    **Returns:** a `Stability`.

    **Raises:** `InputError` as `identify` does; for no thresholds, or thresholds,
    `samples` or a `block` that are not positive; and where a half of the blocks has
    fewer equations than the library has terms.

    **Source:** Meinshausen and Bühlmann (2010), doi 10.1111/j.1467-9868.2010.00740.x;
    pairs of halves, Shah and Samworth (2013), doi 10.1111/j.1467-9868.2011.01034.x.
    """
    if formulation is None:
        checks.concrete("`stability` without a `formulation`", recordings)
    group = as_group(recordings, "stability(recordings, library, regression)")
    checks.key("key", key)
    if not isinstance(regression, STLSQ):
        raise InputError(
            "`regression` must be an `STLSQ`, which selects terms; "
            f"got {checks.described(regression)}, which selects none by a threshold."
        )
    for name, value in (("samples", samples), ("block", 1 if block is None else block)):
        checks.count(name, value)
    levels = _levels(thresholds)
    how = weak_form(group) if formulation is None else formulation
    checks.kind("formulation", how, AbstractFormulation, "formulation.WeakForm(20)")
    library, group = admitted(library, group, how)
    check(group, library)
    return _stability(group, library, regression, key, levels, samples, block, how)


def _levels(thresholds) -> Float[Array, " m"]:
    levels = checks.vector("thresholds", thresholds)
    checks.positive("thresholds", levels)
    if not levels.size:
        raise InputError("`thresholds` is empty; pass at least one.")
    return levels


@jit
def _stability(group, library, regression, key, levels, samples, block, how):
    blocks, kept = _blocks(group, library, how, block)

    def selected(half) -> Bool[Array, "m k"]:
        problem = merged(jax.tree.map(lambda leaf: leaf[half], blocks))
        return threshold_path(regression, problem, levels).support

    keys = jax.random.split(key, samples)
    pairs = jax.vmap(_pair, (0, None))(keys, len(blocks.target))
    supports = jax.vmap(selected)(pairs.reshape(2 * samples, -1))
    return Stability(
        library.names,
        levels,
        jnp.mean(supports, axis=0, dtype=levels.dtype),
        jnp.sum(jnp.any(supports, axis=1), dtype=levels.dtype) / (2 * samples),
        jnp.sum(kept, dtype=levels.dtype),
    )


def _blocks(
    group, library: Library, how: AbstractFormulation, block: int | None
) -> tuple[LeastSquaresProblem, Bool[Array, " k"]]:
    """The factored blocks of equations, and which of the terms these tell apart; the
    columns of others are zero."""
    tables = [jnp.column_stack(each) for each in equations(group, library, how)]
    total = sum(len(table) for table in tables)
    length = max(1, total // _BLOCKS) if block is None else block
    counts = [max(1, round(len(table) / length)) for table in tables]
    _check_blocks(total, length, sum(counts), len(library))
    longest = max(-(-len(t) // c) for t, c in zip(tables, counts, strict=True))
    cut = [_cut(t, c, longest) for t, c in zip(tables, counts, strict=True)]
    rows = jnp.concatenate(cut)
    blocks = jax.vmap(part)(rows[..., :-1], rows[..., -1])
    kept = told_apart(merged(blocks))
    return eqx.tree_at(lambda b: b.triangle, blocks, blocks.triangle * kept), kept


def _cut(
    table: Float[Array, "n c"], count: int, length: int
) -> Float[Array, "count length c"]:
    """Blocks of almost as many rows, filled up with zeros, which change no fit."""
    edges = np.linspace(0, len(table), count + 1).astype(int)
    rows = edges[:-1, None] + np.arange(length)
    rows = np.where(rows < edges[1:, None], rows, len(table))
    return jnp.pad(table, ((0, 1), (0, 0)))[rows]


def _pair(key: PRNGKeyArray, count: int) -> Int[Array, "2 half"]:
    """Which of the blocks are in one half, and which in the other; of an odd number
    one is in neither."""
    half = count // 2
    return jax.random.permutation(key, count)[: 2 * half].reshape(2, half)


def _check_blocks(total: int, length: int, count: int, terms: int) -> None:
    half = count // 2 * length
    if half < terms:
        raise InputError(
            f"`block` of {length} makes {count} of {total} equations, and half of the "
            f"blocks has fewer equations than the library has terms, {terms}. Use "
            "shorter blocks, or a longer recording."
        )


def _check_cutoff(cutoff: float) -> None:
    checks.number("cutoff", cutoff)
    if not 0.5 < cutoff <= 1:
        raise InputError(f"`cutoff` must be above 0.5 and at most 1, got {cutoff}.")
