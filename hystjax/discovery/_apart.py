"""How far laws that a record hardly tells apart go apart where it has not been."""

import math
from collections.abc import Iterator, Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._core.jit import jit
from ..library import Library
from ..models import SparseModel
from ..refinement import Objective, Squares, Unknowns, parameters
from ..regression import Alias
from . import search
from ._layout import Layout
from ._trials import Setting
from .search import Trial

_EVIDENCE = 6.0  # of criteria, below which it is not strong
_AS_WELL = 1.1  # times the squares, to follow as well
_AT_ONCE = 8  # laws, so that one program serves any number
_FAR = 0.05  # of the output's range, from which on it is said


def apart(
    setting: Setting,
    library: Library,
    trials: Sequence[Trial],
    aliases: Sequence[Alias],
) -> float:
    """The largest root mean square distance, over the range of the recorded output, of
    the chosen law from one that follows the recordings as well, under inputs 1.5 times
    as large, three times as fast or half as fast; 0 where there is no other.

    Others are laws of hardly less evidence, or hardly worse on blocks; and such as have
    a term in another's place that the excitation does not tell from it.

    **Source:** Kass and Raftery (1995), doi 10.1080/01621459.1995.10476572, for what is
    hardly less evidence.
    """
    if setting.layout.outside is None or not trials:
        return 0.0
    chosen = {**setting.known, **trials[0].terms}
    others = [{**setting.known, **trial.terms} for trial in _rivals(trials)]
    others += _under_other_names(chosen, aliases)
    if not others:
        return 0.0
    names, starts = library.names, jnp.array(trials[0].starts)
    rows = np.array([[law.get(n, 0.0) for n in names] for law in [chosen, *others]])
    rows = np.concatenate([rows, np.tile(rows[:1], (-len(rows) % _AT_ONCE, 1))])
    portions = jnp.asarray(rows.reshape(-1, _AT_ONCE, len(names)))
    ran = [jax.device_get(_ran(setting.layout, library, p, starts)) for p in portions]
    squares, reached, outputs = (
        np.concatenate(each) for each in zip(*ran, strict=True)
    )
    as_well = (squares <= _AS_WELL * squares[0]) & (reached <= setting.reach)
    return max(_distances(setting.layout, outputs[as_well], outputs[0]), default=0.0)


def in_words(distance: float) -> str:
    """What is said of it, where it is much."""
    if distance < _FAR:
        return ""
    return (
        "Laws that follow as well differ from it by up to "
        f"{100 * distance:.2g} % of the output's range under larger, faster or slower "
        "inputs: do not use it there, or record an input of several amplitudes and "
        "frequencies."
    )


def _rivals(trials: Sequence[Trial]) -> list[Trial]:
    """Laws, after the chosen one, that are not clearly worse."""
    if trials[0].blocks:
        return list(search.alike(trials))
    least = min(trial.criterion for trial in trials)
    return [each for each in trials[1:] if each.criterion < least + _EVIDENCE]


def _under_other_names(
    law: dict[str, float], aliases: Sequence[Alias]
) -> Iterator[dict[str, float]]:
    """Laws that are this one as far as the excitation tells, of as many terms."""
    for alias in aliases:
        mix = alias.combination
        if not mix or not law.keys() >= mix.keys():
            continue
        for place, share in mix.items():
            amount = law[place] / share
            other = {name: x - amount * mix.get(name, 0.0) for name, x in law.items()}
            del other[place]
            yield {**other, alias.term: amount}


@jit
def _ran(
    layout: Layout,
    library: Library,
    coefficients: Float[Array, "m k"],
    starts: Float[Array, " r"],
) -> tuple[Float[Array, " m"], Float[Array, " m"], Float[Array, "m c r n"]]:
    """Of laws the squares, how far they get beyond the recorded inputs, and their
    outputs there."""
    everything, samples = np.ones(len(library), bool), layout.samples

    def run(row):
        law = parameters(SparseModel(library, row, everything), (), {}, {})
        objective = Objective(law, samples, Squares(), 1, 0.0, True)
        unknowns = Unknowns(law.values(), starts[:, None, None])
        missed = objective.run(unknowns).outputs - samples.w
        squares = jnp.sum(jnp.where(samples.weight > 0, samples.weight * missed**2, 0))
        outputs = layout.beyond(objective, unknowns)
        return squares, layout.from_middle(outputs), outputs[:-1]

    return jax.vmap(run)(coefficients)


def _distances(layout: Layout, outputs, chosen) -> Iterator[float]:
    """Of each from the chosen law, over the range, under each of the inputs."""
    samples = layout.samples
    known = np.asarray(samples.weight) > 0
    w = np.where(known, np.asarray(samples.w), np.nan)
    span = np.nanmax(w, axis=1) - np.nanmin(w, axis=1)
    for run in outputs:
        for copy, mine in zip(run, chosen, strict=True):
            shares = ((copy - mine) / span[:, None])[known]
            yield math.sqrt(float(np.mean(shares**2)))
