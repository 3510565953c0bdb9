"""The search for the right terms of a law: laws that are tried, and what decides
between them; and the best supports of one size on a factored least-squares problem, of
equations or of free runs close to one."""

import itertools
import math
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, TypeAlias

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Bool, Float, Int, Shaped

from .._core.compiling import jit
from ..least_squares import solution
from ..library import Library, Term, variables_of
from ..models import AbstractLaw, AbstractModel, AbstractSum, SparseModel
from ..refinement import (
    Objective,
    Samples,
    Squares,
    first_unknowns,
    free_of,
    linearised,
    ljung_box,
    parameters,
)
from ..regression import LeastSquaresProblem, compress

__all__ = [
    "Around",
    "Choice",
    "OfValue",
    "Ranking",
    "Support",
    "Trial",
    "alike",
    "contenders",
    "extensions",
    "frontier",
    "independent_share",
    "information_criterion",
    "itself",
    "ordered",
    "output_error",
    "ranking",
    "rankings",
    "supports",
    "weights",
]


def __dir__() -> list[str]:
    return __all__


Support: TypeAlias = tuple[str, ...]


@dataclass(frozen=True)
class Trial:
    """A law that is tried, from the guess it begins with to what is told of it.

    What only a refinement can tell is infinite in a guess; but guesses near a law have
    the `squares` that its linearised free run promises.

    **Attributes:**

    - `terms`: coefficients by term, in the order of the library.
    - `rmse`: root mean square error of its refined free run, output units, over all
        recordings.
    - `criterion`: the extended Bayesian information criterion; what matters are
        differences, among the laws of one search.
    - `numbers`: those in its terms, such as radii, that were fitted with it, by name;
        all others are as the names of the terms show them.
    - `kept`: share of a difference between initial values that is left at the end of
        the recording that keeps most, or after ten cycles of its input, where that has
        fewer; `None` where the law's output is hidden.
    - `own`: numbers of the model around the law, by name.
    - `starts`: first simulated output of each recording; of a guess near a law that
        law's, and none of others, which begin with the measured ones.
    - `squares`: the sum of weighted squared errors.
    - `independent`: share of its residuals that is worth independent ones.
    - `beyond`: how far its free runs under larger, faster and slower inputs get from
        the middle of the recorded outputs, over half of their range.
    - `blocks`: root mean square error on each block of the samples of fits without it;
        none where laws are not judged so.
    """

    terms: dict[str, float]
    rmse: float = math.inf
    criterion: float = math.inf
    kept: float | None = None
    own: dict[str, float] = field(default_factory=dict)
    numbers: dict[str, float] = field(default_factory=dict)
    starts: tuple[float, ...] = ()
    squares: float = math.inf
    independent: float = 1.0
    beyond: float = math.inf
    blocks: tuple[float, ...] = ()

    def __str__(self) -> str:
        names = ", ".join(self.named)
        judged = f"criterion {self.criterion:.1f}"
        if self.blocks:
            judged = f"{self.unseen:.4g} on blocks left out"
        return f"{names}: rms {self.rmse:.4g}, {judged}"

    @property
    def unseen(self) -> float:
        """The mean of its errors on the blocks, output units; infinite without any."""
        return sum(self.blocks) / len(self.blocks) if self.blocks else math.inf

    @property
    def named(self) -> Sequence[str]:
        """What it is made of: its terms, and numbers that were fitted in them."""
        numbers = [f"{name} = {x:.4g}" for name, x in self.numbers.items()]
        return [*self.terms, *numbers]

    @property
    def support(self) -> Support:
        """Its terms by name, and the numbers that are fitted in them."""
        return *self.terms, *self.numbers

    @property
    def size(self) -> tuple[int, int]:
        """How many terms it has, and how many numbers are fitted in them."""
        return len(self.terms), len(self.numbers)


