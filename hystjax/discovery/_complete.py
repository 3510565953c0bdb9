"""A network for what a law misses; whether it learned more than noise, and in which
terms that can be written."""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, PRNGKeyArray

from .. import refinement
from .._core import checks
from .._core.checks import InputError
from .._core.compiling import jit
from .._core.show import quantity, say
from .._core.solution import RESULTS, AbstractFindings, Solution, outcome
from ..least_squares import solution
from ..library import Library, Polynomial, Term, check_library
from ..models import (
    AbstractLaw,
    AbstractModel,
    Hybrid,
    SparseModel,
    as_model,
    compacted,
)
from ..models._hybrid import check_law
from ..recording import Recording, as_group
from ..recording._as_measured import all_across
from ..refinement import LevenbergMarquardt, Refined, Weights, refine
from ..refinement._refine import share
from ..regression import compress
from ..regression._identify import told_apart
from ..simulation import FixedStep, simulate
from . import search
from ._layout import NEAR, NONE, Layout, layout, refined_without, weighted_error

_SOLVER, _STEPS = LevenbergMarquardt(rtol=1e-5), 10
_GAIN = 0.99  # of the mean square before, to be worth another round
_OFFERED = 3  # terms, of which what a network learned is written at most


class Offer(NamedTuple):
    """What a network learned, in terms.

    **Attributes:**

    - `terms`: coefficients by name, to be added to those of the law: of its own terms,
        and of further ones.
    - `share`: of the mean square of what the network adds beyond the law's own terms,
        how much the further ones explain.
    - `law`: the law with these terms, not refined yet; `None` where it is no sum.
    """

    terms: dict[str, float]
    share: float
    law: SparseModel | None


class Completed(AbstractFindings):
    """A law, and a network for what it misses. **Attributes:** what is kept of them,
    the `value`, and the `result`; all others are what `complete` tells in `stats`, by
    the same names."""

    value: AbstractModel
    result: RESULTS
    kept: bool
    why: str
    trained: Hybrid
    law: AbstractModel
    law_errors: Float[np.ndarray, " blocks"]
    errors: Float[np.ndarray, " blocks"]
    offers: tuple[Offer, ...]


def complete(
    law: AbstractLaw | Solution,
    recordings: Recording | Sequence[Recording],
    library: Library | None = None,
    *,
    key: PRNGKeyArray,
    width: int = 16,
    weights: Weights | None = None,
    fading: bool | float = 0.1,
    guard: bool = True,
    rounds: int = 8,
    progress: bool = False,
) -> Solution:
    """Complete a law by a network for what it misses, if there is more than noise.

    The law's numbers stay as they fit best alone, so that it can be read as before, and
    the network's are fitted so that the free run follows the output (by Levenberg and
    Marquardt: there are few enough). So they are without each of the blocks that
    `discover` leaves out in turn, law and network, from one that adds nothing yet. The
    network is kept if it makes the mean square on blocks left out less by more than its
    standard error over the blocks, and if the model forgets, and stays near under
    larger, faster and slower inputs, as `discover` asks of laws. Otherwise the law is
    what is returned.

    What a network that is kept adds along the free run is then regressed on a library,
    and offered as terms.

    **Arguments:**

    - `law`: a law w' = f(w, u, u'), which is refined before, or the `Solution` of
        `discover` or `refine`.
    - `recordings`: one, or several of one device; those that the law was fitted to.
    - `library`: of the terms that are offered, `library.Polynomial(3)` by default.
    - `key`: a `jax.random` key, for the weights that the hidden layer starts from.
    - `width`: its units, five numbers each.
    - `weights`: of the samples, as for `refine`; by default those of the `Solution`,
        of which what was `fixed`, `tied` or `known` stays as it is.
    - `fading`: as for `refine`; networks that make the law keep more are refused.
    - `guard`: whether to refuse those whose output leaves three times the recorded
        range under 1.5 times larger, three times faster and half as fast inputs.
    - `rounds`: most rounds of ten steps of each fit.
    - `progress`: whether to say on standard error how much is being trained.

    **Returns:** a `Solution` whose `value` is a `models.Hybrid`, or the law where the
    network is not kept, and whose `stats` hold

    - `kept`: whether the network is; `why`, in words;
    - `trained`: the `Hybrid`, kept or not; `law`: the law alone, refined;
    - `law_errors`, `errors`: root mean squares on each block left out, of the law and
        with the network, by the weights, shape (blocks,), output units;
    - `offers`: an `Offer` of one, two and three further terms for what it adds; none
        where it is not kept.

    **Raises:** `InputError` for a model that is no law of the rate, and for recordings
    too short for two blocks.

    **Source:** Rackauckas et al. (2020), arXiv 2001.04385, for regressing what a
    network learned on terms; Roberts et al. (2017), doi 10.1111/ecog.02881, for blocks.
    """
    checks.concrete("`complete`", recordings, key)
    checks.key("key", key)
    checks.count("rounds", rounds)
    checks.answers(guard=guard, progress=progress)
    library = Polynomial(3) if library is None else library
    check_library(library)
    recorded = as_group(recordings, "complete(law, recordings)")
    if weights is None:
        weights = _fitted_by(law, recorded)
    given = None if weights is None else refinement.weights_of(recorded, weights)
    refined = _refined(law, recorded, given)
    base, most = compacted(refined.value), share(fading)
    group = all_across(recorded, given)  # runs begin there
    start = Hybrid.untrained(base, group, width=width, key=key)
    substeps = refined.substeps
    laid_out = layout(group, given, substeps, guard)
    if laid_out.count < 2:
        raise InputError(
            "the recordings are too short to leave out blocks of them, and nothing "
            "would tell whether a network learned noise: of one recording 90 samples "
            f"are needed, got {laid_out.samples.w.shape[1]}."
        )
    if progress:
        say(f"training {start.size} numbers {laid_out.count + 1} times")
    # What was fixed, tied or known has no error, and stays.
    held = [x for x in base.parameters() if x not in refined.standard_errors]
    before = _fitted(laid_out, base, (*_fixed(base), *held), None, 0.0, rounds)
    after = _fitted(laid_out, start, tuple(base.parameters()), before, most, rounds)
    alone, trained = before.model, after.model
    kept, why = _verdict(before, after, most, group[0].units[1])
    ran = jnp.asarray(kept or np.all(np.isfinite(before.errors)))
    completed = Completed(
        value=trained if kept else alone,
        result=outcome(ran, RESULTS.diverged),  # pyright: ignore
        kept=kept,
        why=why,
        trained=trained,
        law=alone,
        law_errors=before.errors,
        errors=after.errors,
        offers=_offers(trained, group, library, substeps) if kept else (),
    )
    return completed.solution()


