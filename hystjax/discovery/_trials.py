"""Laws refined side by side, as many as are guessed: what is the same for all, and what
is made of each."""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from types import MappingProxyType
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from .._core.checks import InputError
from .._core.compiling import jit
from ..library import Kind, Library, kind
from ..models import AbstractModel, SparseModel
from ..recording import Recording
from ..refinement import LevenbergMarquardt
from ..refinement._refine import fades
from . import search
from ._knowledge import agree, fixed_part
from ._layout import NONE, Layout, refined_without
from .search import Around, Support, Trial


class Setting(NamedTuple):
    """What laws are tried on: recordings, also laid out; the candidate terms; the most
    terms of a law; how many laws of each size are tried at first; how much of a
    difference a law may keep, 0 for any; how far its output may get outside of what was
    recorded, over half of the recorded range; the model `around` a law, with which its
    output is compared; which share of residuals must be worth independent ones for
    them to be noise; which signs coefficients are to have; those of a known part, whose
    terms come first in the library; and the terms that a program has room for, where
    laws of more are tried later: one compiled program then serves both."""

    group: tuple[Recording, ...]
    layout: Layout
    library: Library
    largest: int
    width: int
    fading: float
    reach: float = math.inf
    around: Around = search.itself
    noise: float = 1.0
    signs: Mapping[str, float] = MappingProxyType({})
    known: Mapping[str, float] = MappingProxyType({})
    room: int = 0

    def own(self) -> dict[str, float]:
        """The numbers of the model around a law, by name, as `around` gives them.

        **Raises:** `InputError` where it gives no model with a law's parameters.
        """
        return own(self.around, self.library)

    def others(self) -> int:
        """How many numbers are fitted besides the coefficients of a law."""
        hidden = self.around(nothing(self.library)).hidden
        return len(self.own()) + (0 if hidden else len(self.group))


def own(around: Around, library: Library) -> dict[str, float]:
    """The numbers of the model around a law, by name, as `around` gives them.

    **Raises:** `InputError` where it gives no model with a law's parameters.
    """
    law = nothing(library)
    model = around(law)
    if not isinstance(model, AbstractModel):
        raise InputError(
            "`around` must make a model of a law, such as `models.Butterfly`; it "
            f"made {model!r}."
        )
    inside, every = law.parameters(), model.parameters()
    lost = [name for name in inside if name not in every]
    if lost:
        raise InputError(
            f"the model that `around` makes has no parameter {lost[0]!r}, though "
            "its law has: let its `parameters` and `with_parameters` pass on those "
            "of the law, by the same names, as `models.Butterfly` does."
        )
    return {name: float(x) for name, x in every.items() if name not in inside}


def nothing(library: Library) -> SparseModel:
    """The law w' = 0."""
    return SparseModel(library, jnp.zeros(len(library)), np.ones(len(library), bool))


class Effort(NamedTuple):
    """How laws are refined: the solver, its most steps, and how many side by side. One
    number of lanes for any number of laws is one compiled program."""

    solver: LevenbergMarquardt
    steps: int
    lanes: int


ENOUGH = Effort(LevenbergMarquardt(rtol=1e-6), 8, 8)  # to tell laws apart, mostly
_TURNS = 4  # of so many steps, for laws that these are not enough for
_FAR = 4.0  # times the squares of the best law of as many terms, to be given up
_GAIN = 0.99  # of the squares before, to be worth another turn


def with_guesses(
    setting: Setting, tried: dict[Support, Trial], guesses: list[Trial]
) -> dict[Support, Trial]:
    """The laws tried, and guesses refined.

    Side by side with others, laws that take long would make these wait: they go on in
    further turns, as long as they get better and are not far behind.
    """
    tried = dict(tried)
    for _ in range(_TURNS):
        slow = []
        for trial, steps in refined(setting, guesses, ENOUGH):
            before = tried.get(trial.support)
            both = [trial] if before is None else [before, trial]
            tried[trial.support] = min(both, key=partial(_rank, setting))
            gained = before is None or trial.squares < _GAIN * before.squares
            if steps == ENOUGH.steps and gained:
                slow.append(trial)
        rivals = best(setting, tried.values())
        guesses = [each for each in slow if not _behind(each, rivals)]
    return tried