def information_criterion(
    variance: float, samples: float, unknowns: int, laws: float
) -> float:
    """The extended Bayesian information criterion of a fit, the less the better.

    The more laws of a size there are, the better the best of them follows noise; the
    criterion takes that into account, where the ordinary one does not.

    **Arguments:** the mean square of the residuals of so many independent `samples`;
    the number of fitted `unknowns`; and how many `laws` of the size there were to
    choose from.

    **Source:** Chen and Chen (2008), doi 10.1093/biomet/asn034, with gamma = 1.
    """
    penalty = unknowns * math.log(samples) + 2 * math.log(laws)
    return samples * math.log(variance) + penalty


def laws_off_grid(library: Library) -> list[float]:
    """How many laws there are of no term, of one, and so on, of which all numbers are
    fitted: which of the grid's numbers they began at is no choice, but only how many
    operators of a kind there are."""
    kinds = Counter(_without_numbers(term) for term in library.terms)
    laws = np.ones(1)
    for count in kinds.values():
        laws = np.convolve(laws, np.ones(count + 1))
    return laws.tolist()


def _without_numbers(term: Term) -> Term:
    """A term with other numbers in the place of its own."""
    names = [f"{v.name}.{what}" for v in variables_of((term,)) for what in v.numbers]
    return term.with_numbers(dict.fromkeys(names, 1.0))


def plainness(terms: Sequence[Term], fitted: int = 0) -> tuple[int, float, int]:
    """How many terms a law has, and numbers in these, fitted or still on the grid, for
    of a law that is chosen they are fitted; the sum of its degrees; and how many
    numbers are `fitted`. Less is plainer."""
    numbers = sum(len(variable.numbers) for variable in variables_of(tuple(terms)))
    return len(terms) + numbers, sum(term.degree for term in terms), fitted


EQUAL = 0.1
"""Difference of criteria of laws whose terms the recording makes equal: fits end
nearby."""


def plainest(
    laws: Sequence[tuple[int, float, int]],
    criteria: Float[np.ndarray, "*b m"],
    equal: float = EQUAL,
) -> Int[np.ndarray, "*b"]:
    """Which of m laws is the plainest, by the `plainness` of each, of those whose
    criterion is finite: it has the fewest terms and numbers; of as many the one of most
    evidence is taken, and degrees count where that is `equal`."""
    size, *rest = np.array(laws).T
    left = np.isfinite(criteria)
    keys = [(size, 0.0), (criteria, equal), *((key, 0.0) for key in rest)]
    for key, apart in [*keys, (criteria, 0.0)]:
        key = np.where(left, key, np.inf)
        left = key <= np.min(key, axis=-1, keepdims=True) + apart
    return np.asarray(np.argmax(left, axis=-1))


def by_name(library: Library) -> dict[str, Term]:
    """The candidate terms by name."""
    return dict(zip(library.names, library.terms, strict=True))


HARDLY = 2.0
"""Difference of criteria that is not worth more than a bare mention.

**Source:** Kass and Raftery (1995), doi 10.1080/01621459.1995.10476572.
"""


def _nowhere(near: Sequence[Trial]) -> list[float]:
    return [0.0] * len(near)


def ordered(
    found: Iterable[Trial],
    library: Library,
    far: Callable[[Sequence[Trial]], Sequence[float]] = _nowhere,
    equal: float = EQUAL,
) -> tuple[Trial, ...]:
    """Laws, the chosen one first, then those judged by blocks by their error there, and
    the others by their criterion.

    Where laws were judged by blocks, what the others claim is not looked at. Of the
    contenders the one is chosen that goes least far from them, as `far` tells of all of
    these. Of those that go as far it is the plainest, as `plainest` tells with what is
    `equal`: out of many candidates one or the other follows noise by chance. A number
    in a term is worth as much as a term.
    """
    known = by_name(library)
    ranked = sorted(found, key=lambda trial: (trial.unseen, trial.criterion))
    if not ranked:
        return ()
    near = contenders(ranked)
    for trial in near:
        if not trial.terms:  # nothing follows clearly better than without a law
            return trial, *(other for other in ranked if other is not trial)
    distances = far(near)
    least = min(distances)
    near = [t for t, x in zip(near, distances, strict=True) if x == least]
    laws = [plainness([known[n] for n in t.terms], len(t.numbers)) for t in near]
    criteria = np.array([trial.criterion for trial in near], float)
    chosen = near[int(plainest(laws, criteria, equal))]
    return chosen, *(other for other in ranked if other is not chosen)


