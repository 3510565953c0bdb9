"""Laws refined side by side, as many as are guessed: what is the same for all, and what
is made of each."""

import math
from collections.abc import Iterable, Iterator
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from .._core.errors import InputError
from .._core.jit import jit
from ..library import Kind, Library, kind
from ..models import AbstractModel, SparseModel
from ..recording import Recording
from ..refinement import (
    LevenbergMarquardt,
    Objective,
    Samples,
    Squares,
    first_unknowns,
    minimise,
    parameters,
)
from ..refinement._refine import fades
from . import search
from .search import Around, Support, Trial


class Setting(NamedTuple):
    """What laws are tried on: recordings, also laid out as samples; the candidate
    terms; the most terms of a law; how many laws of each size are tried at first; how
    much of a difference a law may keep, 0 for any; and the model `around` a law, with
    which its output is compared."""

    group: tuple[Recording, ...]
    samples: Samples
    library: Library
    largest: int
    width: int
    fading: float
    around: Around = search.itself

    def own(self) -> dict[str, float]:
        """The numbers of the model around a law, by name, as `around` gives them.

        **Raises:** `InputError` where it gives no model with a law's parameters.
        """
        law = _nothing(self.library)
        model = self.around(law)
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

    def others(self) -> int:
        """How many numbers are fitted besides the coefficients of a law."""
        hidden = self.around(_nothing(self.library)).hidden
        return len(self.own()) + (0 if hidden else len(self.group))


def _nothing(library: Library) -> SparseModel:
    """The law w' = 0."""
    return SparseModel(library, jnp.zeros(len(library)), np.ones(len(library), bool))


class Effort(NamedTuple):
    """How laws are refined: the solver, its most steps, and how many side by side. One
    number of lanes for any number of laws is one compiled program."""

    solver: LevenbergMarquardt
    steps: int
    lanes: int


_ENOUGH = Effort(LevenbergMarquardt(rtol=1e-6), 8, 8)  # to tell laws apart, mostly
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
        for trial, steps in refined(setting, guesses, _ENOUGH):
            before = tried.get(trial.support)
            both = [trial] if before is None else [before, trial]
            tried[trial.support] = min(both, key=partial(_rank, setting))
            gained = before is None or trial.squares < _GAIN * before.squares
            if steps == _ENOUGH.steps and gained:
                slow.append(trial)
        rivals = best(setting, tried)
        guesses = [each for each in slow if not _behind(each, rivals)]
    return tried


def _rank(setting: Setting, trial: Trial) -> tuple[bool, float]:
    """The less, the better."""
    return not admitted(setting, trial), trial.squares


def _behind(trial: Trial, rivals: Iterable[Trial]) -> bool:
    """Whether a law of no more terms is far better."""
    size, squares = len(trial.terms), trial.squares / _FAR
    return any(r.squares < squares and len(r.terms) <= size for r in rivals)


def best(setting: Setting, tried: dict[Support, Trial]) -> list[Trial]:
    """The best law of each size."""
    best: dict[int, Trial] = {}
    for trial in sorted(tried.values(), key=lambda trial: trial.squares):
        if admitted(setting, trial):
            best.setdefault(len(trial.terms), trial)
    return list(best.values())


def admitted(setting: Setting, trial: Trial) -> bool:
    """Whether the law fades, or has no memory, and so nothing to drift away with; of a
    hidden output it is not asked."""
    fades = not setting.fading or trial.kept is None or trial.kept < setting.fading
    return math.isfinite(trial.squares) and (fades or _memoryless(setting, trial))


def _memoryless(setting: Setting, trial: Trial) -> bool:
    terms = dict(zip(setting.library.names, setting.library.terms, strict=True))
    return kind(terms[name] for name in trial.terms) is Kind.MEMORYLESS