def _rank(setting: Setting, trial: Trial) -> tuple[bool, float]:
    """The less, the better."""
    return not admitted(setting, trial), trial.squares


def _behind(trial: Trial, rivals: Iterable[Trial]) -> bool:
    """Whether a law of no more terms is far better."""
    size, squares = len(trial.terms), trial.squares / _FAR
    return any(r.squares < squares and len(r.terms) <= size for r in rivals)


def best(setting: Setting, tried: Iterable[Trial]) -> list[Trial]:
    """The best law of each size."""
    best: dict[int, Trial] = {}
    for trial in sorted(tried, key=lambda trial: trial.squares):
        if admitted(setting, trial):
            best.setdefault(len(trial.terms), trial)
    return list(best.values())


def admitted(setting: Setting, trial: Trial) -> bool:
    """Whether the law follows, agrees with what is known, forgets, and stays near where
    it is not known."""
    follows = math.isfinite(trial.squares) and agree(trial.terms, setting.signs)
    return follows and forgets(setting, trial) and stays(setting, trial)


def forgets(setting: Setting, trial: Trial) -> bool:
    """Whether the law fades, or has no memory, and so nothing to drift away with; of a
    hidden output it is not asked."""
    fades = not setting.fading or trial.kept is None or trial.kept < setting.fading
    return fades or _memoryless(setting, trial)


def stays(setting: Setting, trial: Trial) -> bool:
    """Whether the law stays near under inputs beyond the recorded ones."""
    return trial.beyond <= setting.reach


def _memoryless(setting: Setting, trial: Trial) -> bool:
    terms = dict(zip(setting.library.names, setting.library.terms, strict=True))
    names = (*setting.known, *trial.terms)
    return kind(terms[name] for name in names) is Kind.MEMORYLESS


def refined(
    setting: Setting, guesses: list[Trial], effort: Effort
) -> Iterator[tuple[Trial, int]]:
    """Laws refined, and in how many steps."""
    for guess, end, steps in _ends(setting, [(g, NONE) for g in guesses], effort):
        yield _trial(guess, end), int(steps)


def left_out(setting: Setting, trials: Sequence[Trial]) -> list[Trial]:
    """Laws with their errors on each block, of a refinement without that block."""
    count = setting.layout.count
    each = [(trial, block) for trial in trials for block in range(count)]
    errors = [float(end.unseen) for _, end, _ in _ends(setting, each, ENOUGH)]
    return [
        replace(trial, blocks=tuple(errors[i * count : (i + 1) * count]))
        for i, trial in enumerate(trials)
    ]


def _ends(
    setting: Setting, guesses: Sequence[tuple[Trial, int]], effort: Effort
) -> Iterator[tuple[Trial, "_End", int]]:
    """Guesses, each with the block that is left out, where their refinements end, and
    in how many steps; in portions of one size."""
    known = fixed_part(setting.library, setting.known)
    fixed = setting.layout, setting.library, known, setting.around, setting.fading
    for first in range(0, len(guesses), effort.lanes):
        portion = guesses[first : first + effort.lanes]
        filled = [*portion, *[portion[0]] * (effort.lanes - len(portion))]
        lanes = _lanes(setting, filled)
        ends = _refined(*fixed, lanes, effort.solver, effort.steps)
        ends, steps = jax.device_get(ends)
        for i, (guess, _) in enumerate(portion):
            yield guess, jax.tree.map(lambda x, i=i: x[i], ends), steps[i]


class _Lanes(NamedTuple):
    """Where the refinements of m laws begin, as arrays: up to s terms by row of the
    library, which of these rows are used, their coefficients, the numbers of the models
    around, and the first outputs; and the block that is left out."""

    rows: Int[Array, "m s"]
    used: Bool[Array, "m s"]
    coefficients: Float[Array, "m s"]
    own: dict[str, Float[Array, " m"]]
    starts: Float[Array, "m r"]
    left_out: Int[Array, " m"]


class _End(NamedTuple):
    """Where the refinement of a law ended: what a `Trial` holds by the same names, as
    arrays; and the root mean square error on the block that was left out."""

    coefficients: Float[Array, " s"]
    own: dict[str, Float[Array, ""]]
    starts: Float[Array, " r"]
    squares: Float[Array, ""]
    rmse: Float[Array, ""]
    kept: Float[Array, ""] | None
    independent: Float[Array, ""]
    beyond: Float[Array, ""]
    unseen: Float[Array, ""]