def alike(found: Sequence[Trial]) -> tuple[Trial, ...]:
    """Laws, after the chosen one, that are hardly told from the best."""
    return tuple(other for other in _near(found) if other is not found[0])


def contenders(found: Sequence[Trial]) -> list[Trial]:
    """Laws that are hardly told from the best, but for those that have more terms and
    numbers than another of them and by the criterion less evidence: these follow
    coloured noise.

    **Source:** Madigan and Raftery (1994), doi 10.2307/2291017: Occam's window.
    """
    near = _near(found)

    def in_excess(trial):
        return any(
            sum(each.size) < sum(trial.size)
            and each.criterion < trial.criterion - HARDLY
            for each in near
        )

    return [trial for trial in near if not in_excess(trial)]


# Times the least error on blocks, beyond which no law is near it: of few blocks the
# standard error tells little.
_FAR = 2.0

# Times the error on all samples, which plainness is worth. From 1.1 to 1.4 the laws of
# four measured devices are the same; with 1.05 that of a friction damper misses another
# of its records by 56 % for 6 %.
_COST = 1.1


def _near(found: Sequence[Trial]) -> list[Trial]:
    """Those hardly told from the best: by one standard error of how much more they miss
    the blocks, if not by twice as much, and by a tenth of how much they miss all
    samples; or by their criterion.

    One block that all laws miss makes the standard error so large that it tells nothing
    apart; what a law misses of all samples still does.

    **Source:** Breiman, Friedman, Olshen and Stone (1984), Classification and
    Regression Trees, section 3.4.3, ISBN 0-412-04841-8: the rule of one standard
    error, here of differences block by block, which have much in common.
    """
    judged = [trial for trial in found if math.isfinite(trial.unseen)]
    if judged:
        errors = np.array([trial.blocks for trial in judged])
        means = np.mean(errors, axis=1)
        least = np.min(means)
        more = errors - errors[np.argmin(means)]
        unsure = np.std(more, axis=1, ddof=1) / np.sqrt(errors.shape[1])
        near = means <= np.minimum(least + unsure, _FAR * least)
        # That there is no law has to follow best of all.
        near &= [
            bool(trial.terms) or not np.any(row)
            for trial, row in zip(judged, more, strict=True)
        ]
        close = [trial for trial, is_near in zip(judged, near, strict=True) if is_near]
        most = _COST**2 * min((t.squares for t in close if t.terms), default=math.inf)
        return [trial for trial in close if not trial.terms or trial.squares <= most]
    least = min((trial.criterion for trial in found), default=math.inf)
    return [trial for trial in found if trial.criterion < least + HARDLY]


def frontier(found: Iterable[Trial]) -> dict[int, Trial]:
    """The best law of each number of terms, of laws with the best first."""
    best: dict[int, Trial] = {}
    for trial in found:
        best.setdefault(len(trial.terms), trial)
    return dict(sorted(best.items()))


_LAGS = 40  # at most, and an even number
_WHITE = 0.01  # probability from which residuals are taken for white


@jit
def independent_share(
    residuals: Float[Array, "r n"], used: Bool[Array, "r n"]
) -> Float[Array, ""]:
    """Which share of samples, if they were independent, would tell as much of a mean.

    What a law leaves of measured data is seldom white, and criteria that count every
    sample then take any small structure for certain. White residuals count whole, and
    their share is exactly 1: the sum of their estimated autocorrelations is nothing but
    chance.

    **Arguments:** residuals of R recordings; and which of them are samples, where
    others fill up short recordings.

    **Source:** Geyer (1992), doi 10.1214/ss/1177011137: autocorrelations are summed in
    pairs up to the first that is not positive; Ljung and Box (1978), doi
    10.1093/biomet/65.2.297: whether they are white, at a level of 1 %, with their
    standard errors under uneven noise as in Lobato, Nankervis and Savin (2001), doi
    10.1111/1468-2354.00106.
    """
    total, residuals = jnp.sum(used), jnp.where(used, residuals, 0.0)
    products = _products(residuals)
    correlation = products / _or_one(products[0])
    lags = min(_LAGS, len(correlation) - 1) // 2 * 2
    # Noise that grows with the output is loud together, and makes these scatter more.
    pairs = jnp.round(_products(jnp.where(used, 1.0, 0.0)))  # by transforms
    scatter = (
        _products(residuals**2) / _or_one(pairs) / _or_one(products[0] / total) ** 2
    )
    scaled = correlation / jnp.sqrt(_or_one(scatter))
    white = ljung_box(scaled[1 : lags + 1], total, pairs[1 : lags + 1]) > _WHITE
    return 1 / jnp.where(white, 1.0, _correlation_time(correlation))