def _fitted_by(law, group) -> Weights | None:
    """The weights of samples that a law was fitted by, if that is told; what leads in
    comes first."""
    told: Any = Refined.of(law).weights if Refined.told_by(law) else None
    if told is None or len(told) != len(group):  # which is refused
        return told
    return [x[-len(own) :] for x, own in zip(told, group, strict=True)]


def _refined(law, group, weights) -> Refined:
    """The law as it is fitted to the recordings, and in how many steps a sample."""
    if Refined.told_by(law):
        return Refined.of(law)
    model = as_model(law, "complete(law, recordings)", "law")
    check_law(model)
    fixed = _fixed(model)
    return Refined.of(refine(model, group, fixed=fixed, weights=weights, throw=False))


def _fixed(law: AbstractModel) -> tuple[str, ...]:
    """Radii, times and frequencies stay those of the terms."""
    return tuple(law.library.numbers) if isinstance(law, SparseModel) else ()


class _Fitted(NamedTuple):
    """A model fitted to all samples; the numbers of fits without each block and to all,
    by name, and their errors on these blocks; the share of a difference that the model
    keeps; and how far its output gets under inputs beyond the recorded ones, over half
    of the recorded range."""

    model: Any
    values: dict[str, Float[Array, " b"]]
    errors: Float[np.ndarray, " c"]
    keeps: float
    beyond: float


def _fitted(
    laid_out: Layout,
    model: AbstractModel,
    fixed: tuple[str, ...],
    law: _Fitted | None,
    fading: float,
    rounds: int,
) -> _Fitted:
    """A model fitted without each block and to all samples, from its own numbers, or
    beside those of a `law` that was fitted so.

    In rounds, since each is in coordinates that are scaled where it begins: units of
    which nothing is let through yet do not matter there, and would be moved at random.
    """
    blocks = jnp.array([*range(laid_out.count), NONE])
    values = {name: jnp.full(blocks.shape, x) for name, x in model.parameters().items()}
    values |= {} if law is None else law.values
    before = np.inf
    for _ in range(rounds):
        ends = _fits(laid_out, model, fixed, values, blocks, fading)
        values, seen = ends.values, np.asarray(ends.seen) ** 2
        if not np.any(seen < _GAIN * before):
            break
        before = seen
    return _Fitted(
        model.with_parameters({name: x[-1] for name, x in values.items()}),
        values,
        np.asarray(ends.unseen[:-1]),
        float(ends.kept[-1]),
        float(ends.beyond[-1]),
    )


class _Ends(NamedTuple):
    """Where fits ended: the numbers by name; the errors on what they saw, and on the
    block that was left out; the share of a difference that is kept; and the distance
    under other inputs."""

    values: dict[str, Float[Array, " b"]]
    seen: Float[Array, " b"]
    unseen: Float[Array, " b"]
    kept: Float[Array, " b"]
    beyond: Float[Array, " b"]


