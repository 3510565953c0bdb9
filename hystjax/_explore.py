"""Laws tried on recordings, until none that promises more is left."""

import itertools
import math
import time
from collections.abc import Iterable, Iterator
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from . import _proposals, search
from ._progress import say
from ._proposals import Guess, Support
from ._recording import Recording
from ._refine import refine
from .library import Kind, Library, kind
from .refinement import LevenbergMarquardt, Samples
from .regression import LeastSquaresProblem

_ENOUGH = LevenbergMarquardt(rtol=1e-6)  # of the loss: to tell laws apart
_STEPS = 30
_LANES = 24  # laws side by side: one compiled program for all


class Setting(NamedTuple):
    """What laws are tried on: recordings, also laid out as samples; the candidate
    terms; the most terms of a law; how many laws of each size are tried at first; and
    how much of a difference a law may keep, 0 for any."""

    group: tuple[Recording, ...]
    samples: Samples
    library: Library
    largest: int
    width: int
    fading: bool | float

    @property
    def weights(self) -> list[Float[Array, " _n"]]:
        """Of the samples of each recording."""
        rows = zip(self.samples.weight, self.group, strict=True)
        return [row[: len(recording)] for row, recording in rows]


class Trial(NamedTuple):
    """A refined law: its terms by row of the library, their coefficients, the first
    outputs, the weighted sum of squared errors, how much of a difference in these is
    kept to the end, which share of its residuals is independent, and their root mean
    square."""

    support: Support
    coefficients: tuple[float, ...]
    starts: tuple[float, ...]
    squares: float
    kept: float
    independent: float
    rmse: float


def explore(
    setting: Setting, weak: LeastSquaresProblem, end: float, progress: bool
) -> tuple[Trial, ...]:
    """Refine the laws that the weak form ranks best, then around the best of each size
    those that the linearised free run ranks best, until no size has a new best.

    At first with the terms of low degree, of which so few are that little is missed;
    what they lead to is where the search among all terms goes on.

    **Arguments:** the factored weak form; the time, of a monotonic clock, from which no
    more are tried; and whether to say how far it is.
    """
    tried: dict[Support, Trial] = {}
    for among in _proposals.nested(setting.library):
        centred: set[Support] = set()
        lists = _proposals.best(weak, among, setting.largest, setting.width)
        guesses = _untried(lists, tried, setting.width)
        while guesses and time.monotonic() < end:
            for trial in _trials(setting, guesses):
                tried[trial.support] = trial
            if progress:
                say(f"{len(tried)} laws refined")
            centres = [c for c in _best(setting, tried) if c.support not in centred]
            centred |= {centre.support for centre in centres}
            lists = itertools.chain.from_iterable(
                _nearby(setting, among, centre) for centre in centres
            )
            guesses = _untried(lists, tried, max(1, setting.width // 2))
    return tuple(trial for trial in tried.values() if _admitted(setting, trial))


def _untried(lists: Iterable[Iterator[Guess]], tried, each: int) -> list[Guess]:
    """From each list so many of the first that were not tried."""
    seen, chosen = set(tried), []
    for guesses in lists:
        new = [*itertools.islice((g for g in guesses if g[0] not in seen), each)]
        seen |= {support for support, _ in new}
        chosen += new
    return chosen


def _nearby(setting: Setting, among, centre: Trial) -> Iterator[Iterator[Guess]]:
    """What promises to be better than a law, by the free runs close to it."""
    coefficients = np.zeros(len(setting.library))
    coefficients[list(centre.support)] = centre.coefficients
    dtype = setting.samples.w.dtype
    problem = search.output_error(
        setting.samples,
        setting.library,
        jnp.asarray(coefficients, dtype),
        jnp.asarray(centre.starts, dtype),
    )
    return _proposals.around(problem, among, centre.support, setting.largest)


def _best(setting: Setting, tried: dict[Support, Trial]) -> list[Trial]:
    """The best law of each size."""
    best: dict[int, Trial] = {}
    for trial in sorted(tried.values(), key=lambda trial: trial.squares):
        if _admitted(setting, trial):
            best.setdefault(len(trial.support), trial)
    return list(best.values())


def _admitted(setting: Setting, trial: Trial) -> bool:
    """Whether the law fades, or has no memory, and so nothing to drift away with."""
    fades = not setting.fading or trial.kept < setting.fading
    terms = (setting.library.terms[row] for row in trial.support)
    admitted = fades or kind(terms) is Kind.MEMORYLESS
    return math.isfinite(trial.squares) and admitted


def _trials(setting: Setting, guesses: list[Guess]) -> Iterator[Trial]:
    """Refine laws, in portions of one size, which is compiled once."""
    for first in range(0, len(guesses), _LANES):
        portion = guesses[first : first + _LANES]
        filled = portion + portion[:1] * (_LANES - len(portion))
        rows, used, coefficients = _padded(filled, setting.largest)
        ends = jax.device_get(_refined(setting, rows, used, coefficients))
        for i, (support, _) in enumerate(portion):
            end = jax.tree.map(lambda leaf, i=i: leaf[i], ends)
            yield _trial(support, end)


def _trial(support: Support, end) -> Trial:
    coefficients, starts, *numbers = end
    values = tuple(coefficients[: len(support)].tolist())
    return Trial(support, values, tuple(starts.tolist()), *map(float, numbers))


def _padded(guesses: Iterable[Guess], largest: int):
    """Rows, which of them are used, and coefficients, one law a line."""
    supports, values = zip(*guesses, strict=True)
    sizes = np.array([len(support) for support in supports])
    used = np.arange(largest) < sizes[:, None]

    def filled(lines, dtype):
        whole = np.zeros(used.shape, dtype)
        whole[used] = np.concatenate(lines)
        return whole

    return filled(supports, int), used, filled(values, float)


@eqx.filter_jit
def _refined(
    setting: Setting,
    rows: Int[Array | np.ndarray, "m s"],
    used,
    coefficients: Float[Array | np.ndarray, "m s"],
):
    """For each law of a batch what a `Trial` holds, but for the support."""
    samples = setting.samples

    def fit(row, takes_part, first):
        start = search.Choice(setting.library, row, takes_part, tuple(first))
        solution = refine(
            start,
            setting.group,
            weights=setting.weights,
            fading=setting.fading,
            solver=_ENOUGH,
            max_steps=_STEPS,
            throw=False,
        )
        stats, used = solution.stats, samples.weight > 0
        weighted = jnp.sqrt(samples.weight) * stats["residuals"]
        squares = jnp.sum(weighted**2)
        squares = jnp.where(jnp.isfinite(squares), squares, jnp.inf)
        values = jnp.stack(list(solution.value.parameters().values()))
        kept = jnp.exp(jnp.max(stats["fading"].gain))
        share = search.effective_samples(weighted, used) / jnp.sum(used)
        rmse = jnp.sqrt(jnp.sum(stats["residuals"] ** 2) / jnp.sum(used))
        return values, stats["w0"], squares, kept, share, rmse

    return jax.vmap(fit)(rows, used, coefficients)
