"""From recordings to the terms of a law whose output is not seen itself."""

import functools
from collections.abc import Callable, Sequence
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from .._core import checks
from .._core.errors import InputError
from .._core.jit import jit
from .._core.solution import Solution
from ..library import Library
from ..models import AbstractLaw, AbstractModel, SparseModel
from ..recording import Recording
from ..refinement import LevenbergMarquardt, refine
from ..regression import compress, novelty
from ..regression._regressors import as_group
from . import search
from .search import Candidate, information_criterion

_NEW = 1e-6  # share of a term that must be new for it to be a candidate
_MOST = 5000  # supports of a size that are looked at one by one
_AT_ONCE = 256  # fits side by side
_SAMPLES = 20  # between turning points, enough to tell hopeless laws
_COARSE = (LevenbergMarquardt(rtol=1e-4), 15)  # and most steps
_FINE = (LevenbergMarquardt(rtol=1e-6), 60)

Around = Callable[[AbstractLaw], AbstractModel]


def discover_hidden(
    recordings: Recording | Sequence[Recording],
    library: Library,
    around: Around,
    *,
    size: float,
    key: PRNGKeyArray,
    largest: int = 3,
    width: int = 12,
    starts: int = 8,
    throw: bool = True,
) -> Solution:
    """Find the law of a hidden quantity, of which the recorded output is a function.

    There is no derivative to regress. Instead, laws of all supports of up to `largest`
    terms are fitted to the recorded output by trajectory matching, each from random
    coefficients several times, for a few steps and on thinned recordings; the best of
    each size are then refined on all samples,
    and the least extended Bayesian information criterion decides. (Of sizes with more
    than 5000 supports, those are tried that add a term to one of the best of the size
    before.)

    **Arguments:**

    - `recordings`: one, or several of one device.
    - `library`: candidate terms of the hidden law, in which w stands for the hidden
        quantity. Of terms that the input makes equal the first is tried.
    - `around`: the model that a law is the hidden part of, such as `lambda law:
        models.Butterfly(law, offset=-0.1)`; its own parameters are fitted too, from the
        values given there.
    - `size`: about the largest hidden output, from which random coefficients get their
        size.
    - `key`: a `jax.random` key.
    - `largest`: most terms of the law.
    - `width`: laws of each size that are refined.
    - `starts`: random coefficients that each law is fitted from.
    - `throw`: whether to raise when the last refinement fails, or to say so in
        `result`.

    **Returns:** a `Solution` whose `value` is a model, `around` a `SparseModel` of the
    chosen terms, and whose `stats` are those of `refine` for it, and

    - `candidates`: every `Candidate` that was refined, the best first;
    - `frontier`: the best of each number of terms, by that number.

    **Raises:** `InputError` for sizes below 1 or a constant output; `ComputationError`
    when the chosen law diverges.

    **Source:** Chen and Chen (2008), doi 10.1093/biomet/asn034.
    """
    checks.concrete("`discover_hidden`", recordings, size, key)
    group = as_group(recordings)
    for name, value in (("largest", largest), ("width", width), ("starts", starts)):
        if value < 1:
            raise InputError(f"`{name}` must be at least 1, got {value}.")
    checks.positive("size", size)
    key, look_key = jax.random.split(key)
    new, typical = _look(group, library, size, look_key)
    kept = np.flatnonzero(np.asarray(new))
    reduced = library.part(kept.tolist())
    fit = _Fit(group, reduced, around)
    most = min(largest, len(kept))
    squares, lanes = _searched(fit, typical[kept], most, width, starts, key)
    found = _sorted(fit, squares, lanes)
    candidates = tuple(candidate for candidate, _ in found)
    own = _rows_of(lanes, found[0][1]).own
    model = around(SparseModel.from_terms(candidates[0].terms)).with_parameters(own)
    solution = refine(model, group, throw=throw)
    stats = {"candidates": candidates, "frontier": search.frontier(candidates)}
    return Solution(solution.value, solution.result, solution.stats | stats)


@jit
def _look(group, library: Library, size, key):
    """Which terms the inputs do not make equal to others, whatever the hidden output;
    and coefficients that would give it its size, shape (k,)."""
    u, du = (
        jnp.concatenate(x) for x in zip(*(r.path.samples() for r in group), strict=True)
    )
    hidden = size * jax.random.uniform(key, u.shape, u.dtype, -1, 1)
    memory = [library.signals(recording.path) for recording in group]
    memory = jax.tree.map(lambda *each: jnp.concatenate(each), *memory)
    columns = library(hidden, u, du, memory)
    _, new = novelty(compress(columns, jnp.zeros_like(u)), tolerance=_NEW)
    rate = size / jnp.std(u) * jnp.sqrt(jnp.mean(du**2))
    return new, rate / jnp.sqrt(jnp.mean(columns**2, axis=0))


