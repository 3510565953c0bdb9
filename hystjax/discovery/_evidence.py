"""How sure the terms of a law are, and which experiment would tell more of them."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, PRNGKeyArray

from .. import refinement
from .._core import checks
from .._core.checks import InputError
from .._core.compiling import jit
from .._core.solution import Solution
from ..library import Library, Polynomial
from ..loops import reversals
from ..models import AbstractLaw, SparseModel, as_model
from ..recording import Recording, as_group, as_recording
from ..refinement import Refined
from ..refinement._refine import block_length, check_fitted_on, redrawn
from ..regression import LeastSquaresProblem, compress, novelty
from ..regression._identify import check, of_clocks, told_apart
from ..signals import Linear
from ..simulation import Automatic
from ..simulation._simulate import free_run
from . import search
from ._discover import Discovered
from ._setting import FEW

_SUPPORTS = 2000  # of each size: what no other record would choose is left out


def inclusion(
    found: Solution,
    recordings: Recording | Sequence[Recording],
    *,
    key: PRNGKeyArray,
    largest: int | None = None,
    samples: int = 200,
    block: int | None = None,
) -> dict[str, float]:
    """How often each term would be chosen if the experiment were made again.

    Blocks of the law's residuals are drawn again and added to its free run; about the
    law, the free run is linear in the coefficients of all candidates, and for every
    drawn output a support is chosen by evidence, as `discover` does where residuals are
    white, and of the `signs` it was told, among the 2000 that follow the recorded one
    best, of each size up to `largest`.

    **Arguments:**

    - `found`: the `Solution` of `discover`.
    - `recordings`: what it was found in.
    - `key`: a `jax.random` key.
    - `largest`: most terms of a law, no fewer than were found; by default as many, or
        four.
    - `samples`: number of drawn outputs.
    - `block`: samples a block, several times the length over which residuals are
        correlated; the square root of the recording's length by default.

    **Returns:** shares from 0 to 1 by term, the largest first. Terms that the free run
    cannot tell from those before them in the library have none, but for the law's; nor
    have those of a `known` part, which every law has.

    **Raises:** `InputError` for `samples` below 1, for a `largest` below the number of
    terms that were found, for a block longer than a recording, for other recordings
    than those that the law was found in, and for a law that was found inside of another
    model.

    **Source:** Shao (1996), doi 10.1080/01621459.1996.10476934; blocks as in
    `bootstrap`.
    """
    checks.concrete("`inclusion`", found, recordings, key)
    checks.count("samples", samples)
    if not (Discovered.told_by(found) and Refined.told_by(found)):
        raise InputError(
            "`found` must be what `discover` returned, which knows the law's residuals "
            f"and their weights; got {checks.described(found)}"
            f"{' of another verb' if isinstance(found, Solution) else ''}. The order "
            "is `inclusion(found, recordings)`."
        )
    checks.key("key", key)
    group, law = as_group(recordings, "inclusion(found, recordings)"), found.value
    told, fit = Discovered.of(found), Refined.of(found)
    if not isinstance(law, SparseModel):
        raise InputError(
            "`inclusion` is about laws of the recorded output, and what was found is "
            f'{checks.described(law)} around a law; judge that by `stats["alike"]`.'
        )
    check_fitted_on(group, fit, "inclusion(found, recordings)")
    laid_out = refinement.samples(group, told.weights, fit.substeps)
    # What was fitted has an error; the rest of the law was known, and stays.
    fitted = np.array([name in fit.standard_errors for name in law.library.names])
    known = law.support & ~fitted
    largest = _at_least(int(np.sum(law.support & fitted)), largest)
    residuals, root = fit.residuals, jnp.sqrt(laid_out.weight)
    used = [np.flatnonzero(each) for each in np.asarray(root) > 0]
    lengths = [block_length(block, len(rows)) for rows in used]
    drawn = _drawn(group, residuals, root, used, lengths, key, samples)
    # The recorded outputs beside the drawn ones: by themselves another program.
    outputs = jnp.concatenate([laid_out.w[None], drawn])
    kept, recorded, problems = _about(law, fit.w0, laid_out, known, outputs)
    library = law.library.part(kept.tolist())
    rankings = search.rankings(recorded, largest, _SUPPORTS)
    supports = [np.asarray(ranking.rows) for ranking in rankings]
    share = search.independent_share(root * residuals, root > 0)
    independent = float(jnp.sum(root > 0) * share)
    asked = told.signs or {}
    signs = np.array([asked.get(name, 0.0) for name in library.names])
    shares = _shares(problems, library, supports, independent, len(group), signs)
    order = np.argsort(-shares, kind="stable")
    return {library.names[i]: float(shares[i]) for i in order}


def _at_least(found: int, largest: int | None) -> int:
    """The most terms of a law, of which so many were found."""
    if largest is None:
        return max(FEW, found)
    if checks.whole("largest", largest) < max(1, found):
        raise InputError(
            f"`largest` must be at least {max(1, found)}, the terms that were found, "
            f"got {largest}: of fewer some could never be chosen."
        )
    return largest


@jit
def _drawn(group, residuals, root, used, lengths, key, count: int):
    """Outputs of the law, shape (count, R, n), with residuals drawn again at the rows
    in use, of the size that the root of a sample's weight makes them."""
    n = residuals.shape[1]

    def row(recording, residual, scale, rows, key, length):
        scale = scale[rows]
        noise = redrawn(key, -scale * residual[rows], length) / scale
        run = jnp.pad(recording.w, (0, n - len(recording))) + residual
        return run.at[rows].add(noise)

    def one(key):
        keys = jax.random.split(key, len(group))
        each = zip(group, residuals, root, used, keys, lengths, strict=True)
        return jnp.stack([row(*parts) for parts in each])

    return jax.vmap(one)(jax.random.split(key, count))


