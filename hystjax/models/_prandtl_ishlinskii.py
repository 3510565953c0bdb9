"""Plays in parallel: the operator of Prandtl and Ishlinskii."""

from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from .._core import checks
from .._core.checks import InputError
from .._core.compiling import jit
from ..least_squares import NonNegative, compress
from ..library import AbstractMemory, Plays, Term, Weighted
from ..recording import Recording
from ..saving import Storable
from ._base import AbstractOperatorLaw
from ._numbers import Numbers, number, numbers

_LEAST = 1e-3  # share of the sum of weights below which an operator is left out


def inputs_of(what: str, recording: Recording) -> tuple[float, float]:
    """The lowest and the highest input of a record that a first model can be read off.

    **Raises:** `InputError` where input or output never change, or samples are few.
    """
    checks.concrete(f"`{what}.guess`", recording)
    checks.enough_samples(f"`{what}.guess`", len(recording), 10)
    why = "there is no loop to read a model off."
    checks.not_constant("u", recording.u, why)
    checks.not_constant("w", recording.w, why)
    return float(jnp.min(recording.u)), float(jnp.max(recording.u))


_BINS = 2000  # of the input, in which the output's travel is counted
_EVEN = 0.2  # of what is shared, that goes to all inputs alike


def inputs_by_travel(
    what: str, recording: Recording, shares: Float[np.ndarray, " k"]
) -> Float[np.ndarray, " k"]:
    """Inputs up to which such shares of what the output travels lie, from 0, the lowest
    input, to 1, the highest; of records, and with what is raised, as `inputs_of`.

    So a grid is dense where the output changes, such as near the coercive field of a
    magnet that is driven far into saturation; a fifth is shared evenly over the range,
    so that it is nowhere empty.

    **Source:** de Boor (1974), doi 10.1007/BFb0069121: nodes that equidistribute a
    function's variation.
    """
    edges = np.linspace(*inputs_of(what, recording), _BINS + 1)
    u, w = np.asarray(recording.u), np.asarray(recording.w)
    middles, travel = (u[1:] + u[:-1]) / 2, np.abs(np.diff(w))
    counted, _ = np.histogram(middles, edges, weights=travel)
    part = np.cumsum([0.0, *counted]) / np.sum(counted)
    reached = _EVEN * np.linspace(0, 1, len(edges)) + (1 - _EVEN) * part
    return np.interp(shares, reached, edges)


@jit
def _sum(
    columns: Float[Array, "n k"], w: Float[Array, " n"], weight: Float[Array, " n"]
):
    """Weights of least squares, zero or more, but for that of a constant; what they
    leave, relative; and the constant."""
    # The constant may have either sign: without means, none is needed.
    total, root = jnp.sum(weight), jnp.sqrt(weight)
    means, mean = weight @ columns / total, weight @ w / total
    problem = compress(root[:, None] * (columns - means), root * (w - mean))
    weights = NonNegative().fit(problem).coefficients
    return weights, problem.residual(weights), mean - means @ weights


def best_sum(
    families: Sequence[Float[Array, "n _k"]],
    w: Float[Array, " n"],
    weight: Float[Array, " n"] | None = None,
) -> tuple[int, float, np.ndarray, float]:
    """The family of columns, and the sign, whose sum with weights of that sign is
    closest to an output.

    **Arguments:** the families, the output, and by what `weight` each sample counts,
    all the same by default.

    **Returns:** the number of the family; the sign; the weights, without small ones,
    which noise makes; and the constant beside them.
    """
    weight = jnp.ones_like(w) if weight is None else weight
    found = [
        (sign, family, *_sum(columns, sign * w, weight))
        for family, columns in enumerate(families)
        for sign in (1.0, -1.0)
    ]
    sign, family, weights, _, constant = min(found, key=lambda each: float(each[3]))
    kept = np.asarray(weights)
    kept = np.where(kept > _LEAST * np.sum(kept), kept, 0.0)
    return family, sign, sign * kept, sign * float(constant)


_GRID = 40  # radii that `guess` tries


class Envelope(Storable):
    """A function of the input that saturates: scale tanh(slope u + shift) + offset.

    **Attributes:** `scale` and `offset`, in the units of the radii; `slope`, over input
    units; `shift`, without unit. All scalars, `scale` and `slope` positive.
    """

    scale: Float[Array, ""] = eqx.field(converter=number)
    slope: Float[Array, ""] = eqx.field(converter=number)
    shift: Float[Array, ""] = eqx.field(converter=number, default=0.0)
    offset: Float[Array, ""] = eqx.field(converter=number, default=0.0)

    def __check_init__(self):
        checks.positive("scale", self.scale)
        checks.positive("slope", self.slope)

    def __call__(self, u: Float[Array, "*s"]) -> Float[Array, "*s"]:
        """Its value at an input."""
        return self.scale * jnp.tanh(self.slope * u + self.shift) + self.offset


