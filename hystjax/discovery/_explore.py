"""Laws tried: the first guesses refined side by side, then what promises to be better
about the best of each size, until nothing does; with numbers in their terms, such as
radii, on a grid and then set free."""

import itertools
import math
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import pairwise
from typing import Any, NamedTuple, TypeAlias, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from .._core.compiling import in_order, jit
from .._core.show import Progress, quantity
from .._core.solution import RESULTS, ended
from ..library import AbstractVariable, Kind, Library, kind, variables_of
from ..models import AbstractModel
from ..refinement import LevenbergMarquardt
from ..refinement._refine import fades
from ..regression import LeastSquaresProblem
from . import search
from ._layout import NONE, Layout, outputs_beyond, refined_without, weighted_error
from ._setting import Setting, agree, fixed_part
from .search import Around, Support, Trial

_LOW = 2  # degree of the terms that are tried first
_NEARBY = 20_000  # supports looked at one by one around a law
_BEAM = 300  # supports that are grown around a law
_ABOVE = 2  # terms by which proposals exceed a law: one may do nothing by itself

_Made = TypeVar("_Made")
Rows: TypeAlias = Int[np.ndarray, " c"]


class Effort(NamedTuple):
    """How laws are refined: the solver, its most steps, and how many side by side. One
    number of lanes for any number of laws is one compiled program."""

    solver: LevenbergMarquardt
    steps: int
    lanes: int


ENOUGH = Effort(LevenbergMarquardt(rtol=1e-6), 8, 4)  # to tell laws apart, mostly
_ALONE = 1  # at once of those that remember on their own, where copies would cost
_TURNS = 4  # of so many steps, for laws that these are not enough for
# Times the squares of the best law of as many terms, to be given up; and times those
# that a guess promises, to be tried again from it.
_FAR = 4.0
_GAIN = 0.99  # of the squares before, to be worth another turn


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


def regressed(
    setting: Setting, problem: LeastSquaresProblem, rows: Rows
) -> tuple[Stage, ...]:
    """The best laws of each size, of some rows of a factored problem of all terms."""
    names, stages = setting.library.names, []
    for every in nested(setting.library):
        among = np.intersect1d(every, rows)
        lists = []
        part = _only(problem, among)
        for ranking in search.rankings(part, setting.largest, setting.width):
            best = zip(among[ranking.rows], ranking.coefficients, strict=True)
            lists.append(tuple(Trial(_terms(names, *each)) for each in best))
        stages.append(Stage(among, tuple(lists)))
    return tuple(stages)


