"""Laws worth trying: by linear least squares, of equations or of the free run about a
law; or from random coefficients, where there is nothing to regress."""

import itertools
import time
from collections.abc import Iterable, Iterator
from typing import NamedTuple, TypeAlias

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, PRNGKeyArray

from .._core import checks
from .._core.errors import InputError
from .._core.jit import jit
from .._core.progress import Progress
from ..library import Library
from ..recording import Recording
from ..refinement import LevenbergMarquardt
from ..refinement._steps import steps
from ..regression import LeastSquaresProblem, compress
from . import search
from ._knowledge import agree, fixed_part
from ._layout import layout
from ._seen import tells
from ._trials import Effort, Setting, nothing, refined
from .search import Around, Support, Trial

_LOW = 2  # degree of the terms that are tried first
_NEARBY = 20_000  # supports looked at one by one around a law
_BEAM = 300  # supports that are grown around a law
_ABOVE = 2  # terms by which the proposals exceed a law

Rows: TypeAlias = Int[np.ndarray, " c"]


class Stage(NamedTuple):
    """A part of a search: the rows of the library that take part, and lists of guesses,
    in each the best first."""

    among: Rows
    guesses: tuple[tuple[Trial, ...], ...]


def nested(library: Library) -> Iterator[Rows]:
    """The terms of degree two and less, and then those of each further degree too."""
    degrees = np.array([max(_LOW, term.degree) for term in library.terms])
    for degree in np.unique(degrees):
        yield np.flatnonzero(degrees <= degree)


def regressed(setting: Setting, problem: LeastSquaresProblem) -> tuple[Stage, ...]:
    """The best laws of each size on a factored problem of all terms."""
    names, stages = setting.library.names, []
    for every in nested(setting.library):
        among = every[every >= len(setting.known)]
        part, most, count = _only(problem, among), setting.largest, setting.width
        rankings = search.rankings(part, most, count)
        lists = (tuple(_ranked(names, ranking, among)) for ranking in rankings)
        stages.append(Stage(among, tuple(lists)))
    return tuple(stages)


def nearby(setting: Setting, among: Rows, centre: Trial) -> Iterator[Iterator[Trial]]:
    """What promises to be better than a law, by the free runs close to it: laws with
    one term more; then those of each size near its own; each time the best first."""
    library, names = setting.library, setting.library.names
    samples = setting.layout.samples
    dtype = samples.w.dtype
    terms = {**setting.known, **centre.terms}
    problem = search.output_error(
        samples,
        library,
        jnp.asarray([terms.get(name, 0.0) for name in names], dtype),
        jnp.asarray(centre.starts, dtype),
        around=setting.around,
        own={name: jnp.asarray(x, dtype) for name, x in centre.own.items()},
    )
    known = fixed_part(library, setting.known)
    problem = problem if known is None else problem.less(known)
    part, size = _only(problem, among), len(centre.terms)
    if size < setting.largest:
        inside = [names.index(name) for name in centre.terms]
        more = search.extensions(part, tuple(np.searchsorted(among, inside).tolist()))
        yield (_guess(names, among[list(r)], x, centre.own) for r, x in more)
    sizes = min(size + _ABOVE, setting.largest)
    for ranking in search.rankings(part, sizes, _BEAM, _BEAM, _NEARBY):
        if ranking.rows.shape[1] >= size - 1:
            yield _ranked(names, ranking, among, centre.own)


def untried(
    setting: Setting, lists: Iterable[Iterable[Trial]], tried, each: int
) -> list[Trial]:
    """From each list so many of the first that were not tried, and have the signs that
    they are to have."""
    seen, chosen = set(tried), []
    for guesses in lists:
        fresh = (
            guess
            for guess in guesses
            if guess.support not in seen and agree(guess.terms, setting.signs)
        )
        new = [*itertools.islice(fresh, each)]
        seen |= {guess.support for guess in new}
        chosen += new
    return chosen


def _only(problem: LeastSquaresProblem, among: Rows) -> LeastSquaresProblem:
    return problem if len(among) == len(problem.target) else problem.columns(among)


def _ranked(names, ranking: search.Ranking, among: Rows, own=None) -> Iterator[Trial]:
    rows, values = among[np.asarray(ranking.rows)], np.asarray(ranking.coefficients)
    for support, coefficients in zip(rows, values, strict=True):
        yield _guess(names, support, coefficients, own)


def _guess(names: Support, rows, coefficients, own=None) -> Trial:
    places, values = rows.tolist(), coefficients.tolist()
    terms = {names[row]: x for row, x in zip(places, values, strict=True)}
    return Trial(terms, own=own or {})


# ------------------------------------------------------------------- a hidden output

_MOST = 5000  # supports of a size that are all tried
_GROWN = 12  # supports of a size that are grown where there are more
_SAMPLES = 20  # between turning points, enough to tell hopeless laws
_COARSE = Effort(LevenbergMarquardt(rtol=1e-4), 15, 256)


