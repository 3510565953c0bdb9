"""The first laws of a hidden output. Where the model around a law tells, up to a few
numbers of its own, what the law gives: by variable projection, without luck. Where it
does not: from random coefficients, since there is nothing to regress."""

import itertools
import math
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray
from numpy.polynomial import Polynomial

from .._core import checks
from .._core.checks import InputError
from .._core.compiling import jit
from .._core.show import Progress
from ..library import Library, Term
from ..loops._reversals import half_cycles
from ..models import AbstractModel
from ..recording import Recording
from ..recording._as_measured import noise
from ..refinement import LevenbergMarquardt
from ..refinement._certainty import steps
from ..regression import LeastSquaresProblem, compress
from ..signals import Cubic
from . import search
from ._explore import Effort, Rows, Stage, free, nested, refined
from ._layout import layout
from ._setting import Setting, nothing, own
from .search import Around, Support, Trial

# Times the noise, that the power of the output is within its band. With 2, noise of 5 %
# is taken for the output, and nothing is seen of a spring; with 8, its coefficients are
# 5 % off under noise of 0.1 %, and not 3 %.
_OVER_NOISE = 4.0
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
    it may be anything, and would ring. Before and after them it is as recorded, for a
    lead-in tells what is remembered, but as far as they go."""
    from scipy.interpolate import CubicSpline  # slow to import, and rarely needed

    if np.all(known) or not np.any(known):
        return w
    number = np.cumsum(known)  # of known samples, up to each
    between = ~known & (number > 0) & (number < number[-1])
    bridged = np.where(known, w, np.clip(w, np.min(w[known]), np.max(w[known])))
    if np.any(between):
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


# ------------------------------------------------------------- variable projection

_SHARES = (0.0, 0.25, 0.5, 0.75, 1.0)  # of the way to where least is hidden
_WIDER = 2  # times the laws wanted, that are fitted one by one
_LANES = 16  # side by side
_SOLVER, _STEPS = LevenbergMarquardt(rtol=1e-4), 20
_ROUNDING = 1e-6  # of shares that are none, and of what a model does not make up for
_RIDGE = 1e-6  # what the law does counts so much beside what it leaves, in squares

Own = dict[str, Float[Array, ""]]
Several = dict[str, Float[Array, " starts"]]


class Inside(eqx.Module):
    """The law inside of a model, as records of that tell of it.

    **Attributes:** the `records`; what makes the model `around` a law; and the terms
    that the law may have, the `library`.
    """

    records: tuple[Seen, ...]
    around: Around
    library: Library

    def equations(
        self, rows: Int[Array | np.ndarray, " s"], own: Own
    ) -> tuple[Float[Array, "m s"], Float[Array, " m"]]:
        """Of all records those of some terms, for some numbers of the model."""
        model = self.around(nothing(self.library)).with_parameters(own)
        each = [record.equations(model, self.library, rows) for record in self.records]
        terms, target = map(jnp.concatenate, zip(*each, strict=True))
        return terms, target

    def least(self, own: Own) -> Own:
        """The numbers of the model with which the law has least to do."""
        return self.less(own, lambda driver, made: made)[0]

    def less(self, own: Own, part) -> tuple[Own, Float[Array, ""]]:
        """The numbers of the model with which the law does less by a part, of its
        driver and what it makes, where that is linear in these, as forces are in a mass
        and a stiffness; and what is left of the part, over all of it."""
        law = self.around(nothing(self.library))

        def signals(numbers):
            model = law.with_parameters(numbers)
            each = [model.hidden_signals(x.u, x.w, x.rate) for x in self.records]
            return tuple(map(jnp.concatenate, zip(*each, strict=True)))

        columns = jax.jacfwd(lambda numbers: signals(numbers)[1])(own)
        rows = jnp.column_stack(list(columns.values()))
        # What it does not depend on stays.
        told = jnp.any(rows != 0, axis=0)
        problem = compress(rows, -part(*signals(own)))
        change = problem.solve(told)
        numbers = {name: x + change[i] for i, (name, x) in enumerate(own.items())}
        return numbers, problem.residual(change)


class _Lane(NamedTuple):
    """A law of up to s terms by row of the library, and which of these are used."""

    rows: Int[Array | np.ndarray, " s"]
    used: Bool[Array | np.ndarray, " s"]


def halfway(
    records: tuple[Seen, ...], around: Around, library: Library, own: dict[str, float]
) -> LeastSquaresProblem:
    """The law's rate regressed on all terms, half way between the numbers that the
    model around it has and those with which the law has least to do."""
    return _halfway(Inside(records, around, library), _arrays(own))


def projected(setting: Setting, records: tuple[Seen, ...]) -> tuple[Stage, ...]:
    """The best laws of each size, each with numbers of the model around it.

    What the law gives is known for any numbers of the model, and its rate is linear in
    the coefficients: least squares finds these for each support, so that only the
    numbers are searched for. First with all terms, from several starts; then about what
    that finds, where the equations are linear in both, all supports are ranked; and the
    best are fitted one by one. What is least is the misfit of the rate in its own unit:
    relative to the rate, a law would be best that all but makes the output itself.

    **Source:** Golub and Pereyra (1973), doi 10.1137/0710036, for variable projection;
    Messenger and Bortz (2021), doi 10.1137/20M1343166, for the weak form.
    """
    own = _arrays(setting.own())
    inside = Inside(records, setting.around, setting.library)
    names, stages = setting.library.names, []
    for among in nested(setting.library):
        found, least, linear = _all_terms(inside, own, jnp.asarray(among))
        most, count = setting.largest, _WIDER * setting.width
        rankings = search.rankings(linear, most, count)
        supports = [among[row] for each in rankings for row in np.asarray(each.rows)]
        lists: dict[int, list[Trial]] = {}
        fits = _each(inside, most, supports, found, least)
        for rows, fit in zip(supports, fits, strict=True):
            lists.setdefault(len(rows), []).append(_as_trial(names, rows, fit))
        best = (sorted(each, key=lambda x: x.squares) for each in lists.values())
        stages.append(Stage(among, tuple(map(tuple, best))))
    return tuple(stages)


def in_other_words(
    setting: Setting, records: tuple[Seen, ...], law: Trial
) -> Iterator[Trial]:
    """The same device by other laws of no more terms, with other numbers of the model.

    What the law gives, less a share of what drives it that the model makes up for, as a
    stiffness does for a force in proportion to the position, obeys another law: for
    some shares of no more terms. Nothing measured tells which it is, and what is linear
    about one does not show the other.
    """
    if isinstance(setting.around, search.OfValue):
        return
    inside = Inside(records, setting.around, setting.library)
    known = {tuple(law.terms)}
    shifted = _shifted(law.terms, setting.library)
    for share in itertools.chain.from_iterable(p.roots() for p in shifted.values()):
        if abs(share.imag) > _ROUNDING * abs(share):
            continue
        values = {name: _value(p, share.real) for name, p in shifted.items()}
        left = [name for name in values if values[name]]
        terms = {name: values[name] for name in setting.library.names if name in left}
        lost, more = len(terms) < len(left), len(left) > len(law.terms)
        if not terms or lost or more or tuple(terms) in known:
            continue
        known.add(tuple(terms))
        own, misfit = _less_of_driver(inside, _arrays(law.own), share.real)
        if misfit < _ROUNDING:
            told = Trial(terms, own={name: float(x) for name, x in own.items()})
            yield free(setting, told, law.numbers) if law.numbers else told


def _shifted(terms: dict[str, float], library: Library) -> dict[str, Polynomial]:
    """The coefficients of the law of what a law gives less a share of u, as polynomials
    in that share; none of laws that this makes no sum of terms."""
    known = search.by_name(library)
    (w, _), (u, _), (du, _) = (Term.parse(name).factors[0] for name in ("w", "u", "du"))
    found = {Term([(du, 1)]).name: Polynomial([0.0, -1.0])}
    for name, x in terms.items():
        power = int(known[name].power("w"))
        rest = [each for each in known[name].factors if each[0] != w]
        if any(variable.of_output for variable, _ in rest):
            return {}
        for k in range(power + 1):
            new = Term([*rest, (w, power - k), (u, k)]).name
            share = x * math.comb(power, k) * Polynomial([0.0, 1.0]) ** k
            found[new] = found.get(new, Polynomial([0.0])) + share
    return found


def _value(polynomial: Polynomial, x: float) -> float:
    """Of a polynomial, 0 where that is all that rounding leaves of its parts."""
    value, parts = polynomial(x), Polynomial(np.abs(polynomial.coef))(abs(x))
    return float(value) if abs(value) > _ROUNDING * parts else 0.0


def _as_trial(names: Support, rows: Rows, fit: "_Fit") -> Trial:
    values = fit.coefficients[: len(rows)].tolist()
    terms = dict(zip((names[row] for row in rows), values, strict=True))
    numbers = {name: float(x) for name, x in fit.own.items()}
    return Trial(terms, own=numbers, squares=float(fit.squares))


class _Fit(NamedTuple):
    """The numbers of the model, the coefficients, and the squares that they leave."""

    own: Own
    coefficients: Float[Array, " s"]
    squares: Float[Array, ""]


def _each(
    inside: Inside, most: int, supports: list[Int[np.ndarray, " _s"]], *starts: Own
) -> Iterable[_Fit]:
    """The best fits of some supports, in portions of one size."""
    for first in range(0, len(supports), _LANES):
        portion = supports[first : first + _LANES]
        filled = [*portion, *[portion[0]] * (_LANES - len(portion))]
        used = np.arange(most) < np.array([len(row) for row in filled])[:, None]
        rows = np.zeros(used.shape, int)
        rows[used] = np.concatenate(filled)
        fits = jax.device_get(_fits(inside, _Lane(rows, used), starts))
        for i in range(len(portion)):
            yield jax.tree.map(lambda leaf, i=i: leaf[i], fits)


@jit
def _less_of_driver(inside: Inside, own: Own, share):
    """The numbers of the model with which the law does less by a share of what drives
    it, and how much of that no numbers make up for, over all of it."""
    return inside.less(own, lambda driver, made: share * driver)


@jit
def _halfway(inside: Inside, own: Own) -> LeastSquaresProblem:
    numbers = _on_the_way(own, inside.least(own), 0.5)
    everything = np.arange(len(inside.library))
    return compress(*inside.equations(everything, numbers))


@jit
def _all_terms(inside: Inside, own: Own, among):
    """The numbers of the model that all terms lead to; those with which the law has
    least to do; and the equations about the first, linear in coefficients and numbers,
    as a problem in the coefficients alone."""
    least = inside.least(own)
    shares = jnp.array(_SHARES)
    starts = jax.vmap(_on_the_way, (None, None, 0))(own, least, shares)
    lane = _Lane(among, jnp.ones(len(among), bool))
    best = _best(inside, lane, starts)

    def misfit(numbers):
        left, right = inside.equations(among, numbers)
        return right - left @ best.coefficients

    columns = jax.jacfwd(misfit)(best.own)
    others = -jnp.column_stack([columns[name] for name in own])
    terms, target = inside.equations(among, best.own)
    both = compress(jnp.column_stack([others, terms]), target)
    return best.own, least, both.beyond(len(own))


@jit
def _fits(inside: Inside, lanes: _Lane, starts: tuple[Own, ...]) -> _Fit:
    each = jax.tree.map(lambda *leaves: jnp.stack(leaves), *starts)
    # One after the other: each stays in the processor's cache, and ends when it may.
    return jax.lax.map(lambda lane: _best(inside, lane, each), lanes)


def _best(inside: Inside, lane: _Lane, starts: Several) -> _Fit:
    """The fit of a support that leaves least, of those from several starts."""
    fits = jax.lax.map(lambda own: _fit(inside, lane, own), starts)
    squares = jnp.where(jnp.isfinite(fits.squares), fits.squares, jnp.inf)
    return jax.tree.map(lambda leaf: leaf[jnp.argmin(squares)], fits)


def _fit(inside: Inside, lane: _Lane, own: Own) -> _Fit:
    origin = jnp.stack(list(own.values()))

    def at(numbers):
        values = dict(zip(own, numbers, strict=True))
        return _left(inside, lane, values)

    # In coordinates in which each number changes the misfit by its own size.
    columns = jax.jacfwd(lambda x: at(x)[0])(origin)
    lengths = jnp.linalg.norm(columns, axis=0)
    unit = jnp.where(lengths > 0, jnp.linalg.norm(at(origin)[0]) / lengths, 1.0)
    solution = optx.least_squares(
        lambda z, args: at(args[0] + args[1] * z)[0],
        _SOLVER,
        jnp.zeros_like(origin),
        (origin, unit),
        max_steps=_STEPS,
        throw=False,
    )
    numbers = origin + unit * solution.value
    left, coefficients = at(numbers)
    values = dict(zip(own, numbers, strict=True))
    return _Fit(values, coefficients, jnp.sum(left**2))


def _left(inside: Inside, lane: _Lane, own: Own):
    """What a support leaves of the law's rate, followed by what its terms do, which
    hardly counts, and its coefficients of least squares, for some numbers of the model.

    Where terms and numbers can do the same, as u' and a stiffness, equations do not
    tell them apart: the law then is to have least to do.
    """
    terms, target = inside.equations(lane.rows, own)
    lengths = jax.lax.stop_gradient(jnp.linalg.norm(terms, axis=0))
    lengths = jnp.where(lengths > 0, lengths, 1.0)
    columns = jnp.where(lane.used, terms / lengths, 0.0)
    ridge = jnp.diag(jnp.where(lane.used, _RIDGE, 1.0))
    chosen = jnp.linalg.solve(columns.T @ columns + ridge, columns.T @ target)
    done = _RIDGE**0.5 * chosen
    return jnp.concatenate([target - columns @ chosen, done]), chosen / lengths


def _on_the_way(own: Own, end: Own, share) -> Own:
    return {name: x + share * (end[name] - x) for name, x in own.items()}


def _arrays(own: dict[str, float]) -> Own:
    return {name: jnp.asarray(x) for name, x in own.items()}


# ---------------------------------------------------------- random coefficients

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
    around: Around | None, target: str, library: Library, size, starts: int, key
) -> Draws | None:
    """How the first laws are drawn, if they are.

    **Raises:** `InputError` for a size or a key that nothing is drawn with, where they
    are missing, and for laws of the value.
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
    if target == "value":
        raise InputError(
            "laws of the value are not drawn at random: leave out `size` and `key`, "
            "and give an `around` whose `hidden_signals` tell the law."
        )
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
            guesses = [
                Trial({names[row]: x for row, x in zip(support, law, strict=True)})
                for support, law in zip(rows, values.tolist(), strict=True)
            ]
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
