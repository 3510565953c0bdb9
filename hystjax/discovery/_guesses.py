"""Laws worth trying: by linear least squares, of equations or of the free run about a
law; or from random coefficients, where there is nothing to regress."""

import itertools
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple, TypeAlias

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from .._core import checks
from .._core.checks import InputError
from .._core.compiling import jit
from .._core.show import Progress
from ..library import Library
from ..loops._reversals import half_cycles
from ..models import AbstractModel
from ..recording import Recording
from ..recording._as_measured import noise
from ..refinement import LevenbergMarquardt
from ..refinement._certainty import steps
from ..regression import LeastSquaresProblem, compress
from ..signals import Cubic
from . import search
from ._layout import layout
from ._setting import Setting, agree, fixed_part, free, nothing, own
from ._trials import FAR, Effort, refined
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
    one term more; then those of each size near its own, with what they promise to
    leave; each time the best first. Where its numbers are fitted, theirs are too."""
    lists = _nearby(setting, among, centre)
    if not centre.numbers:
        return lists
    return ((free(setting, x, centre.numbers) for x in guesses) for guesses in lists)


def parts(setting: Setting, among: Rows, centre: Trial) -> list[Trial]:
    """Of a law whose numbers are fitted the best with one term fewer, by the free runs
    close to it, from where that law is.

    Laws with numbers have other minima than the least, and this one may have been left
    in such, where it was tried from the grid.
    """
    size = len(centre.terms)
    if not centre.numbers or size == 1:
        return []
    names, problem = _about(setting, among, centre)
    inside = among[[names[row] in centre.terms for row in among]]
    own = problem.columns(np.searchsorted(among, inside))
    *_, ranking = search.rankings(own, size - 1, 1)
    guesses = _ranked(names, ranking, inside, _as_at(centre))
    return [free(setting, each, centre.numbers) for each in guesses]


def _nearby(setting: Setting, among: Rows, centre: Trial) -> Iterator[Iterator[Trial]]:
    names, part = _about(setting, among, centre)
    size, like = len(centre.terms), _as_at(centre)
    whole = part.rows * float(part.norms()[1]) ** 2
    if size < setting.largest:
        inside = [names.index(name) for name in centre.terms]
        more = search.extensions(part, tuple(np.searchsorted(among, inside).tolist()))
        yield (_guess(names, among[list(r)], x, like) for r, x in more)
    sizes = min(size + _ABOVE, setting.largest)
    for ranking in search.rankings(part, sizes, _BEAM, _BEAM, _NEARBY):
        if ranking.rows.shape[1] >= size - 1:
            guesses = _ranked(names, ranking, among, like)
            promised = (whole * np.asarray(ranking.residuals) ** 2).tolist()
            pairs = zip(guesses, promised, strict=True)
            yield (replace(guess, squares=left) for guess, left in pairs)


def _about(
    setting: Setting, among: Rows, centre: Trial
) -> tuple[Support, LeastSquaresProblem]:
    """The names of the candidates, and the free runs close to a law as a problem in the
    coefficients of those that take part."""
    library = setting.library.with_numbers(centre.numbers)
    names, samples = library.names, setting.layout.samples
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
    return names, _only(problem, among)


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
            if before is not None and FAR * best.squares < before.squares:
                again[best.support] = best
        fresh = (guess for guess in agreed if guess.support not in seen)
        new = [*itertools.islice(fresh, each)]
        seen |= {guess.support for guess in new}
        chosen += new
    return [*chosen, *again.values()]


def _only(problem: LeastSquaresProblem, among: Rows) -> LeastSquaresProblem:
    return problem if len(among) == len(problem.target) else problem.columns(among)


def _as_at(centre: Trial) -> Trial:
    """What guesses near a law begin with, beside their terms."""
    return Trial({}, own=centre.own, starts=centre.starts)


def _ranked(
    names: Support, ranking: search.Ranking, among: Rows, like: Trial = Trial({})
) -> Iterator[Trial]:
    rows, values = among[np.asarray(ranking.rows)], np.asarray(ranking.coefficients)
    for support, coefficients in zip(rows, values, strict=True):
        yield _guess(names, support, coefficients, like)


def _guess(names: Support, rows, coefficients, like: Trial = Trial({})) -> Trial:
    places, values = rows.tolist(), coefficients.tolist()
    terms = {names[row]: x for row, x in zip(places, values, strict=True)}
    return replace(like, terms=terms)


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
            f"`models.Butterfly`; got {checks.described(around)}."
        )
    own(around, library)  # which says what is wrong with the model
    if size is None and key is None and tells(around(nothing(library))):
        return None
    if size is None or key is None:
        raise InputError(
            "with this `around` the recorded output does not tell that of the law, and "
            "the first laws are drawn at random: give `size`, about the largest output "
            "of the law, and a `key`, such as `jax.random.key(0)`."
        )
    checks.positive("size", checks.number("size", size))
    checks.key("key", key)
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
    weighed = zip(setting.group, setting.layout.samples.weight, strict=True)
    thin, weights = zip(*itertools.starmap(_thinned, weighed), strict=True)
    coarse = setting._replace(layout=layout(thin, weights, steps(thin, None), False))
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


def _thinned(
    recording: Recording, weight: Float[Array, " m"]
) -> tuple[Recording, Float[Array, " n"]]:
    """Fewer samples, with straight lines between them, and their weights."""
    n = len(recording)
    rows = slice(0, n, max(1, n // (_SAMPLES * half_cycles(recording))))
    columns = (x[rows] for x in (recording.t, recording.u, recording.w))
    return Recording(*columns), weight[rows]


_OVER_NOISE = 4.0  # times the noise, that the power of the output is within its band
_ROLL = 1.25  # of the band's end, where nothing is left
_BANDS = 128  # parts of the spectrum, over which power is averaged
_RESOLVED = 2.0  # half width of test functions, in periods of the band's end
_TURN = 0.4  # and at least, in distances of the driver's turning points
_OVERLAP = 3  # test functions start this many to a half width
_FLATNESS = 4  # of their ends
_EDGE = 10.0  # periods of the band's end, near the record's, that are not looked at


class Seen(eqx.Module):
    """One record in the band in which its output is more than noise.

    **Attributes:** of n samples

    - `step`: between them, s.
    - `u`, `w`: input and output there, shape (n,).
    - `memory`: signals of memory by name, of what drives the law by the numbers that
        the model has at first, shape (n,).
    - `target`: what the law in it gives, the `"rate"` or the `"value"`.
    - `good`: of each test function, whether all that it looks at is known, shape (m,).
    - `half_width`: of test functions, in samples.
    - `first`, `stride`: where the first one begins, and from one to the next.
    """

    step: Float[Array, ""]
    u: Float[Array, " n"]
    w: Float[Array, " n"]
    memory: Mapping[str, Float[Array, " n"]]
    good: Bool[Array, " m"]
    half_width: int = eqx.field(static=True)
    first: int = eqx.field(static=True)
    stride: int = eqx.field(static=True)
    target: str = eqx.field(static=True, default="rate")

    def rate(self, x: Float[Array, " n"]) -> Float[Array, " n"]:
        """The time derivative of a signal without noise."""
        line, spectrum, frequencies = _spectrum(x, self.step)
        slope = (line[1] - line[0]) / self.step
        return _signal(2j * jnp.pi * frequencies * spectrum, len(x)) + slope

    def equations(
        self,
        model: AbstractModel,
        library: Library,
        rows: Int[Array | np.ndarray, " s"],
    ) -> tuple[Float[Array, "m s"], Float[Array, " m"]]:
        """The law inside of a model in the weak form: of some of the library's terms
        means over test functions, and of the law's rate, or its value. In the unit of
        that, for the size of what the law gives is not known."""
        signals = model.hidden_signals(self.u, self.w, self.rate)
        assert signals is not None  # as was asked before
        driver, made = signals
        terms = library(made, driver, self.rate(driver), self.memory)[:, rows]
        x = jnp.linspace(-1, 1, 2 * self.half_width + 1, dtype=made.dtype)
        bump = (1 - x**2) ** _FLATNESS
        whole, reach = jnp.sum(bump), self.half_width * self.step
        means = self._weighed(terms, bump / whole)
        if self.target == "value":
            return means, self._weighed(made, bump / whole)
        slope = -2 * _FLATNESS * x * (1 - x**2) ** (_FLATNESS - 1)
        return means, self._weighed(made, -slope / whole / reach)

    def _weighed(self, columns: Float[Array, "n *s"], weights: Float[Array, " w"]):
        """Sums under a moving window, zero where it sees what is not known."""
        count, tail = len(self.good), columns.shape[1:]
        rows = columns[self.first :][
            : (len(columns) - self.first) // self.stride * self.stride
        ]
        rows = rows.reshape(-1, self.stride, *tail)

        # Sums over shifted columns: windows side by side would take the memory of as
        # many records as there are samples in one.
        def add(sums, each):
            shift, weight = each
            start = shift // self.stride, shift % self.stride, *(0 for _ in tail)
            part = jax.lax.dynamic_slice(rows, start, (count, 1, *tail))
            return sums + weight * part[:, 0], None

        zeros = jnp.zeros((count, *tail), columns.dtype)
        each = jnp.arange(len(weights)), weights
        sums, _ = jax.lax.scan(add, zeros, each)
        return jnp.where(self.good.reshape(-1, *(1 for _ in tail)), sums, 0.0)


def tells(model: Any) -> bool:
    """Whether input and output of a model tell what the law inside of it does, up to
    numbers of the model."""
    if not isinstance(model, AbstractModel):
        return False
    few = jnp.zeros(4)
    return model.hidden_signals(few, few, lambda x: x) is not None


def seen(
    group: Sequence[Recording],
    model: AbstractModel,
    library: Library,
    weights: Sequence[Float[Array, " _n"]] | None,
    target: str = "rate",
) -> tuple[Seen, ...]:
    """The records as a model's hidden law is seen in them, where they have weight: its
    rate or its value.

    What is above the band in which the output is more than noise is left out of input
    and output alike: derivatives would be made of noise there. Beyond its ends a record
    is taken to go on as its mirror image by the end, which has no corner there.

    **Raises:** `InputError` for samples that are not evenly spaced, or have no clock.
    """
    each = [None] * len(group) if weights is None else weights
    pairs = zip(group, each, strict=True)
    return tuple(_seen(each, model, library, weight, target) for each, weight in pairs)


def _seen(
    record: Recording, model: AbstractModel, library: Library, weight, target: str
) -> Seen:
    from scipy.fft import prev_fast_len  # slow to import, and rarely needed

    checks.evenly_spaced(
        "a law that is seen through the derivatives of the output",
        record.t,
        "or give `size` and `key`, and the first laws are drawn at random",
    )
    model.check_times(record.t, record.clocked)
    checks.enough_samples("a hidden law", len(record), 50)
    step = (record.t[-1] - record.t[0]) / (len(record) - 1)
    # Of a length whose transform is fast: not many are left out.
    n = 1 + prev_fast_len(len(record) - 1, real=True)  # pyright: ignore[reportOperatorIssue]
    known = np.ones(n, bool) if weight is None else np.asarray(weight[:n]) > 0
    t, w = (np.asarray(x[:n]) for x in (record.t, record.w))
    w = _bridged(t, w, known)
    end = _end(t, w)
    u, w = (_low(jnp.asarray(x), step, end) for x in (record.u[:n], w))
    whole = Seen(step, u, w, {}, jnp.ones(1, bool), 1, 0, 1)
    signals = model.hidden_signals(u, w, whole.rate)
    assert signals is not None
    driver = signals[0]
    memory = library.signals(Cubic().path(step * jnp.arange(n), driver))
    slopes = np.asarray(whole.rate(driver))
    turns = np.count_nonzero(np.diff(np.sign(slopes)))
    period = 1 / (end * float(step))  # of the band's end, in samples
    half = max(_RESOLVED * period, _TURN * n / (turns + 1), 2.0)
    half = min(round(half), n // 8)
    edge = min(round(_EDGE * period), n // 8)
    known[:edge] = known[n - edge :] = False
    missing = np.concatenate([[0], np.cumsum(~known)])
    stride = max(1, half // _OVERLAP)
    starts = np.arange(0, n - 2 * half - stride, stride)
    good = missing[starts + 2 * half + 1] == missing[starts]
    some = np.flatnonzero(good)
    if not len(some):
        raise InputError(
            "too few samples in a row have weight for a hidden law to be seen in: "
            f"{2 * half + 1} are needed, and {edge} at each end of the recording are "
            "not looked at."
        )
    used = slice(some[0], some[-1] + 1)
    first = int(starts[used][0])
    return Seen(
        step, u, w, memory, jnp.asarray(good[used]), half, first, stride, target
    )


def _bridged(
    t: Float[np.ndarray, " n"],
    w: Float[np.ndarray, " n"],
    known: Bool[np.ndarray, " n"],
) -> Float[np.ndarray, " n"]:
    """An output with a spline across what is not known between samples that are: there
    it may be anything, and would ring."""
    from scipy.interpolate import CubicSpline  # slow to import, and rarely needed

    number = np.cumsum(known)  # of known samples, up to each
    between = ~known & (number > 0) & (number < number[-1])
    if not np.any(between):
        return w
    bridged = w.copy()
    bridged[between] = CubicSpline(t[known], w[known])(t[between])
    return bridged


def _end(t: Float[np.ndarray, " n"], w: Float[np.ndarray, " n"]) -> float:
    """The frequency above which an output is hardly more than noise, Hz."""
    step = (t[-1] - t[0]) / (len(t) - 1)
    _, spectrum, frequencies = map(np.asarray, _spectrum(jnp.asarray(w), step))
    width = max(8, len(frequencies) // _BANDS)
    power = np.convolve(np.abs(spectrum) ** 2, np.full(width, 1 / width), "same")
    # White noise has this power in each line of its mirrored record.
    above = np.flatnonzero(power > _OVER_NOISE * 2 * len(w) * noise(w, t) ** 2)
    return float(frequencies[above[-1] if len(above) else -1])


def _low(x: Float[Array, " n"], step, end: float) -> Float[Array, " n"]:
    """A signal up to a frequency, without ringing."""
    line, spectrum, frequencies = _spectrum(x, step)
    beyond = jnp.clip((frequencies / end - 1) / (_ROLL - 1), 0, 1)
    return _signal(spectrum * jnp.cos(jnp.pi / 2 * beyond) ** 2, len(x)) + line


def _spectrum(x: Float[Array, " n"], step):
    """The line through a signal's ends; the spectrum of what is left, mirrored so that
    it goes on without a corner; and the frequencies, Hz."""
    line = jnp.linspace(x[0], x[-1], len(x), dtype=x.dtype)
    left = x - line
    mirrored = jnp.concatenate([left, -left[-2:0:-1]])
    frequencies = jnp.fft.rfftfreq(len(mirrored)) / step
    return line, jnp.fft.rfft(mirrored), frequencies


def _signal(spectrum, n: int) -> Float[Array, " n"]:
    return jnp.fft.irfft(spectrum, 2 * (n - 1))[:n]
