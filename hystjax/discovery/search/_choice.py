"""Laws that are tried, and what decides between them: the criterion, plainness, how
many samples correlated residuals are worth, and noise that grows with the output."""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import TypeAlias

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Bool, Float, Shaped

from ..._core.compiling import jit
from ...library import Library, Term
from ...refinement import ljung_box

Plainness = tuple[int, float]


def plainness(terms: Sequence[Term], numbers: int = 0) -> Plainness:
    """A key by which the plainest law comes first: of the fewest terms and numbers
    fitted in these, and of those the one of the lowest degrees."""
    return len(terms) + numbers, sum(term.degree for term in terms)


HARDLY = 2.0
"""Difference of criteria that is not worth more than a bare mention.

**Source:** Kass and Raftery (1995), doi 10.1080/01621459.1995.10476572.
"""


_COST = 1.1  # times the error on all samples, which plainness is worth


Support: TypeAlias = tuple[str, ...]


@dataclass(frozen=True)
class Trial:
    """A law that is tried, from the guess it begins with to what is told of it.

    What only a refinement can tell is infinite in a guess.

    **Attributes:**

    - `terms`: coefficients by term, in the order of the library.
    - `rmse`: root mean square error of its refined free run, output units, over all
        recordings.
    - `criterion`: the extended Bayesian information criterion; what matters are
        differences, among the laws of one search.
    - `numbers`: those in its terms, such as radii, that were fitted with it, by name;
        all others are as the names of the terms show them.
    - `kept`: share of a difference between initial values that is left at the end of
        the recording that keeps most; `None` where the law's output is hidden.
    - `own`: numbers of the model around the law, by name.
    - `starts`: first simulated output of each recording; none in a guess, which begins
        with the measured ones.
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
    variance: float, samples: float, unknowns: int, terms: int, candidates: int
) -> float:
    """The extended Bayesian information criterion of a fit, the less the better.

    The more laws of a size there are, the better the best of them follows noise; the
    criterion takes that into account, where the ordinary one does not.

    **Arguments:** the mean square of the residuals of so many independent `samples`;
    the number of fitted `unknowns`; and how many `terms` were chosen out of how many
    `candidates`.

    **Source:** Chen and Chen (2008), doi 10.1093/biomet/asn034, with gamma = 1.
    """
    choices = math.log(math.comb(candidates, terms))
    return samples * math.log(variance) + unknowns * math.log(samples) + 2 * choices


def _nowhere(near: Sequence[Trial]) -> list[float]:
    return [0.0] * len(near)


def ordered(
    found: Iterable[Trial],
    library: Library,
    far: Callable[[Sequence[Trial]], Sequence[float]] = _nowhere,
) -> tuple[Trial, ...]:
    """Laws, the chosen one first, then those judged by blocks by their error there, and
    the others by their criterion.

    Where laws were judged by blocks, what the others claim is not looked at. Of the
    contenders the one is chosen that goes least far from them, as `far` tells of all of
    these. Of those that go as far it is the plainest: out of many candidates one or the
    other follows noise by chance. A number that is fitted in a term is worth as much as
    a term.
    """
    by_name = dict(zip(library.names, library.terms, strict=True))

    def rank(trial):
        terms = [by_name[name] for name in trial.terms]
        # Blocks hardly tell these apart; of as many terms all samples may.
        plain = plainness(terms, len(trial.numbers))
        return (plain[0], trial.criterion) if trial.blocks else plain

    ranked = sorted(found, key=lambda trial: (trial.unseen, trial.criterion))
    if not ranked:
        return ()
    near = contenders(ranked)
    _, chosen = min(
        zip(far(near), near, strict=True), key=lambda each: (each[0], rank(each[1]))
    )
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


def _near(found: Sequence[Trial]) -> list[Trial]:
    """Those hardly told from the best: by one standard error of how much more they miss
    the blocks, and a tenth of how much they miss all samples; or by their criterion.

    One block that all laws miss makes the standard error so large that it tells nothing
    apart; what a law misses of all samples still does.

    **Source:** Breiman, Friedman, Olshen and Stone (1984), Classification and
    Regression Trees, section 3.4.3, ISBN 0-412-04841-8: the rule of one standard
    error, here of differences block by block, which have much in common.
    """
    judged = [trial for trial in found if math.isfinite(trial.unseen)]
    if judged:
        errors = np.array([trial.blocks for trial in judged])
        more = errors - errors[np.argmin(np.mean(errors, axis=1))]
        unsure = np.std(more, axis=1, ddof=1) / np.sqrt(errors.shape[1])
        near = np.mean(more, axis=1) <= unsure
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
def effective_samples(
    residuals: Float[Array, "r n"], used: Bool[Array, "r n"]
) -> Float[Array, ""]:
    """The number of independent samples with the same information about a mean.

    What a law leaves of measured data is seldom white, and criteria that count every
    sample then take any small structure for certain. White residuals count whole: the
    sum of their estimated autocorrelations is nothing but chance.

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
    pairs = _products(jnp.where(used, 1.0, 0.0))
    scatter = (
        _products(residuals**2) / _or_one(pairs) / _or_one(products[0] / total) ** 2
    )
    scaled = (correlation / jnp.sqrt(_or_one(scatter)))[1 : lags + 1]
    white = ljung_box(scaled, total) > _WHITE
    return total / jnp.where(white, 1.0, _correlation_time(correlation))


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
    variances = 1 + jnp.exp(_SHARES)[:, None, None] * relative
    logarithms = jnp.sum(jnp.where(used, jnp.log(variances), 0.0), axis=(1, 2))
    scaled = residuals / jnp.sqrt(variances)
    return logarithms + jax.vmap(_even, (0, None))(scaled, used), variances


def _even(residuals, used):
    """The same for even noise."""
    total = jnp.sum(used)
    return total * jnp.log(jnp.sum(jnp.where(used, residuals**2, 0.0)) / total)