def _about(law: SparseModel, starts, laid_out, known, outputs):
    """About a law the rows of terms that its free run tells apart, without those of a
    known part; in these the problem of the first of some outputs, and those of the
    others."""
    around = search.targeted(search.itself, law.target)
    every = search.output_error(
        laid_out, law.library, law.coefficients, starts, outputs, around
    ).less(jnp.where(known, law.coefficients, 0.0))
    recorded = _of_outputs(every, 0)
    kept = np.flatnonzero(np.asarray((told_apart(recorded) | law.support) & ~known))
    drawn = _of_candidates(_of_outputs(every, slice(1, None)), kept)
    return kept, recorded.columns(kept), drawn


def _of_outputs(problems, which: int | slice | Array):
    """The problem of one output of several, or those of some."""
    parts = (problems.target[which], problems.remainder[which])
    return eqx.tree_at(lambda p: (p.target, p.remainder), problems, parts)


def _of_candidates(problems, kept):
    """The problems in some of their columns."""

    def one(which):
        return _of_outputs(problems, which).columns(kept)

    each = jax.vmap(one)(jnp.arange(len(problems.target)))
    return eqx.tree_at(lambda p: p.triangle, each, each.triangle[0])


def _shares(
    problems: LeastSquaresProblem,
    library: Library,
    supports: Sequence[Int[np.ndarray, "_m _s"]],
    samples: float,
    others: int,
    signs: Float[np.ndarray, " k"],
) -> Float[np.ndarray, " k"]:
    """The share of problems in which each of k terms is in the support that is chosen
    by the extended Bayesian information criterion, as `ordered` chooses laws.

    **Arguments:** b problems with one `triangle`, and `target` and `remainder` along a
    leading axis; the terms; the supports to choose from, by size; how many independent
    samples there are; how many unknowns besides the terms; and the signs that
    coefficients are to have, 0 for either: supports with others are not chosen.

    **Source:** Shao (1996), doi 10.1080/01621459.1996.10476934: model selection by the
    bootstrap; Chen and Chen (2008), doi 10.1093/biomet/asn034.
    """
    k = len(library)
    criteria, every = [], []
    for rows in supports:
        size = rows.shape[1]
        laws = math.comb(k, size)
        penalty = search.information_criterion(1.0, samples, size + others, laws)
        values, variances = map(np.asarray, _fitted(problems, jnp.asarray(rows)))
        agreed = np.all(values * signs[rows] >= 0, axis=2)
        criterion = samples * np.log(variances) + penalty
        criteria.append(np.where(agreed, criterion, np.inf))
        every += rows.tolist()
    criteria = np.concatenate(criteria, axis=1)
    chosen = _plainest(criteria, library, every)
    some = np.any(np.isfinite(criteria), axis=1)  # else none has the right signs
    inside = [[i in every[c] for c in chosen] & some for i in range(k)]
    return np.mean(inside, axis=1)


def _plainest(criteria: Float[np.ndarray, "b m"], library: Library, every):
    """Of each problem the plainest of m supports that is hardly told from the best."""
    laws = [search.plainness([library.terms[i] for i in row]) for row in every]
    criteria = np.where(np.isfinite(criteria), criteria, np.inf)
    near = criteria < criteria.min(axis=1, keepdims=True) + search.HARDLY
    return search.plainest(laws, np.where(near, criteria, np.inf))


@jit
def _fitted(
    problems: LeastSquaresProblem, rows: Int[Array, "m s"]
) -> tuple[Float[Array, "b m s"], Float[Array, "b m"]]:
    """The coefficients of each support in each problem, and the variance it leaves."""

    def one(target_and_remainder):
        target, remainder = target_and_remainder
        problem = LeastSquaresProblem(
            problems.triangle, target, remainder, problems.rows
        )
        values, left = search.solved(problem, rows)
        return values, left * (jnp.sum(target**2) + remainder**2) / problems.rows

    return jax.lax.map(one, (problems.target, problems.remainder))