def _trial(guess: Trial, end: _End) -> Trial:
    found = jax.tree.map(lambda leaf: leaf.tolist(), end)
    terms = dict(zip(guess.terms, found.coefficients, strict=False))  # some unused
    return Trial(
        terms,
        found.rmse,
        kept=found.kept,
        own=found.own,
        starts=tuple(found.starts),
        squares=found.squares,
        independent=found.independent,
        beyond=found.beyond,
    )


def _lanes(setting: Setting, each: Sequence[tuple[Trial, int]]) -> _Lanes:
    """Laws of fewer terms than others are filled up with terms that are not used."""
    guesses = [guess for guess, _ in each]
    places = {name: row for row, name in enumerate(setting.library.names)}
    sizes = np.array([len(guess.terms) for guess in guesses])
    used = np.arange(max(setting.room, setting.largest)) < sizes[:, None]
    rows, coefficients = np.zeros(used.shape, int), np.zeros(used.shape)
    rows[used] = [places[name] for guess in guesses for name in guess.terms]
    coefficients[used] = [x for guess in guesses for x in guess.terms.values()]
    own = {
        name: jnp.array([guess.own.get(name, x) for guess in guesses])
        for name, x in setting.own().items()
    }
    measured = np.asarray(setting.layout.samples.w[:, 0]).tolist()
    starts = jnp.array([guess.starts or measured for guess in guesses])
    blocks = jnp.array([block for _, block in each])
    return _Lanes(
        jnp.asarray(rows),
        jnp.asarray(used),
        jnp.asarray(coefficients),
        own,
        starts,
        blocks,
    )


@jit
def _refined(
    layout: Layout,
    library: Library,
    known: Float[Array, " k"] | None,
    around: Around,
    fading: float,
    lanes: _Lanes,
    solver: LevenbergMarquardt,
    max_steps: int,
) -> tuple[_End, Int[Array, " m"]]:
    """Where the refinements of a batch of laws end, and in how many steps."""
    samples = layout.samples
    scored = samples.weight > 0

    def fit(lane: _Lanes):
        terms = lane.rows, lane.used, tuple(lane.coefficients)
        law = search.Choice(library, *terms, known)
        model = around(law).with_parameters(lane.own)
        fading_law = fades(model)
        objective, end, run, out = refined_without(
            layout,
            model,
            lane.left_out,
            lane.starts,
            solver,
            max_steps,
            fading=fading if fading_law else 0.0,
        )
        outputs = run.outputs
        residuals = jnp.where(scored, outputs - samples.w, 0.0)
        weighted = jnp.sqrt(samples.weight) * residuals
        squares = jnp.sum(weighted**2)
        squares = jnp.where(jnp.isfinite(squares), squares, jnp.inf)
        kept = None
        if fading_law:
            kept = jnp.exp(jnp.max(objective.gains(end.unknowns, run)))
        share = search.effective_samples(weighted, scored) / jnp.sum(scored)
        rmse = jnp.sqrt(jnp.sum(residuals**2) / jnp.sum(scored))
        names = objective.parameters.names
        values = dict(zip(names, end.unknowns.values, strict=True))
        coefficients = jnp.stack([values.pop(name) for name in law.parameters()])
        unseen = _root_mean_square(weighted, jnp.where(out, samples.weight, 0.0))
        found = _End(
            coefficients,
            values,
            outputs[:, 0],
            squares,
            rmse,
            kept,
            share,
            layout.distance(objective, end.unknowns),
            unseen,
        )
        return found, end.num_steps

    return jax.vmap(fit)(lanes)


def _root_mean_square(weighted, weight) -> Float[Array, ""]:
    """Of residuals by the root of their weight, where they have some now; 0 where none
    has."""
    total = jnp.sum(weight)
    squares = jnp.sum(jnp.where(weight > 0, weighted**2, 0.0))
    mean = squares / jnp.where(total > 0, total, 1.0)
    return jnp.sqrt(jnp.where(jnp.isfinite(mean), mean, jnp.inf))
