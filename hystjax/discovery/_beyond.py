"""How far laws go apart under inputs beyond the recorded ones, of which no output is
known."""

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._core.compiling import jit
from ..library import Library
from ..models import SparseModel
from ..refinement import Objective, Squares, Unknowns, parameters
from ..regression import Alias
from . import search
from ._layout import Layout
from ._setting import Setting
from .search import Trial

_EVIDENCE = 6.0  # of criteria, below which it is not strong
_AS_WELL = 1.1  # times the squares, to follow as well
_AT_ONCE = 8  # laws, so that one program serves any number
_TOLD = 0.05  # of the output's range, from which on it is said


def told(setting: Setting, near: Sequence[Trial]) -> bool:
    """Whether runs tell which of some laws is the middle one: of two neither is."""
    judged = all(trial.blocks and trial.terms for trial in near)
    return setting.layout.outside is not None and judged and len(near) > 2


def from_the_others(
    setting: Setting, library: Library, near: Sequence[Trial]
) -> list[float]:
    """How far each of some laws goes from the others, summed over these: root mean
    square distances, over the range of the recorded output, under inputs 1.5 times as
    large, three times as fast and half as fast. None goes anywhere where that tells
    nothing.

    What one law does there that others as good do not do the record has not told it.
    The least sum is that of the medoid.

    **Source:** Kaufman and Rousseeuw (1990), Finding Groups in Data, section 2.4, doi
    10.1002/9780470316801, for the medoid.
    """
    if not told(setting, near):
        return [0.0] * len(near)
    laws = [_numbers(setting, each) for each in near]
    outputs = _runs(setting, library, laws, near[0]).outputs
    return [sum(_far(each - other) for other in outputs) for each in outputs]


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
    chosen, *rivals = (
        _numbers(setting, each) for each in (trials[0], *_rivals(trials))
    )
    others = [*rivals, *_under_other_names(chosen, aliases)]
    if not others:
        return 0.0
    ran = _runs(setting, library, [chosen, *others], trials[0])
    as_well = ran.squares <= _AS_WELL * ran.squares[0]
    stay = ran.reached <= setting.reach
    differences = ran.outputs[as_well & stay] - ran.outputs[0]
    return max((_far(each) for law in differences for each in law), default=0.0)


def in_words(distance: float) -> str:
    """What is said of it, where it is much."""
    if distance < _TOLD:
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


def _numbers(setting: Setting, trial: Trial) -> dict[str, float]:
    return {**setting.known, **trial.terms, **trial.numbers}


class _Ran(NamedTuple):
    """Of m laws the squares, how far they get beyond the recorded inputs, and their
    outputs there over the range of the recorded ones, for each of c inputs."""

    squares: Float[np.ndarray, " m"]
    reached: Float[np.ndarray, " m"]
    outputs: Float[np.ndarray, "m c s"]


def _runs(
    setting: Setting,
    library: Library,
    laws: Sequence[dict[str, float]],
    first: Trial,
) -> _Ran:
    """Free runs of laws, by their coefficients and numbers, from where the first law
    begins: in portions of one size."""
    names = (*library.names, *library.numbers)
    grid = {name: float(number) for name, number in library.numbers.items()}
    numbers = [grid | law for law in laws]
    rows = np.array([[law.get(name, 0.0) for name in names] for law in numbers])
    rows = np.concatenate([rows, np.tile(rows[:1], (-len(rows) % _AT_ONCE, 1))])
    portions = jnp.asarray(rows.reshape(-1, _AT_ONCE, len(names)))
    layout, starts = setting.layout, jnp.array(first.starts)
    ran = [jax.device_get(_ran(layout, library, p, starts)) for p in portions]
    squares, reached, outputs = (
        np.concatenate(each)[: len(laws)] for each in zip(*ran, strict=True)
    )
    known = np.asarray(layout.samples.weight) > 0
    w = np.where(known, np.asarray(layout.samples.w), np.nan)
    span = np.nanmax(w, axis=1) - np.nanmin(w, axis=1)
    return _Ran(squares, reached, (outputs / span[:, None])[:, :, known])


@jit
def _ran(
    layout: Layout,
    library: Library,
    rows: Float[Array, "m _n"],
    starts: Float[Array, " r"],
) -> tuple[Float[Array, " m"], Float[Array, " m"], Float[Array, "m c r n"]]:
    """Of laws the squares, how far they get beyond the recorded inputs, and their
    outputs there; each by its coefficients and the library's numbers."""
    k, samples = len(library), layout.samples

    def run(row):
        moved = library.with_numbers(dict(zip(library.numbers, row[k:], strict=True)))
        law = SparseModel(moved, row[:k], np.ones(k, bool))
        law = parameters(law, (), {}, {})
        objective = Objective(law, samples, Squares(), 1, 0.0, "state")
        unknowns = Unknowns(law.values(), starts[:, None, None], starts)
        missed = objective.run(unknowns).outputs - samples.w
        squares = jnp.sum(jnp.where(samples.weight > 0, samples.weight * missed**2, 0))
        outputs = layout.beyond(objective, unknowns)
        return squares, layout.from_middle(outputs), outputs[:-1]

    return jax.vmap(run)(rows)


def _far(distances: Float[np.ndarray, "..."]) -> float:
    """Their root mean square; infinite where one is not finite."""
    far = math.sqrt(float(np.mean(distances**2)))
    return far if math.isfinite(far) else math.inf
