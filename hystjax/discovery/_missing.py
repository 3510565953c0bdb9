"""What a law that was found lacks: what one term more would bring, where there was no
room for it, and what of the input its residuals still remember."""

import math

import numpy as np
from jaxtyping import Float

from ..least_squares import solution
from ..library import Lag, Library, Play
from ..recording import Recording
from ..refinement import Refined
from . import _explore, search
from ._setting import Setting, agree
from .search import Trial

_RADII = (0.02, 0.05, 0.1, 0.2, 0.3, 0.42)  # of plays, over the range of the input
_TIMES = 5  # of lags, from two samples to
_LONGEST = 0.2  # of the duration of a recording
_TELLS = 0.3  # of the squares on blocks left out, from which on something is said


def missing(setting: Setting, law: Trial, refined: Refined) -> list[str]:
    """What a law lacks that leaves more than noise, as sentences."""
    said = []
    if len(law.terms) == setting.largest < len(setting.candidates):
        said.append(
            f"It has as many terms as were allowed, `largest={setting.largest}`: by "
            f"the free runs close to it {_next_term(setting, law)}"
        )
    if setting.recorded and setting.layout.count > 1:
        said.append(_memory_left(setting, refined))
    return [each for each in said if each]


def _next_term(setting: Setting, law: Trial) -> str:
    """By how much one more term would lessen the error of a law, by the free runs close
    to it, as a sentence."""
    names = setting.library.names
    rows = [i for i, name in enumerate(names) if name not in setting.known]
    close = _explore.close_to(setting, np.array(rows), law)
    problem = close.problem
    own = tuple(rows.index(names.index(name)) for name in law.terms)
    triangle, target = np.asarray(problem.triangle), np.asarray(problem.target)

    def left(places, values):
        return math.hypot(
            np.linalg.norm(triangle[:, places] @ values - target),
            float(problem.remainder),
        )

    before = left(own, solution(triangle[:, own], target))
    for places, values in search.extensions(problem, own):
        terms = {names[rows[i]]: x for i, x in zip(places, values, strict=True)}
        if not agree(terms, setting.signs):
            continue
        (more,) = terms.keys() - law.terms.keys()
        gain = 1 - left(places, values) / before
        if gain >= 0.01:
            return f"one more, {more}, promises about {gain:.0%} less error."
        break
    return "none of the others promises 1% less error."


def _memory_left(setting: Setting, refined: Refined) -> str:
    """What of the input follows the residuals of a law on blocks that it is not fitted
    to, and which terms and families hold that, as a sentence; empty where nothing does.

    Residuals are regressed on a cubic of the input, and beside it on plays, whose
    memory is of where the input went, or on lags, whose memory fades.
    """
    group = setting.group
    reach = max(float(np.ptp(np.asarray(each.u))) for each in group)
    middle = float(np.mean([np.mean(np.asarray(each.u)) for each in group]))
    curve = [_curve((np.asarray(each.u) - middle) / reach) for each in group]
    tried = {"plays": Play(np.multiply(_RADII, reach))}
    if all(each.clocked for each in group):
        steps = [float(np.median(np.diff(np.asarray(each.t)))) for each in group]
        lengths = [float(each.t[-1] - each.t[0]) for each in group]
        longest = _LONGEST * max(lengths)
        shortest = min(2 * min(steps), longest / 2)
        tried["lags"] = Lag(np.geomspace(shortest, longest, _TIMES))
    without = _on_blocks(setting, refined, curve)
    shares = {}
    for what, library in tried.items():
        pairs = zip(curve, group, strict=True)
        columns = [np.column_stack([x, _signals(library, each)]) for x, each in pairs]
        left = _on_blocks(setting, refined, columns)
        shares[what] = 1 - left / without if without else 0.0
    best = max(shares, key=shares.__getitem__)
    if not shares[best] >= _TELLS:
        return ""
    follow = f"{best.capitalize()} of the input follow {shares[best]:.0%}"
    return f"{follow} of what it leaves: {_HOLD[best]}"


_HOLD = {
    "plays": (
        "try terms of `library.Play(radii)`, or the families `plays` and `Everett` of "
        "`compare`."
    ),
    "lags": (
        "try terms of `library.Lag(times)`, or the family `plays and creep` of "
        "`compare`."
    ),
}


def _curve(u: np.ndarray) -> np.ndarray:
    return u[:, None] ** np.arange(4)


def _signals(library: Library, record: Recording) -> Float[np.ndarray, "n k"]:
    u, du = record.path.samples()
    return np.asarray(library(record.w, u, du, library.signals(record.path)))


def _on_blocks(setting: Setting, refined: Refined, columns: list[np.ndarray]) -> float:
    """Squares that columns along each recording leave of residuals on each block, their
    coefficients fitted to all others."""
    layout = setting.layout
    used = np.asarray(layout.samples.weight) > 0
    blocks = np.asarray(layout.blocks)
    residuals = np.asarray(refined.residuals)
    kept = [used[i, : len(x)] for i, x in enumerate(columns)]
    rows = np.concatenate([x[k] for x, k in zip(columns, kept, strict=True)])
    block, target = (
        np.concatenate([every[i, : len(k)][k] for i, k in enumerate(kept)])
        for every in (blocks, residuals)
    )
    total = 0.0
    for each in range(layout.count):
        out = block == each
        values = solution(rows[~out], target[~out])
        total += float(np.sum((target[out] - rows[out] @ values) ** 2))
    return total