def _products(x: Float[Array, "r n"]) -> Float[Array, " n"]:
    """Sums of the products of samples so many apart, over all recordings."""
    length = 1 << (2 * x.shape[1]).bit_length()  # no lag wraps around
    power = jnp.abs(jnp.fft.rfft(x, length)) ** 2
    return jnp.sum(jnp.fft.irfft(power, length), axis=0)[: x.shape[1]]


def _or_one(x):
    return jnp.where(x > 0, x, 1.0)


def _correlation_time(correlation: Float[Array, " n"]) -> Float[Array, ""]:
    """In samples: the sum of autocorrelations at all lags, before and after."""
    even = correlation[: 2 * (len(correlation) // 2)]
    pairs = even.reshape(-1, 2).sum(axis=1)
    counted = jnp.cumprod(pairs > 0)
    return jnp.maximum(2 * jnp.sum(pairs * counted) - 1, 1.0)


# Natural logarithms of the shares looked at: the likelihood is flat at its maximum.
_SHARES = np.arange(-4.0, 7.05, 0.1)


def weights(
    outputs: Float[Array, "r n"],
    residuals: Float[Array, "r n"],
    used: Bool[Array, "r n"],
    samples: Shaped[ArrayLike, ""],
) -> Float[Array, "r n"] | None:
    """The inverse of each sample's variance, of mean 1, if that grows with the output;
    `None` if it does not.

    The variance is taken for s^2 (1 + a w^2 / mean(w^2)) of the simulated output w. By
    the likelihood of Gaussian noise with the best s, the best a is found; it counts if
    the Bayesian information criterion prefers it to none.

    **Arguments:** simulated outputs, and their residuals; which of them are samples;
    and how many independent ones they are worth.

    **Source:** Davidian and Carroll (1987), doi 10.1080/01621459.1987.10478543, for
    estimates of variance functions; Schwarz (1978), doi 10.1214/aos/1176344136.
    """
    gain, inverse = _likeliest(outputs, residuals, used)
    return inverse if samples * gain > np.log(samples) else None


@jit
def _likeliest(outputs, residuals, used):
    """What the best share gains in twice the logarithm of the likelihood, a sample; and
    the inverse of the variance there, of mean 1."""
    deviance, variances = _profile(outputs, residuals, used)
    best, total = jnp.argmin(deviance), jnp.sum(used)
    inverse = jnp.where(used, 1 / variances[best], 0.0)
    gain = (_even(residuals, used) - deviance[best]) / total
    return gain, inverse * total / jnp.sum(inverse)


def _profile(outputs, residuals, used):
    """Twice the negative logarithm of the likelihood at each share, up to what all have
    in common; and variances there, up to a factor."""
    size = jnp.where(used, outputs**2, 0.0)
    relative = size * jnp.sum(used) / jnp.sum(size)
    # Of their own precision: JAX keeps what it has traced.
    shares = jnp.exp(jnp.asarray(_SHARES, outputs.dtype))
    variances = 1 + shares[:, None, None] * relative
    logarithms = jnp.sum(jnp.where(used, jnp.log(variances), 0.0), axis=(1, 2))
    scaled = residuals / jnp.sqrt(variances)
    return logarithms + jax.vmap(_even, (0, None))(scaled, used), variances


def _even(residuals, used):
    """The same for even noise."""
    total = jnp.sum(used)
    return total * jnp.log(jnp.sum(jnp.where(used, residuals**2, 0.0)) / total)


_MOST = 500_000  # supports that are looked at one by one
_BEAM = 2000  # supports that are grown where there are more
_CHUNK = 8192  # small solves at a time
_ROWS, _TERMS = 4096, 4  # to multiples of which supports are filled up
_RIDGE = 100.0  # roundings


class Ranking(eqx.Module):
    """Supports of s terms, the best first.

    **Attributes:**

    - `rows`: which terms, shape (c, s).
    - `coefficients`: of least squares on each support, shape (c, s).
    - `residuals`: relative misfits, shape (c,).
    """

    rows: Int[Array | np.ndarray, "c s"]
    coefficients: Float[Array | np.ndarray, "c s"]
    residuals: Float[Array | np.ndarray, " c"]


def supports(
    terms: int,
    size: int,
    shorter: Int[Array | np.ndarray, "c t"] | None = None,
    most: int = _MOST,
) -> Int[np.ndarray, "m s"]:
    """Supports of `size` out of `terms`: all of them, or where these are more than
    `most`, the shorter ones that are given, each with one term more."""
    if shorter is None or math.comb(terms, size) <= most:
        every = itertools.chain.from_iterable(
            itertools.combinations(range(terms), size)
        )
        return np.fromiter(every, int).reshape(-1, size)
    grown = {
        tuple(sorted((*map(int, row), extra)))
        for row in np.asarray(shorter)
        for extra in set(range(terms)) - set(map(int, row))
    }
    return np.array(sorted(grown))


def ranking(
    problem: LeastSquaresProblem, rows: Int[np.ndarray, "m s"], count: int
) -> Ranking:
    """The best supports of least squares.

    By normal equations of normalised columns, which are precise enough to rank.

    **Arguments:** the factored problem; the supports to look at; and how many of them
    are wanted, at most.

    **Source:** Miller (2002), doi 10.1201/9781420035933.
    """
    best = _ranking(problem, np.asarray(rows), count)
    return _part(best, min(count, len(rows)), np.shape(rows)[1])


def _ranking(problem: LeastSquaresProblem, rows: np.ndarray, count: int) -> Ranking:
    """As `ranking`, filled up: few programs serve supports of all sizes."""
    # The number of samples has no part in it, and would make another program.
    bare = replace(problem, rows=0)
    m, s = rows.shape
    shape = -(-m // _ROWS) * _ROWS, -(-s // _TERMS) * _TERMS
    filled, used = np.zeros(shape, int), np.zeros(shape, bool)
    filled[:m, :s], used[:m, :s] = rows, True
    return _ranked(bare, filled, used, min(count, len(filled)))


def _part(ranking: Ranking, count: int, size: int) -> Ranking:
    return Ranking(
        ranking.rows[:count, :size],
        ranking.coefficients[:count, :size],
        ranking.residuals[:count],
    )


def rankings(
    problem: LeastSquaresProblem,
    largest: int,
    count: int,
    beam: int = _BEAM,
    most: int = _MOST,
) -> Iterator[Ranking]:
    """The best supports of each size up to the `largest`.

    **Arguments:** the factored problem; how many supports of a size are wanted; and of
    sizes with more than `most` supports, how many of the size before are grown.
    """
    grown = None
    for size in range(1, min(largest, len(problem.target)) + 1):
        rows = supports(len(problem.target), size, grown, most)
        # As many whatever is asked for: one program for all problems of these terms.
        best = jax.device_get(_ranking(problem, rows, max(count, beam, _BEAM)))
        grown = _part(best, min(beam, len(rows)), size).rows
        yield _part(best, min(count, len(rows)), size)


@jit
def _ranked(problem: LeastSquaresProblem, rows, used, count: int) -> Ranking:
    solutions, left = solved(problem, rows, used)
    # What is not a number comes last, and what only fills up after that.
    last = jnp.where(jnp.isfinite(left), left, jnp.finfo(left.dtype).max)
    _, best = jax.lax.top_k(-jnp.where(used[:, 0], last, jnp.inf), count)
    residuals = jnp.sqrt(jnp.maximum(left[best], 0.0))
    return Ranking(rows[best], solutions[best], residuals)


def solved(
    problem: LeastSquaresProblem,
    rows: Int[Array, "m s"],
    used: Bool[Array, "m s"] | None = None,
) -> tuple[Float[Array, "m s"], Float[Array, " m"]]:
    """For each support the coefficients of least squares, and the share of the target's
    square that they leave. Terms that are not used have the coefficient 0."""
    lengths = jnp.linalg.norm(problem.triangle, axis=0)
    lengths = jnp.where(lengths > 0, lengths, 1.0)
    columns = problem.triangle / lengths
    gram, right = columns.T @ columns, columns.T @ problem.target
    size = jnp.sum(problem.target**2) + problem.remainder**2
    used = jnp.ones(rows.shape, bool) if used is None else used

    def solve(row, used):
        both, target = used & used[:, None], jnp.where(used, right[row], 0.0)
        matrix = jnp.where(both, gram[row][:, row], jnp.eye(len(row), dtype=gram.dtype))
        # Of terms that make each other up, rounding would else have any misfit.
        matrix += _RIDGE * jnp.finfo(gram.dtype).eps * jnp.eye(len(row))
        chosen = jnp.linalg.solve(matrix, target)
        return chosen / lengths[row], (size - target @ chosen) / size

    return jax.lax.map(lambda each: solve(*each), (rows, used), batch_size=_CHUNK)


def extensions(
    problem: LeastSquaresProblem, support: tuple[int, ...]
) -> Iterator[tuple[tuple[int, ...], Float[np.ndarray, " s"]]]:
    """Supports with one term more, those first whose term explains most of what the
    support leaves, and their coefficients of least squares.

    **Source:** Chen, Billings and Luo (1989), doi 10.1080/00207178908953472: a step of
    forward selection by orthogonal least squares.
    """
    columns, target = np.asarray(problem.triangle), np.asarray(problem.target)
    basis, _ = np.linalg.qr(columns[:, support])
    # Columns of terms by which a law runs away may be too large to be squared: they are
    # of no use, and their gains not finite.
    with np.errstate(over="ignore", invalid="ignore"):
        new = columns - basis @ (basis.T @ columns)
        sizes, lengths = (np.linalg.norm(each, axis=0) for each in (new, columns))
        usable = sizes > np.finfo(sizes.dtype).eps ** 0.5 * lengths
        gains = np.abs(target @ new) / np.where(usable, sizes, 1.0)
    gains[[*support, *np.flatnonzero(~usable)]] = -np.inf
    for term in np.argsort(-gains)[: np.count_nonzero(np.isfinite(gains))].tolist():
        longer = tuple(sorted((*support, term)))
        yield longer, solution(columns[:, longer], target)


class Choice(AbstractSum):
    """Some terms of a library, told by an array: laws of other terms are then other
    values of one compiled program, and a batch of them is fitted side by side.

    **Attributes:**

    - `library`: the k candidates.
    - `rows`: which of them, shape (s,).
    - `used`: whether each takes part, shape (s,); laws of fewer terms are padded.
    - `coefficients`: s scalars.
    - `known`: coefficients of a part that all have, shape (k,), if there is one.
    - `places`: of q numbers in the terms, such as radii, those that are fitted too,
        their places among the library's, shape (q,); beyond the last, of none.
    - `numbers`: these, q scalars.
    - `target`: what the law gives, the `"rate"` or the `"value"`; keyword only.
    """

    library: Library
    rows: Int[Array, " s"]
    used: Bool[Array, " s"]
    coefficients: tuple[Float[Array, ""], ...]
    known: Float[Array, " k"] | None = None
    places: Int[Array, " q"] | None = None
    numbers: tuple[Float[Array, ""], ...] = ()
    target: str = eqx.field(static=True, kw_only=True, default="rate")

    @property
    def memory(self):
        return self.moved().memory

    def made(self, w, m, now):
        library = self.moved()
        signals = library.memory.values(m, now)
        return library.weighted(self.spread(), w, now.u, now.du, signals)

    def moved(self) -> Library:
        """The candidates, with the numbers that are fitted."""
        if not self.numbers:
            return self.library
        every = self.library.numbers
        grid, numbers = (jnp.stack([*x]) for x in (every.values(), self.numbers))
        here = jax.nn.one_hot(self.places, len(grid), dtype=grid.dtype)
        new = jnp.where(jnp.sum(here, axis=0) > 0, numbers @ here, grid)
        return self.library.with_numbers(dict(zip(every, new, strict=True)))

    def spread(self) -> Float[Array, " k"]:
        """A coefficient for every candidate."""
        places = jax.nn.one_hot(self.rows, len(self.library)) * self.used[:, None]
        values = jnp.stack(self.coefficients)
        found = values @ places.astype(values.dtype)
        return found if self.known is None else found + self.known

    def parameters(self):
        every = (*self.coefficients, *self.numbers)
        return {str(i): value for i, value in enumerate(every)}

    def with_parameters(self, values):
        new = tuple((self.parameters() | dict(values)).values())
        size = len(self.coefficients)
        parts = new[:size], new[size:]
        return eqx.tree_at(lambda law: (law.coefficients, law.numbers), self, parts)

    def addends(self):
        weights = self.spread().tolist()
        return tuple(zip(weights, self.library.terms, strict=True))


Around: TypeAlias = Callable[[AbstractLaw], AbstractModel]


def itself(law: AbstractLaw) -> AbstractModel:
    """The model around a law of the recorded output: none."""
    return law


class OfValue(eqx.Module):
    """What makes a model of a law, of one that gives the value of its output.

    **Attributes:** `around`, which makes it of laws of the rate too.
    """

    around: Around

    def __call__(self, law: Any) -> AbstractModel:
        """The model around the law, which gives the value from now on."""
        return self.around(replace(law, target="value"))


def targeted(around: Around, target: str) -> Around:
    """What makes a model of a law that gives the rate, or the value."""
    return OfValue(around) if target == "value" else around


def alone(around: Around) -> bool:
    """Whether there is nothing around a law, of the rate or of the value."""
    return (around.around if isinstance(around, OfValue) else around) is itself


@jit
def output_error(
    samples: Samples,
    library: Library,
    coefficients: Float[Array | np.ndarray, " k"],
    starts: Float[Array, " r"],
    outputs: Float[Array, "b r n"] | None = None,
    around: Around = itself,
    own: Mapping[str, Float[Array, ""]] | None = None,
) -> LeastSquaresProblem:
    """The misfit of the free run as a least-squares problem in the coefficients of all
    k candidates, about one law.

    Regressions of the derivative see noise that the free run averages out, and miss
    drifts that it adds up. Here the misfit itself is regressed on its sensitivities, so
    that the supports of least misfit can be looked for without simulating each.

    **Arguments:** what is matched; the candidates; and of the law the coefficients,
    zero for terms it does not have, and first outputs. These are free too. Of other
    `outputs` than those of the samples there are b problems, along a leading axis of
    `target` and `remainder`. Then the model `around` the law, and its `own` numbers by
    name, which are free as well.

    **Source:** Ljung (1999), System Identification, 2nd ed., section 10.2, ISBN
    0-13-656695-2: Gauss-Newton steps of output-error models.
    """
    law = SparseModel(library, coefficients, np.ones(len(library), bool))
    model = around(law).with_parameters(own or {})
    fitted = parameters(model, tuple(library.numbers), {}, {})
    objective = Objective(fitted, samples, Squares(), 1, 0.0, free_of(model))
    run = linearised(objective, first_unknowns(objective, starts))
    root = jnp.sqrt(samples.weight).ravel()
    jacobian = root[:, None] * run.jacobian
    terms = np.array([run.names.index(name) for name in library.names])
    others = np.setdiff1d(np.arange(len(run.names)), terms)
    by_terms = jacobian[:, terms]
    whole = jnp.concatenate([jacobian[:, others], by_terms], axis=1)

    def about(measured):
        misfit = root * (run.run.outputs - measured).ravel()
        return compress(whole, by_terms @ coefficients - misfit).beyond(len(others))

    if outputs is None:
        return about(samples.w)
    each = jax.lax.map(about, outputs)
    return eqx.tree_at(lambda p: p.triangle, each, each.triangle[0])