@jit
def _fits(
    layout: Layout,
    model: AbstractModel,
    fixed: tuple[str, ...],
    values: dict[str, Float[Array, " b"]],
    blocks: Int[Array, " b"],
    fading: float,
) -> _Ends:
    """One after the other: derivatives by all numbers of a network keep a processor
    busy, and each fit ends when it may."""
    samples = layout.samples
    starts = samples.w[:, 0]

    def fit(each):
        values, block = each
        objective, end, run, out = refined_without(
            layout,
            model.with_parameters(values),
            block,
            starts,
            _SOLVER,
            _STEPS,
            fixed=fixed,
            fading=fading,
        )
        weighted = jnp.sqrt(samples.weight) * (run.outputs - samples.w)
        names = objective.parameters.names
        return _Ends(
            values | dict(zip(names, end.unknowns.values, strict=True)),
            weighted_error(weighted, jnp.where(out, 0.0, samples.weight)),
            weighted_error(weighted, jnp.where(out, samples.weight, 0.0)),
            jnp.exp(jnp.max(objective.gains(end.unknowns, run))),
            layout.distance(objective, end.unknowns),
        )

    return jax.lax.map(fit, (values, blocks))


def _verdict(
    before: _Fitted, after: _Fitted, fading: float, unit: str
) -> tuple[bool, str]:
    """Whether the network is kept, and why."""
    law, both = (math.sqrt(np.mean(each.errors**2)) for each in (before, after))
    if not math.isfinite(law):
        return False, (
            "the free run of the law alone is lost on a block left out, and there is "
            "nothing to hold the network against: it is not kept."
        )
    if not math.isfinite(both):
        return False, (
            "with the network the free run is lost on a block left out, and it is not "
            "kept."
        )
    gains = before.errors**2 - after.errors**2
    said = (
        f"On {len(gains)} blocks left out free runs of the law are off by "
        f"{quantity(law, unit, 3)} (rms), with the network by {quantity(both, unit, 3)}"
    )
    if not np.mean(gains) > np.std(gains, ddof=1) / math.sqrt(len(gains)):
        return False, f"{said}: it only learned noise, and is not kept."
    if fading and not after.keeps < fading:
        return False, (
            f"{said}, but with it the law does not forget how it began, and it is not "
            "kept (`fading=False` does)."
        )
    if not after.beyond <= NEAR:
        return False, (
            f"{said}, but with it the law runs away beyond the recorded input, and it "
            "is not kept (`guard=False` does)."
        )
    return True, f"{said}, which is kept."


def _offers(
    model: Hybrid, group: tuple[Recording, ...], library: Library, substeps: int
) -> tuple[Offer, ...]:
    """What a network adds along the free runs, regressed on the terms of the law, for
    as much as is only another number of these, and those of a library that explain the
    rest best."""
    own = tuple(term for _, term in model.law.addends() or ())
    every = Library(tuple(dict.fromkeys((*own, *library.terms))))
    rows = [_learned(model, recording, every, substeps) for recording in group]
    columns, added = (np.concatenate(each) for each in zip(*rows, strict=True))
    inside = np.arange(len(every)) < len(own)
    basis, _ = np.linalg.qr(columns[:, inside])
    rest, left = (x - basis @ (basis.T @ x) for x in (columns[:, ~inside], added))
    problem = compress(jnp.asarray(rest), jnp.asarray(left))
    kept = np.flatnonzero(np.asarray(told_apart(problem)))
    offers = []
    for ranking in search.rankings(problem.columns(kept), _OFFERED, 1):
        best = len(own) + kept[np.asarray(ranking.rows[0])]
        chosen = np.concatenate([np.flatnonzero(inside), best])
        values = solution(columns[:, chosen], added).tolist()
        terms = dict(zip((every.terms[i] for i in chosen), values, strict=True))
        named = {term.name: x for term, x in terms.items()}
        explained = 1 - float(ranking.residuals[0]) ** 2
        offers.append(Offer(named, explained, _with(model.law, terms)))
    return tuple(offers)


def _learned(model: Hybrid, recording: Recording, library: Library, substeps: int):
    """The terms along a free run, shape (n, k), and what the network adds, (n,)."""
    path = recording.path
    run = simulate(model, recording, method=FixedStep(substeps), throw=False)
    u, du = path.samples()
    signals = library.signals(path)
    added = jax.vmap(model.added)(run.w, u, du)
    return np.asarray(library(run.w, u, du, signals)), np.asarray(added)


def _with(law: AbstractLaw, terms: dict[Term, float]) -> SparseModel | None:
    """A sum with these added to its own terms, all of which are among them."""
    addends = law.addends()
    if addends is None:
        return None
    own = {term: x for x, term in addends}
    sums = {term: own.get(term, 0.0) + x for term, x in terms.items()}
    every = jnp.ones(len(sums), bool)
    named: dict[str, Any] = {"names": law.names, "units": law.units}
    # Of terms, not of their names, which do not tell functions of one's own.
    values = jnp.asarray(list(sums.values()), float)
    return SparseModel(Library(tuple(sums)), values, every, **named)