class _Lanes(NamedTuple):
    """A batch of models to be fitted side by side.

    **Attributes:** as of `search.Choice`, with a leading axis; and values of the
    parameters that the models have beside the law's, by name.
    """

    rows: Int[Array, "m s"]
    used: Bool[Array, "m s"]
    coefficients: Float[Array, "m s"]
    own: dict[str, Float[Array, " m"]]


class _Fit(eqx.Module):
    """What all candidates are fitted to, and how they become models."""

    group: tuple[Recording, ...]
    library: Library
    around: Around = eqx.field(static=True)

    def __call__(self, lane: _Lanes, solver, max_steps: int):
        """The squared error of one lane's refined free run, and where it ended."""
        law = search.Choice(self.library, *lane[:2], tuple(lane.coefficients))
        model = self.around(law).with_parameters(lane.own)
        solution = refine(
            model, self.group, solver=solver, max_steps=max_steps, throw=False
        )
        values = solution.value.parameters()
        coefficients = jnp.stack([values.pop(name) for name in law.parameters()])
        squares = jnp.sum(solution.stats["residuals"] ** 2)
        lost = ~jnp.isfinite(squares)
        end = lane._replace(coefficients=coefficients, own=values)
        return jnp.where(lost, jnp.inf, squares), end


def _looked_through(fit: _Fit, lanes: _Lanes):
    """Squared errors and ends of any number of lanes after a few steps, in portions of
    one size, which is compiled once."""
    count, ends = len(lanes.rows), []
    for first in range(0, count, _AT_ONCE):
        rows = jnp.arange(first, first + _AT_ONCE) % count  # the last one is filled up
        ends.append(_side_by_side(fit, _rows_of(lanes, rows), *_COARSE))
    return jax.tree.map(lambda *x: jnp.concatenate(x)[:count], *ends)


@jit
def _side_by_side(fit: _Fit, lanes: _Lanes, solver, max_steps: int):
    return jax.vmap(functools.partial(fit, solver=solver, max_steps=max_steps))(lanes)


def _searched(fit: _Fit, typical, largest: int, width: int, starts: int, key):
    """The best laws of all sizes, refined: squared errors and lanes."""
    thin = eqx.tree_at(lambda each: each.group, fit, tuple(map(_thinned, fit.group)))
    found, grown = [], None
    for terms in range(1, largest + 1):
        key, draw_key = jax.random.split(key)
        rows = search.supports(len(fit.library), terms, grown, most=_MOST)
        lanes = _drawn(rows, typical, largest, starts, draw_key)
        squares, lanes = _looked_through(thin, lanes)
        of_support = jnp.reshape(squares, (-1, starts))
        best = jnp.argsort(jnp.min(of_support, axis=1))[:width]
        lanes = _rows_of(lanes, best * starts + jnp.argmin(of_support[best], axis=1))
        grown = lanes.rows[:, :terms]
        found.append(lanes)
    lanes = jax.tree.map(lambda *x: jnp.concatenate(x), *found)
    return _side_by_side(fit, lanes, *_FINE)


def _thinned(recording: Recording) -> Recording:
    """Fewer samples, with straight lines between them."""
    turns, _ = recording.path.turning_points()
    stride = max(1, len(recording) // (_SAMPLES * (len(turns) + 1)))
    return Recording(*(x[::stride] for x in (recording.t, recording.u, recording.w)))


def _drawn(rows, typical, most: int, starts: int, key) -> _Lanes:
    """Each support several times, with random coefficients."""
    terms = rows.shape[1]
    repeated = jnp.repeat(jnp.asarray(rows), starts, axis=0)
    padded = jnp.pad(repeated, ((0, 0), (0, most - terms)))
    used = jnp.broadcast_to(jnp.arange(most) < terms, padded.shape)
    draws = jax.random.uniform(key, padded.shape, typical.dtype, -1, 1)
    return _Lanes(padded, used, draws * typical[padded], {})


def _rows_of(lanes: _Lanes, rows) -> _Lanes:
    return jax.tree.map(lambda leaf: leaf[rows], lanes)


def _sorted(fit: _Fit, squares, lanes: _Lanes):
    """Candidates, the best first, and their lanes in that order."""
    n = sum(len(recording) for recording in fit.group)
    names, tried = fit.library.names, []
    for i in np.flatnonzero(np.isfinite(squares)).tolist():
        used = np.asarray(lanes.used[i])
        rows, values = lanes.rows[i][used], lanes.coefficients[i][used]
        terms = {names[k]: float(x) for k, x in zip(rows, values, strict=True)}
        unknowns = len(terms) + len(lanes.own)
        misfit = float(squares[i])
        criterion = information_criterion(
            misfit / n, n, unknowns, len(terms), len(names)
        )
        tried.append((Candidate(terms, (misfit / n) ** 0.5, criterion), i))
    return sorted(tried, key=lambda pair: pair[0].criterion)