class Draws(NamedTuple):
    """How laws are drawn: about the largest output of a law, how often each is tried,
    and a key."""

    size: float
    starts: int
    key: PRNGKeyArray


def draws(
    around: Around | None, library: Library, size, starts: int, key
) -> Draws | None:
    """How the first laws are drawn, if they are.

    **Raises:** `InputError` for a size or a key that nothing is drawn with, and where
    they are missing.
    """
    if around is None:
        if size is not None or key is not None:
            raise InputError(
                "`size` and `key` are for random laws, and without `around` none are "
                "drawn: leave them out, or give the model that the law is part of."
            )
        return None
    if not callable(around):
        raise InputError(
            "`around` must be a function that makes a model of a law, such as "
            f"`models.Butterfly`; got {around!r}."
        )
    if size is None and key is None and tells(around(nothing(library))):
        return None
    if size is None or key is None:
        raise InputError(
            "with this `around` the recorded output does not tell that of the law, and "
            "the first laws are drawn at random: give `size`, about the largest output "
            "of the law, and a `key`, such as `jax.random.key(0)`."
        )
    checks.positive("size", size)
    return Draws(size, starts, key)


@jit
def blind(
    group: tuple[Recording, ...], library: Library, draws: Draws
) -> LeastSquaresProblem:
    """The terms along an output of which nothing is known but its size, without a
    target: what is equal there the inputs make equal."""
    _, key = jax.random.split(draws.key)
    u, du = _inputs(group)
    hidden = draws.size * jax.random.uniform(key, u.shape, u.dtype, -1, 1)
    memory = [library.signals(recording.path) for recording in group]
    memory = jax.tree.map(lambda *each: jnp.concatenate(each), *memory)
    return compress(library(hidden, u, du, memory), jnp.zeros_like(u))


def _inputs(group) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
    """The input and its derivative at all samples."""
    u, du = zip(*(recording.path.samples() for recording in group), strict=True)
    return jnp.concatenate(u), jnp.concatenate(du)


def random(
    setting: Setting,
    problem: LeastSquaresProblem,
    draws: Draws,
    end: float,
    progress: bool,
) -> tuple[Stage, ...]:
    """The best laws of each size out of all, or where these are too many of those that
    have a term more than one of the best of the size before.

    Each is fitted from random coefficients several times, for a few steps and to
    thinned recordings, the cheapest way to see which supports are hopeless.

    **Arguments:** the `blind` problem of all terms; how laws are drawn; the time, of a
    monotonic clock, from which no more are; and whether to say how far it is.
    """
    u, du = _inputs(setting.group)
    # Each term alone would then move the law's output as fast as the input moves.
    rate = draws.size / jnp.std(u) * jnp.sqrt(jnp.mean(du**2))
    typical, starts = np.asarray(rate / problem.norms()[0]), draws.starts
    key, _ = jax.random.split(draws.key)
    thin = tuple(map(_thinned, setting.group))
    coarse = setting._replace(layout=layout(thin, None, steps(thin, None), False))
    names = setting.library.names
    stages = []
    for among in nested(setting.library):
        lists, grown = [], None
        for size in range(1, min(setting.largest, len(among)) + 1):
            if time.monotonic() >= end:
                break
            key, draw_key = jax.random.split(key)
            rows = among[search.supports(len(among), size, grown, _MOST)]
            rows = np.repeat(rows, starts, axis=0)
            shape = len(rows), setting.largest
            drawn = jax.random.uniform(draw_key, shape, typical.dtype, -1, 1)
            values = np.asarray(drawn)[:, :size] * typical[rows]
            guesses = [_guess(names, *row) for row in zip(rows, values, strict=True)]
            named, fits = f"random laws of {size} terms", []
            with Progress(named, len(guesses), asked=progress) as shown:
                for fit, _ in refined(coarse, guesses, _COARSE):
                    fits.append(fit)
                    shown.show(len(fits))
            tries = [fits[i : i + starts] for i in range(0, len(fits), starts)]
            best = sorted((min(each, key=_squares) for each in tries), key=_squares)
            places = [[*map(names.index, fit.terms)] for fit in best[:_GROWN]]
            grown = np.searchsorted(among, np.array(places))
            lists.append(tuple(best[: setting.width]))
        stages.append(Stage(among, tuple(lists)))
    return tuple(stages)


def _squares(trial: Trial) -> float:
    return trial.squares


def _thinned(recording: Recording) -> Recording:
    """Fewer samples, with straight lines between them."""
    turns, _ = recording.path.turning_points()
    stride = max(1, len(recording) // (_SAMPLES * (len(turns) + 1)))
    return Recording(*(x[::stride] for x in (recording.t, recording.u, recording.w)))