_HIGHER = 5**0.5  # over the frequency: of no common period
_DECAY = 3.0  # time constants in a recording
_SWING = 0.1  # of the input's range: noise makes none so large

# Of the phase of the recording's main frequency and the share of its duration: shapes
# from -1 to 1.
_SHAPES: Mapping[str, Callable] = {
    "a sine of half the amplitude after the first half of the time": (
        lambda phase, share: np.where(share < 0.5, 1.0, 0.5) * np.sin(phase)
    ),
    "a sine that decays to a twentieth": (
        lambda phase, share: np.exp(-_DECAY * share) * np.sin(phase)
    ),
    "half the amplitude, and as much at 2.24 times the frequency": (
        lambda phase, share: (np.sin(phase) + np.sin(_HIGHER * phase)) / 2
    ),
}


@dataclass(frozen=True)
class Suggestion:
    """An input to try.

    **Attributes:**

    - `excitation`: in words.
    - `u`: at the recording's sample times, within its range, shape (n,).
    - `resolved`: the terms that it tells from simpler ones where the recording does
        not.
    """

    excitation: str
    u: Float[Array, " n"]
    resolved: tuple[str, ...]


def suggest_excitation(
    law: AbstractLaw | Solution,
    recording: Recording,
    library: Library | None = None,
    *,
    tolerance: float = 0.01,
) -> tuple[Suggestion, ...]:
    """Inputs under which a library's terms would differ that are equal in a recording.

    The law is simulated under each, at the recording's sample times, about the middle
    of its inputs, at their main frequency and within their range: nothing that the
    device was not exposed to.

    **Arguments:**

    - `law`: the best known one.
    - `recording`: what was measured.
    - `library`: the candidate terms, `library.Polynomial(2)` by default.
    - `tolerance`: a term of which a smaller share is new, given the terms before it,
        cannot be told from those.

    **Returns:** one `Suggestion` for each input that resolves anything, the one that
    resolves most first; none for a law that diverges along the recording.

    **Raises:** `InputError` as `aliases` does, and for a recording without a clock
    where the law depends on the rate.
    """
    checks.concrete("`suggest_excitation`", law, recording)
    tolerance = checks.share("tolerance", tolerance)
    order = "suggest_excitation(law, recording, library)"
    library = Polynomial(2) if library is None else library
    law = as_model(law, order, "law")
    check((as_recording(recording, order),), library)
    law.check_times(recording.t, recording.clocked)
    target = law.target if isinstance(law, SparseModel) else "rate"
    library = of_clocks(library, (recording,), target)
    t, u = np.asarray(recording.t), np.asarray(recording.path.samples()[0])
    start = jnp.asarray(np.asarray(recording.w)[0])
    now = _told_apart(law, library, recording.path, start, tolerance)
    if not now:  # the law loses the recording itself, and nothing is known of that
        return ()
    centre, half = (np.max(u) + np.min(u)) / 2, np.ptp(u) / 2
    share = (t - t[0]) / (t[-1] - t[0])
    phase = np.pi * _swings(recording, share) * share
    found = []
    for words, shape in _SHAPES.items():
        tried = jnp.asarray(centre + half * shape(phase, share), u.dtype)
        path = Linear().path(recording.t, tried)
        new = _told_apart(law, library, path, start, tolerance) - now
        if new:
            resolved = tuple(name for name in library.names if name in new)
            found.append(Suggestion(words, path.samples()[0], resolved))
    return tuple(sorted(found, key=lambda each: -len(each.resolved)))


def _swings(recording: Recording, share: Float[np.ndarray, " n"]) -> float:
    """Half periods of the input's main frequency in a recording; one at least."""
    span = float(np.ptp(np.asarray(recording.u)))
    rows = reversals(recording, threshold=_SWING * span).rows
    if len(rows) < 2:
        return 1.0
    return float((len(rows) - 1) / (share[rows[-1]] - share[rows[0]]))


def _told_apart(law, library: Library, path, start, tolerance: float) -> set[str]:
    """Terms that along an input are not a mix of terms before them; none where the law
    diverges."""
    # An input to try may go faster than those that the law was fitted on.
    w = free_run(law, path, start, Automatic()).w
    if not np.all(np.isfinite(w)):
        return set()
    new = np.asarray(_new(library, w, path, tolerance))
    return {name for name, is_new in zip(library.names, new, strict=True) if is_new}


@jit
def _new(library: Library, w, path, tolerance: float):
    u, du = path.samples()
    problem = compress(library(w, u, du, library.signals(path)), jnp.zeros_like(w))
    return novelty(problem, tolerance=tolerance)[1]