class PrandtlIshlinskii(AbstractOperatorLaw):
    """Plays in parallel: w = offset + sum of weights[i] play(u, radii[i]).

    Loops are symmetric, congruent and close. With `rising` and `falling`, functions of
    the input that pull plays up and down in place of the input itself, loops are those
    of the generalised model: they saturate, and need not be symmetric.

    Positive weights make an output that lags behind its input, such as a piezo's.
    Those of an output that leads, such as a friction force over a position, are
    positive for stops: see `of_stops`.

    **Attributes:**

    - `radii`: shape (k,), input units (those of the envelopes where there are some),
        from 0; a play of radius 0 is the input itself. Their sign has no meaning.
    - `weights`: shape (k,), output over input units.
    - `offset`: a scalar, output units, 0 by default.
    - `rising`, `falling`: an `Envelope` each, or `None` for the input itself; `rising`
        nowhere above `falling`.
    - `names`, `units`: of input and output; keyword only.

    **Raises:** `InputError` for radii and weights of different number.

    **Source:** Krasnosel'skii and Pokrovskii (1989), doi 10.1007/978-3-642-61302-9;
    with envelopes Al Janaideh, Rakheja and Su (2011), doi 10.1109/TMECH.2010.2052366.
    """

    radii: Float[Array, " k"] = eqx.field(converter=numbers)
    weights: Float[Array, " k"] = eqx.field(converter=numbers)
    offset: Float[Array, ""] = eqx.field(converter=number, default=0.0)
    rising: Envelope | None = None
    falling: Envelope | None = None

    def __check_init__(self):
        checks.same_length(radii=self.radii, weights=self.weights)
        if self.radii.shape[-1:] == (0,):
            raise InputError("a model of plays needs at least one radius, got none.")

    @classmethod
    def of_stops(
        cls, radii: Numbers, weights: Numbers, direct: ArrayLike = 0.0, **more: Any
    ) -> "PrandtlIshlinskii":
        """The model w = offset + direct u + sum of weights[i] stop(u, radii[i]), of
        stops, each the input less a play.

        **Arguments:** `radii`, shape (k,), input units, positive; `weights`, shape
        (k,), and `direct`, output over input units; and fields of the model.
        """
        radii, weights = numbers(radii), numbers(weights)
        total = jnp.asarray(direct) + jnp.sum(weights)
        zero = jnp.zeros(1, radii.dtype)
        return cls(
            jnp.concatenate([zero, radii]),
            jnp.concatenate([total[None], -weights]),
            **more,
        )

    @classmethod
    def guess(cls, recording: Recording) -> "PrandtlIshlinskii":
        """A first model read off a record: radii on a grid over the input's range, with
        weights of one sign, for plays or else for stops, by least squares. Neighbours
        on the grid that stand for one radius between them are taken together.

        **Raises:** `InputError` where input or output never change.
        """
        low, high = inputs_of(cls.__name__, recording)
        radii = np.linspace(0, (high - low) / 2, _GRID, endpoint=False)
        memory = Plays(jnp.asarray(radii, recording.u.dtype))
        plays = signals_of(memory, recording)
        stops = plays.at[:, 1:].set(plays[:, :1] - plays[:, 1:])
        family, _, weights, offset = best_sum([plays, stops], recording.w)
        named = {"names": recording.names, "units": recording.units, "offset": offset}
        at, share = _together(radii, weights)
        if family == 0:
            return cls(at, share, **named)
        moving = at > 0
        direct = np.sum(share[~moving])
        return cls.of_stops(at[moving], share[moving], direct, **named)

    @property
    def memory(self):
        # Not `abs`, whose derivative at 0 is 0.
        radii = jnp.where(self.radii < 0, -self.radii, self.radii)
        return Plays(radii, self.rising, self.falling)

    def output(self, x, m, now):
        return self.output_of(x)(m, now)

    def output_of(self, x):
        return Weighted(self.weights, self.offset)

    def settled(self):
        return eqx.tree_at(lambda model: model.radii, self, jnp.abs(self.radii))

    def addends(self):
        if self.rising is not None or self.falling is not None:
            return None
        pairs = zip(np.abs(self.radii).tolist(), self.weights.tolist(), strict=True)
        sum_of: dict[Term, float] = {}
        for radius, weight in pairs:
            term = Term.parse(f"play(u,{radius!r})" if radius else "u")
            sum_of[term] = sum_of.get(term, 0.0) + weight
        constant = ((float(self.offset), Term()),) if self.offset != 0 else ()
        return (*constant, *((weight, term) for term, weight in sum_of.items()))

    def density(self) -> tuple[Float[Array, " k"], Float[Array, " k"]]:
        """Radii in order, and the slope of a first loading from rest up to each: the
        sum of the weights of all plays that move by then, output over input units."""
        order = jnp.argsort(jnp.abs(self.radii))
        return jnp.abs(self.radii)[order], jnp.cumsum(self.weights[order])


@jit
def signals_of(memory: AbstractMemory, recording: Recording) -> Array:
    """The state of a memory of one array at the samples of a record."""
    path = recording.path
    every = path.least_substeps
    starts, _, ends = memory.along(memory.first(path), path.grid(every))
    return jnp.concatenate([starts[::every], ends[-1:]])


def _together(radii: np.ndarray, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Operators of weight, pairs of neighbours as one at their centre of weight."""
    at, share = [], []
    i = 0
    while i < len(radii):
        pair = slice(i, i + 2)
        both = i > 0 and i + 1 < len(radii) and np.all(weights[pair] != 0)
        if both:
            at.append(np.average(radii[pair], weights=weights[pair]))
            share.append(np.sum(weights[pair]))
        elif weights[i] != 0:
            at.append(radii[i])
            share.append(weights[i])
        i += 1 + both
    return np.array(at), np.array(share)