def refined(
    setting: Setting, guesses: list[Trial], effort: Effort
) -> Iterator[tuple[Trial, int]]:
    """Laws refined, in portions of one size, and in how many steps."""
    fixed = setting.samples, setting.library, setting.around, setting.fading
    for first in range(0, len(guesses), effort.lanes):
        portion = guesses[first : first + effort.lanes]
        filled = portion + portion[:1] * (effort.lanes - len(portion))
        lanes = _lanes(setting, filled)
        ends = _refined(*fixed, lanes, effort.solver, effort.steps)
        ends, steps = jax.device_get(ends)
        for i, guess in enumerate(portion):
            yield _trial(guess, jax.tree.map(lambda x, i=i: x[i], ends)), int(steps[i])


class _Lanes(NamedTuple):
    """Where the refinements of m laws begin, as arrays: up to s terms by row of the
    library, which of these rows are used, their coefficients, the numbers of the models
    around, and the first outputs."""

    rows: Int[Array, "m s"]
    used: Bool[Array, "m s"]
    coefficients: Float[Array, "m s"]
    own: dict[str, Float[Array, " m"]]
    starts: Float[Array, "m r"]


class _End(NamedTuple):
    """Where the refinement of a law ended: what a `Trial` holds by the same names, as
    arrays."""

    coefficients: Float[Array, " s"]
    own: dict[str, Float[Array, ""]]
    starts: Float[Array, " r"]
    squares: Float[Array, ""]
    rmse: Float[Array, ""]
    kept: Float[Array, ""] | None
    independent: Float[Array, ""]


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
    )


def _lanes(setting: Setting, guesses: list[Trial]) -> _Lanes:
    """Laws of fewer terms than others are filled up with terms that are not used."""
    places = {name: row for row, name in enumerate(setting.library.names)}
    sizes = np.array([len(guess.terms) for guess in guesses])
    used = np.arange(setting.largest) < sizes[:, None]
    rows, coefficients = np.zeros(used.shape, int), np.zeros(used.shape)
    rows[used] = [places[name] for guess in guesses for name in guess.terms]
    coefficients[used] = [x for guess in guesses for x in guess.terms.values()]
    own = {
        name: jnp.array([guess.own.get(name, x) for guess in guesses])
        for name, x in setting.own().items()
    }
    measured = np.asarray(setting.samples.w[:, 0]).tolist()
    starts = jnp.array([guess.starts or measured for guess in guesses])
    return _Lanes(
        jnp.asarray(rows), jnp.asarray(used), jnp.asarray(coefficients), own, starts
    )


@jit
def _refined(
    samples: Samples,
    library: Library,
    around: Around,
    fading: float,
    lanes: _Lanes,
    solver: LevenbergMarquardt,
    max_steps: int,
) -> tuple[_End, Int[Array, " m"]]:
    """Where the refinements of a batch of laws end, and in how many steps."""
    known = samples.weight > 0

    def fit(lane: _Lanes):
        law = search.Choice(library, lane.rows, lane.used, tuple(lane.coefficients))
        model = around(law).with_parameters(lane.own)
        fading_law = fades(model)
        objective = Objective(
            parameters(model, (), {}, {}),
            samples,
            Squares(),
            1,
            fading if fading_law else 0.0,
            not model.hidden,
        ).prepared()
        first = first_unknowns(objective, lane.starts)
        end = minimise(objective, first, solver, max_steps)
        run = objective.run(end.unknowns)
        outputs = run.outputs
        residuals = jnp.where(known, outputs - samples.w, 0.0)
        weighted = jnp.sqrt(samples.weight) * residuals
        squares = jnp.sum(weighted**2)
        squares = jnp.where(jnp.isfinite(squares), squares, jnp.inf)
        kept = None
        if fading_law:
            kept = jnp.exp(jnp.max(objective.gains(end.unknowns, run)))
        share = search.effective_samples(weighted, known) / jnp.sum(known)
        rmse = jnp.sqrt(jnp.sum(residuals**2) / jnp.sum(known))
        names = objective.parameters.names
        values = dict(zip(names, end.unknowns.values, strict=True))
        coefficients = jnp.stack([values.pop(name) for name in law.parameters()])
        found = _End(coefficients, values, outputs[:, 0], squares, rmse, kept, share)
        return found, end.num_steps

    return jax.vmap(fit)(lanes)
