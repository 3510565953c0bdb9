"""Laws tried on recordings, until none that promises more is left."""

import itertools
import time
from collections.abc import Iterable, Iterator

import jax.numpy as jnp
import numpy as np

from . import _proposals, _trials, search
from ._progress import say
from ._proposals import Guess, Support
from ._trials import Setting, Trial
from .regression import LeastSquaresProblem


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
            tried = _trials.with_guesses(setting, tried, guesses)
            if progress:
                say(f"{len(tried)} laws refined")
            best = _trials.best(setting, tried)
            centres = [each for each in best if each.support not in centred]
            centred |= {centre.support for centre in centres}
            lists = itertools.chain.from_iterable(
                _nearby(setting, among, centre) for centre in centres
            )
            guesses = _untried(lists, tried, max(1, setting.width // 2))
    return tuple(trial for trial in tried.values() if _trials.admitted(setting, trial))


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