def explore(
    setting: Setting,
    stages: Sequence[Stage],
    end: float,
    progress: bool,
    before: tuple[Trial, ...] = (),
) -> tuple[Trial, ...]:
    """Refine the laws that are guessed, then around the best of each size those that
    the linearised free run ranks best, and those that it may stand for off the grid of
    its numbers, until no size has a new best.

    At first with the terms of low degree, of which so few are that little is missed;
    what they lead to is where the search among all terms goes on.

    **Arguments:** the first guesses; the time, of a monotonic clock, from which no more
    laws are tried; whether to say how far it is; and the laws tried before.
    """
    tried = {trial.support: trial for trial in before}
    unit = setting.group[0].units[1]
    with Progress("laws", done=len(tried), asked=progress) as shown:
        for among, firsts in stages:
            inside = {setting.library.names[row] for row in among}
            centred: set[Support] = set()
            guesses = untried(setting, firsts, tried, setting.width)
            while guesses and time.monotonic() < end:
                tried = with_guesses(setting, tried, guesses)
                laws = [x for x in tried.values() if inside.issuperset(x.terms)]
                best = best_of_each_size(setting, laws)
                centres = [each for each in best if each.support not in centred]
                centred |= {centre.support for centre in centres}
                close = [close_to(setting, among, centre) for centre in centres]
                lists = itertools.chain.from_iterable(
                    (off_grid(setting, each.law), *nearby(setting, each))
                    for each in close
                )
                guesses = untried(setting, lists, tried, max(1, setting.width // 2))
                for each in close:
                    guesses += parts(setting, each)
                done = len(tried)
                shown.show(done, done + len(guesses), _best_of(best, unit))
    return tuple(tried.values())


def _best_of(laws: Sequence[Trial], unit: str) -> str:
    """The error of the law that follows best, and of how many terms it is."""
    if not laws:
        return ""
    best = min(laws, key=lambda trial: trial.squares)
    return f"{quantity(best.rmse, unit, 3)} with {len(best.terms)} terms"


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
        for trial, cut_short in refined(setting, guesses, ENOUGH):
            before = tried.get(trial.support)
            both = [trial] if before is None else [before, trial]
            tried[trial.support] = min(both, key=partial(_rank, setting))
            gained = before is None or trial.squares < _GAIN * before.squares
            if cut_short and gained:
                slow.append(trial)
        rivals = best_of_each_size(setting, tried.values())
        guesses = [each for each in slow if not _behind(each, rivals)]
    return tried


def _rank(setting: Setting, trial: Trial) -> tuple[bool, float]:
    """The less, the better."""
    return not admitted(setting, trial), trial.squares


def _behind(trial: Trial, rivals: Iterable[Trial]) -> bool:
    """Whether a law of no more terms and numbers is far better."""
    size, squares = sum(trial.size), trial.squares / _FAR
    return any(r.squares < squares and sum(r.size) <= size for r in rivals)


def best_of_each_size(setting: Setting, tried: Iterable[Trial]) -> list[Trial]:
    """The best law of each size."""
    best: dict[tuple[int, int], Trial] = {}
    for trial in sorted(tried, key=lambda trial: trial.squares):
        if admitted(setting, trial):
            best.setdefault(trial.size, trial)
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
    terms = search.by_name(setting.library)
    names = (*setting.known, *trial.terms)
    return kind(terms[name] for name in names) is Kind.MEMORYLESS


class Close(NamedTuple):
    """The free runs close to a `law`: the `names` of the candidates with its numbers,
    the rows of those that take part, `among` them, and the runs as a `problem` in the
    coefficients of these."""

    law: Trial
    names: Support
    among: Rows
    problem: LeastSquaresProblem


def close_to(setting: Setting, among: Rows, law: Trial) -> Close:
    """The free runs close to a law, linearised in the coefficients."""
    library = setting.library.with_numbers(law.numbers)
    names, samples = library.names, setting.layout.samples
    dtype = samples.w.dtype
    terms = {**setting.known, **law.terms}
    problem = search.output_error(
        samples,
        library,
        jnp.asarray([terms.get(name, 0.0) for name in names], dtype),
        jnp.asarray(law.starts, dtype),
        around=setting.around,
        own={name: jnp.asarray(x, dtype) for name, x in law.own.items()},
    )
    known = fixed_part(library, setting.known)
    problem = problem if known is None else problem.less(known)
    return Close(law, names, among, _only(problem, among))


def nearby(setting: Setting, close: Close) -> Iterator[Iterator[Trial]]:
    """What promises to be better than a law, by the free runs close to it: laws with
    one term more; then those of each size near its own, with what they promise to
    leave; each time the best first."""
    law, names, among, problem = close
    beside, size = partial(_beside, setting, law, names), len(law.terms)
    if size < setting.largest:
        inside = [names.index(name) for name in law.terms]
        places = tuple(np.searchsorted(among, inside).tolist())
        longer = search.extensions(problem, places)
        yield (beside(among[list(rows)], values) for rows, values in longer)
    whole = problem.rows * float(problem.norms()[1]) ** 2
    most = min(size + _ABOVE, setting.largest)
    for ranking in search.rankings(problem, most, _BEAM, _BEAM, _NEARBY):
        if ranking.rows.shape[1] >= size - 1:
            promised = (whole * np.asarray(ranking.residuals) ** 2).tolist()
            ranked = among[ranking.rows], ranking.coefficients, promised
            yield itertools.starmap(beside, zip(*ranked, strict=True))


def parts(setting: Setting, close: Close) -> list[Trial]:
    """Of a law whose numbers are fitted the best with one term fewer, by the free runs
    close to it, from where that law is.

    Laws with numbers have other minima than the least, and this one may have been left
    in such, where it was tried from the grid.
    """
    law, names, among, problem = close
    size = len(law.terms)
    if not law.numbers or size == 1:
        return []
    inside = among[[names[row] in law.terms for row in among]]
    own = problem.columns(np.searchsorted(among, inside))
    *_, ranking = search.rankings(own, size - 1, 1)
    ((rows, values),) = zip(inside[ranking.rows], ranking.coefficients, strict=True)
    part = _beside(setting, law, names, rows, values)
    return [part] if agree(part.terms, setting.signs) else []


def untried(
    setting: Setting, lists: Iterable[Iterable[Trial]], tried, each: int
) -> list[Trial]:
    """From each list so many of the first that were not tried, and have the signs that
    they are to have; and the best of all where its refinement, from another guess, was
    left far above what it promises now."""
    seen, again, chosen = set(tried), {}, []
    for guesses in lists:
        agreed = [guess for guess in guesses if agree(guess.terms, setting.signs)]
        for best in agreed[:1]:
            before = tried.get(best.support)
            if before is not None and _FAR * best.squares < before.squares:
                again[best.support] = best
        fresh = (guess for guess in agreed if guess.support not in seen)
        new = [*itertools.islice(fresh, each)]
        seen |= {guess.support for guess in new}
        chosen += new
    return [*chosen, *again.values()]


def _only(problem: LeastSquaresProblem, among: Rows) -> LeastSquaresProblem:
    return problem if len(among) == len(problem.target) else problem.columns(among)


def _terms(names: Support, rows: Rows, values) -> dict[str, float]:
    """Coefficients by name, of those in some rows."""
    places, numbers = rows.tolist(), np.asarray(values).tolist()
    return {names[row]: x for row, x in zip(places, numbers, strict=True)}


def _beside(
    setting: Setting,
    centre: Trial,
    names: Support,
    rows: Rows,
    values,
    squares: float = math.inf,
) -> Trial:
    """A guess that begins where a law near it is; where the numbers of that are fitted,
    with its own, too."""
    terms = _terms(names, rows, values)
    guess = Trial(terms, own=centre.own, starts=centre.starts, squares=squares)
    return free(setting, guess, centre.numbers) if centre.numbers else guess


# ------------------------------------------------- numbers, on a grid and set free


def off_grid(setting: Setting, law: Trial) -> Iterator[Trial]:
    """What a law on the grid may stand for: laws with one operator between the places
    of two neighbours; and the law itself, where its own numbers lead."""
    if free_numbers(setting, law.terms):
        for guess in (*_merged(setting, law), law):
            yield free(setting, guess, law.numbers | guess.numbers)


def free(setting: Setting, law: Trial, start: Mapping[str, float]) -> Trial:
    """A law whose numbers are fitted with its coefficients, from those given or else
    from the grid; as it is, where it has none, or more than there is room for."""
    names = free_numbers(setting, law.terms)
    if len(names) > setting.numbers:
        return law
    grid = setting.library.numbers
    return replace(law, numbers={n: start.get(n, float(grid[n])) for n in names})


def free_numbers(setting: Setting, names: Iterable[str]) -> list[str]:
    """The numbers in some terms, by name, but for those in the known part."""
    fixed = {name for name, _ in _numbered(setting.library, setting.known)}
    return [name for name, _ in _numbered(setting.library, names) if name not in fixed]


def _numbered(
    library: Library, names: Iterable[str]
) -> list[tuple[str, AbstractVariable]]:
    """The numbers in some terms by name, and the variable that each is in."""
    terms = search.by_name(library)
    every = variables_of(tuple(terms[name] for name in names))
    return [(f"{v.name}.{what}", v) for v in every for what in v.numbers]


def _merged(setting: Setting, law: Trial) -> Iterator[Trial]:
    """Of every two neighbours on the grid that do the same in a law, the law with one
    number half way between them."""
    grids = _grids(setting.library)
    inside: dict[AbstractVariable, dict[float, str]] = {}
    for name in free_numbers(setting, law.terms):
        place, number = grids[name]
        inside.setdefault(place, {})[number] = name
    for place, names in inside.items():
        every = sorted(number for each, number in grids.values() if each == place)
        for low, high in pairwise(every):
            if low not in names or high not in names:
                continue
            merged = _renamed(setting, law, {names[low]: high})
            if merged is None or len(merged.terms) == len(law.terms):
                continue
            between = sum(law.numbers.get(names[x], x) for x in (low, high)) / 2
            yield replace(merged, numbers=merged.numbers | {names[high]: between})


def on_grid(setting: Setting, law: Trial) -> Trial:
    """A law with its numbers as their variables take them, radii without a sign, and
    under the names of those on the grid that they have come closest to, if each is
    there once: then it is the same law, whatever it was found from."""
    grids = _grids(setting.library)
    taken, closest = {}, {}
    for name, number in law.numbers.items():
        place, _ = grids[name]
        what = name.rpartition(".")[2]
        taken[name] = number = float(place.with_numbers({what: number}).numbers[what])
        every = [x for each, x in grids.values() if each == place]
        closest[name] = min(every, key=lambda x, number=number: abs(x - number))
    law = replace(law, numbers=taken)
    renamed = _renamed(setting, law, closest)
    return law if renamed is None or renamed.size != law.size else renamed


def _grids(library: Library) -> dict[str, tuple[AbstractVariable, float]]:
    """What numbers are of, but for themselves, and what their names show."""
    return {
        f"{v.name}.{what}": (v.with_numbers({what: 1.0}), float(number))
        for v in variables_of(library.terms)
        for what, number in v.numbers.items()
    }


def _renamed(setting: Setting, law: Trial, grid: Mapping[str, float]) -> Trial | None:
    """A law in terms with other numbers of the grid, the coefficients of those that
    become one added up; `None` where these are no candidates."""
    library, terms, found = setting.library, search.by_name(setting.library), {}
    for name, x in law.terms.items():
        new = terms[name].with_numbers(grid).name
        found[new] = found.get(new, 0.0) + x
    if not found.keys() <= terms.keys() - setting.known.keys():
        return None
    numbers = {
        f"{variable.renamed(grid).name}.{name.rpartition('.')[2]}": law.numbers[name]
        for name, variable in _numbered(library, law.terms)
        if name in law.numbers
    }
    ordered = {new: found[new] for new in terms if new in found}
    return replace(law, terms=ordered, numbers=numbers)


# ------------------------------------------------------------ refined side by side


def refined(
    setting: Setting, guesses: list[Trial], effort: Effort
) -> Iterator[tuple[Trial, bool]]:
    """Laws refined, and whether further steps would lead on; those last that seem to
    run away beyond the recorded inputs."""
    straying = []
    for guess, _, end in _ends(setting, [(g, NONE) for g in guesses], effort):
        trial, cut_short = _trial(guess, end), bool(end.cut_short)
        if stays(setting, trial) or not math.isfinite(trial.squares):
            yield on_grid(setting, trial), cut_short
        else:
            straying.append((trial, cut_short))
    straying.sort(key=_moves)
    laws = looked_beyond(setting, [trial for trial, _ in straying])
    for law, (_, cut_short) in zip(laws, straying, strict=True):
        yield on_grid(setting, law), cut_short


def looked_beyond(setting: Setting, laws: Sequence[Trial]) -> list[Trial]:
    """Laws with how far they get beyond the recorded inputs, in finer steps than they
    were refined by: steps that are too long make laws run away that do not. Those whose
    numbers are fitted come last."""
    if setting.layout.outside is None:
        return [*laws]
    distances = partial(_distances, *_fixed(setting))
    each = [(law, NONE) for law in laws]
    found = _side_by_side(setting, each, ENOUGH.lanes, distances)
    return [replace(law, beyond=float(distance)) for law, _, distance in found]


def left_out(setting: Setting, trials: Sequence[Trial]) -> list[Trial]:
    """Laws with their errors on each block, of a refinement without that block."""
    blocks = range(setting.layout.count)
    each = [(trial, block) for trial in trials for block in blocks]
    errors = {
        (trial.support, block): float(end.unseen)
        for trial, block, end in _ends(setting, each, ENOUGH)
    }
    return [
        replace(each, blocks=tuple(errors[each.support, block] for block in blocks))
        for each in trials
    ]


def _ends(
    setting: Setting, guesses: Sequence[tuple[Trial, int]], effort: Effort
) -> Iterator[tuple[Trial, int, "_End"]]:
    """Guesses, each with the block left out, and where their refinements end."""
    fixed, how = _fixed(setting), (setting.fading, effort.solver, effort.steps)

    def ends(lanes: _Lanes) -> _End:
        return _refined(*fixed, lanes, *how)

    yield from _side_by_side(setting, guesses, effort.lanes, ends)


def _side_by_side(
    setting: Setting,
    laws: Sequence[tuple[Trial, int]],
    count: int,
    program: Callable[["_Lanes"], _Made],
) -> Iterator[tuple[Trial, int, _Made]]:
    """Laws, each with the block left out, and what a program for so many at once makes
    of them, on all processors; those whose numbers are fitted last."""
    # What all remember alike is had once; of the others each remembers on its own.
    sizes = {False: count, True: _ALONE}
    portions: list[list[tuple[Trial, int]]] = []
    for moved, alike in itertools.groupby(sorted(laws, key=_moves), key=_moves):
        each, size = [*alike], sizes[moved]
        portions += [each[i : i + size] for i in range(0, len(each), size)]

    def made(portion: list[tuple[Trial, int]]) -> _Made:
        spare = sizes[_moves(portion[0])] - len(portion)
        filled = [*portion, *[portion[0]] * spare]
        return jax.device_get(program(_lanes(setting, filled)))

    for portion, found in in_order(made, portions):
        for i, (law, block) in enumerate(portion):
            yield law, block, jax.tree.map(lambda x, i=i: x[i], found)


def _moves(each: tuple[Trial, Any]) -> bool:
    """Whether numbers in the terms of a law are fitted."""
    law, _ = each
    return bool(law.numbers)


def _fixed(setting: Setting) -> tuple[Layout, Library, Array | None, Around]:
    """What is the same for all laws of a search."""
    known = fixed_part(setting.library, setting.known)
    return setting.layout, setting.library, known, setting.around


class _Lanes(NamedTuple):
    """Where the refinements of m laws begin, as arrays: up to s terms by row of the
    library, which of these rows are used, their coefficients; up to q numbers in terms
    by their place in the library, and these; the numbers of the models around, and the
    first outputs; and the block that is left out."""

    rows: Int[Array, "m s"]
    used: Bool[Array, "m s"]
    coefficients: Float[Array, "m s"]
    places: Int[Array, "m q"]
    numbers: Float[Array, "m q"]
    own: dict[str, Float[Array, " m"]]
    starts: Float[Array, "m r"]
    left_out: Int[Array, " m"]


class _End(NamedTuple):
    """Where the refinement of a law ended: what a `Trial` holds by the same names, as
    arrays; the root mean square error on the block that was left out; and whether the
    steps were up before the refinement had come to its end."""

    coefficients: Float[Array, " s"]
    numbers: Float[Array, " q"]
    own: dict[str, Float[Array, ""]]
    starts: Float[Array, " r"]
    squares: Float[Array, ""]
    rmse: Float[Array, ""]
    kept: Float[Array, ""] | None
    independent: Float[Array, ""]
    beyond: Float[Array, ""]
    unseen: Float[Array, ""]
    cut_short: Bool[Array, ""]


def _trial(guess: Trial, end: _End) -> Trial:
    found = jax.tree.map(lambda leaf: leaf.tolist(), end)
    # Of both some may be unused.
    terms = dict(zip(guess.terms, found.coefficients, strict=False))
    numbers = dict(zip(guess.numbers, found.numbers, strict=False))
    return Trial(
        terms,
        found.rmse,
        numbers=numbers,
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
    used = np.arange(setting.places) < sizes[:, None]
    rows, coefficients = np.zeros(used.shape, int), np.zeros(used.shape)
    rows[used] = [places[name] for guess in guesses for name in guess.terms]
    coefficients[used] = [x for guess in guesses for x in guess.terms.values()]
    places, numbers = _places(setting, guesses)
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
        jnp.asarray(places),
        jnp.asarray(numbers),
        own,
        starts,
        blocks,
    )


def _places(setting: Setting, guesses: Sequence[Trial]):
    """The places in the library of numbers that are fitted, and these; no columns where
    none are, and what is not used beyond the last place."""
    names = [*setting.library.numbers]
    columns = setting.numbers if any(guess.numbers for guess in guesses) else 0
    places = np.full((len(guesses), columns), len(names))
    numbers = np.zeros(places.shape)
    for row, guess in enumerate(guesses):
        for column, (name, number) in enumerate(guess.numbers.items()):
            places[row, column] = names.index(name)
            numbers[row, column] = number
    return places, numbers


@jit
def _refined(
    layout: Layout,
    library: Library,
    known: Float[Array, " k"] | None,
    around: Around,
    lanes: _Lanes,
    fading: float,
    solver: LevenbergMarquardt,
    max_steps: int,
) -> _End:
    """Where the refinements of a batch of laws end."""
    samples, coarser = layout.samples, layout.in_its_own_steps()
    scored = samples.weight > 0

    def fit(lane: _Lanes):
        law, model = _model(library, known, around, lane)
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
        residuals = jnp.where(scored, run.outputs - samples.w, 0.0)
        weighted = jnp.sqrt(samples.weight) * residuals
        squares = jnp.sum(weighted**2)
        kept = None
        if fading_law:
            kept = jnp.exp(jnp.max(objective.gains(end.unknowns, run)))
        names = objective.parameters.names
        values = dict(zip(names, end.unknowns.values, strict=True))
        found = jnp.stack([values.pop(name) for name in law.parameters()])
        coefficients, numbers = jnp.split(found, [len(lane.rows)])
        return _End(
            coefficients,
            numbers,
            own=values,
            starts=run.outputs[:, 0],
            squares=jnp.where(jnp.isfinite(squares), squares, jnp.inf),
            rmse=jnp.sqrt(jnp.sum(residuals**2) / jnp.sum(scored)),
            kept=kept,
            independent=search.independent_share(weighted, scored),
            beyond=coarser.distance(objective, end.unknowns),
            unseen=weighted_error(weighted, jnp.where(out, samples.weight, 0.0)),
            cut_short=ended(end.result, RESULTS.nonlinear_max_steps_reached),
        )

    return jax.vmap(fit)(lanes)


@jit
def _distances(
    layout: Layout,
    library: Library,
    known: Float[Array, " k"] | None,
    around: Around,
    lanes: _Lanes,
) -> Float[Array, " m"]:
    """How far a batch of laws gets beyond the recorded inputs."""

    def distance(lane: _Lanes):
        _, model = _model(library, known, around, lane)
        return layout.from_middle(outputs_beyond(layout, model, lane.starts))

    return jax.vmap(distance)(lanes)


def _model(
    library: Library,
    known: Float[Array, " k"] | None,
    around: Around,
    lane: _Lanes,
) -> tuple[search.Choice, AbstractModel]:
    """A law of a batch, and the model around it."""
    terms = lane.rows, lane.used, tuple(lane.coefficients)
    law = search.Choice(library, *terms, known, lane.places, tuple(lane.numbers))
    return law, around(law).with_parameters(lane.own)
