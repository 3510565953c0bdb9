"""Laws drawn at random, whose terms are to be found in noisy records of them."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

import hystjax as hj
from hystjax.library import Library, Polynomial
from hystjax.models import SparseModel
from hystjax.signals.excitation import AbstractExcitation
from hystjax.simulation import FixedStep

from ._noisy import Noisy
from ._truth import Truth

_SAMPLES, _PERIODS = 1001, 10
_DURATION = 2 * np.pi * _PERIODS  # s
_FREQUENCY = 1 / (2 * np.pi)  # Hz
_DRAWN = 64  # laws at a time, few of which are kept
_SUBSTEPS = 16  # a sample interval: exact next to the noise
_LARGER = 1.5  # amplitude of the unseen excitation over that of the records
_ELSEWHERE = ((1.5, 1.0), (1.0, 3.0), (1.0, 0.5))  # times as large, and as fast
_NEAR = 3.0  # half ranges from the middle, within which outputs stay there
_FORGOTTEN = 0.05  # share of a difference at the start that may be left at the end
_ALIVE = 0.1  # least size of a term over that of the law
_AWAY = 0.2  # output at the start, to see whether that is forgotten
_SIZES = (0.1, 1.0)  # of coefficients
_RANGE = (0.2, 4.0)  # of the output
_NOISE = (0.02, 0.2)  # standard deviation over that of the output

ALWAYS_ALIKE = ("sine", "triangle")  # excitations of one amplitude and frequency


def _excitations(key: jax.Array) -> dict[str, AbstractExcitation]:
    frequencies = np.array([3, 7, 11]) / 10 * _FREQUENCY
    return {
        "sine": hj.excitation.Sine(1.0, _FREQUENCY),
        "decaying sine": hj.excitation.DecayingSine(1.5, _FREQUENCY, 30.0),
        "multisine": hj.excitation.Multisine(frequencies, np.sqrt(0.5), key=key),
        "chirp": hj.excitation.Chirp(1.0, _FREQUENCY / 4, 2 * _FREQUENCY, _DURATION),
        "triangle": hj.excitation.Triangle(1.0, _FREQUENCY, _PERIODS),
    }


@dataclass(frozen=True)
class Drawn:
    """A law, a noisy record of it, and what it does under an input that is not fitted.

    **Attributes:** the `excitation` by name; the `terms` with their coefficients; the
    `library` they were drawn from; the record `clean` and `noisy`; the `unseen`
    record, without noise, of a larger amplitude and other frequencies; and the law as
    the `truth` among those of the library.
    """

    excitation: str
    terms: dict[str, float]
    library: Library
    clean: hj.Recording
    noisy: Noisy
    unseen: hj.Recording

    truth: Truth

    def free_run(self, coefficients: np.ndarray) -> float:
        """The root mean square error of such a law on the unseen record, over the
        standard deviation of that; infinite where it runs away."""
        w = _runs(self.library, jnp.asarray(coefficients)[None], self.unseen, 0.0)
        missed = jnp.sqrt(jnp.mean((w[0] - self.unseen.w) ** 2))
        error = float(missed / jnp.std(self.unseen.w))
        return error if np.isfinite(error) else np.inf


def drawn(series: int, count: int) -> Iterator[Drawn]:
    """That many laws of a series of random numbers.

    They have two to five terms of degree two or three, depend on the rate or do not,
    and are observed under one of five excitations. Kept are laws that forget how they
    began, stay near under larger, faster and slower inputs, and of which every term
    matters and is told from simpler ones by the excitation.
    """
    times = np.linspace(0, _DURATION, _SAMPLES)
    for index in range(count):
        rng = np.random.default_rng((series, index))
        key = jax.random.key(rng.integers(2**32))
        kinds = _excitations(key)
        kind = list(kinds)[index % len(kinds)]
        degree = 2 + index // len(kinds) % 2
        yield _drawn(rng, kind, kinds[kind], Polynomial(degree), times)


def _drawn(rng, kind, excitation, library: Library, times) -> Drawn:
    candidates = _candidates(library, rate_dependent=bool(rng.integers(2)))
    frequencies = np.sort(rng.uniform(0.2, 2, 4)) * _FREQUENCY
    key = jax.random.key(rng.integers(2**32))
    other = hj.excitation.Multisine(frequencies, _LARGER * np.sqrt(0.5), key=key)
    seen, unseen = (_nothing(each, times) for each in (excitation, other))
    plain = _plain(seen, library)
    while True:
        laws = np.stack([_coefficients(rng, candidates & plain) for _ in range(_DRAWN)])
        for law in laws[_usable(library, laws, seen, unseen)]:
            return _observed(rng, kind, excitation, other, library, law, times)


def _candidates(library: Library, rate_dependent: bool) -> np.ndarray:
    """Which terms a law may have."""
    degrees = [term.rate_degree for term in library.terms]
    return np.array([rate_dependent or degree == 1 for degree in degrees])


def _plain(record: hj.Recording, library: Library) -> np.ndarray:
    """Which terms the excitation tells from simpler ones, whatever the output."""
    rng = np.random.default_rng(0)
    record = eqx.tree_at(
        lambda r: r.w, record, jnp.asarray(rng.normal(size=len(record)))
    )
    told = {alias.term for alias in hj.aliases(record, library)}
    return np.array([name not in told for name in library.names])


def _coefficients(rng, candidates: np.ndarray) -> np.ndarray:
    """Of a law of a few of these terms; signs and sizes are random."""
    law = np.zeros(len(candidates))
    terms = rng.choice(np.flatnonzero(candidates), rng.integers(2, 6), replace=False)
    law[terms] = rng.choice((-1, 1), len(terms)) * np.exp(
        rng.uniform(*np.log(_SIZES), len(terms))
    )
    return law


def _usable(library, laws, seen: hj.Recording, unseen: hj.Recording) -> np.ndarray:
    """Which laws forget how they began, stay bounded, and matter term by term."""
    laws = jnp.asarray(laws)
    w, away = (_runs(library, laws, seen, w0) for w0 in (0.0, _AWAY))
    left = jnp.abs(away - w)[:, -1] / _AWAY
    parts = laws[:, None] * jax.vmap(partial(_columns, library, seen))(w)
    least = jnp.min(jnp.where(laws != 0, jnp.std(parts, axis=1), jnp.inf), axis=1)
    alive = least > _ALIVE * jnp.std(jnp.sum(parts, axis=2), axis=1)
    low, high = _RANGE
    good = (left < _FORGOTTEN) & alive & (jnp.ptp(w, axis=1) > low)
    good &= (jnp.ptp(w, axis=1) < high) & jnp.all(jnp.isfinite(w), axis=1)
    middle = (jnp.max(w, axis=1) + jnp.min(w, axis=1))[:, None] / 2
    for other in (unseen, *(_changed(seen, *each) for each in _ELSEWHERE)):
        distance = jnp.abs(_runs(library, laws, other, 0.0) - middle)
        # A maximum may skip what is not a number.
        farthest = jnp.max(jnp.where(jnp.isnan(distance), jnp.inf, distance), axis=1)
        good &= farthest < _NEAR * jnp.ptp(w, axis=1) / 2
    return np.asarray(good)


def _changed(record: hj.Recording, larger: float, faster: float) -> hj.Recording:
    return hj.Recording(record.t / faster, larger * record.u, record.w)


def _columns(library: Library, record: hj.Recording, w):
    u, du = record.path.samples()
    return library(w, u, du)


def _observed(rng, kind, excitation, other, library, law, times) -> Drawn:
    model = _law(library, jnp.asarray(law))
    method = FixedStep(_SUBSTEPS)
    clean, unseen = (
        hj.generate(model, each, times, method=method) for each in (excitation, other)
    )
    w = np.asarray(clean.w)
    level = np.exp(rng.uniform(*np.log(_NOISE)))
    drawn = w + level * np.std(w) * rng.normal(size=len(w))
    terms = {n: float(c) for n, c in zip(library.names, law, strict=True) if c}
    truth = Truth(clean, library, terms)
    return Drawn(kind, terms, library, clean, Noisy.of(clean, drawn), unseen, truth)


def _nothing(excitation: AbstractExcitation, times) -> hj.Recording:
    """The input, and no output yet."""
    u, _ = excitation.path(times).samples()
    between = excitation.interpolation
    return hj.Recording(times, u, np.zeros(len(times)), interpolation=between)


def _law(library: Library, coefficients) -> SparseModel:
    """One whose form is that of all laws of the library, which share programs."""
    return SparseModel(library, coefficients, np.ones(len(library), bool))


@eqx.filter_jit
def _runs(library: Library, laws, record: hj.Recording, w0):
    """Outputs of laws, a row each."""
    method = FixedStep(_SUBSTEPS)

    def run(law):
        model = _law(library, law)
        return hj.simulate(model, record, w0=w0, method=method, throw=False).w

    return jax.vmap(run)(laws)
