"""Plays and relays in parallel: the operator of Prandtl and Ishlinskii, and that of
Preisach, on a grid or by an Everett function."""

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Bool, Float

from .._core import checks
from .._core.checks import InputError, is_concrete
from .._core.compiling import jit
from ..least_squares import LeastSquaresProblem, NonNegative, compress
from ..library import (
    AbstractMemory,
    Plays,
    Staircase,
    Term,
    Weighted,
    check_initial,
)
from ..recording import Recording
from ..saving import Storable
from ._base import AbstractOperatorLaw, FittedRange
from ._guess import arrays, stretches
from ._numbers import (
    Numbers,
    check_elements,
    check_rising,
    floats,
    from_zero,
    number,
    numbers,
    stack_of,
    together,
)

_LEAST = 1e-3  # share of the sum of weights below which an operator is left out


def inputs_of(what: str, recording: Recording) -> tuple[float, float]:
    """The lowest and the highest input of a record that a first model can be read off.

    **Raises:** `InputError` where input or output never change, or samples are few.
    """
    u, _ = arrays(recording, f"{what}.guess", 10)
    return float(np.min(u)), float(np.max(u))


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
    ends = inputs_of(what, recording)
    u, w = np.asarray(recording.u), np.asarray(recording.w)
    middles, travel = (u[1:] + u[:-1]) / 2, np.abs(np.diff(w))
    return _by_travel(shares, ends, middles, travel)


def _by_travel(
    shares: Float[np.ndarray, " k"],
    ends: tuple[float, float],
    places: Float[np.ndarray, " n"],
    travel: Float[np.ndarray, " n"],
) -> Float[np.ndarray, " k"]:
    """Places between two ends up to which such shares of a travel lie, that is so much
    at each of n places."""
    edges = np.linspace(*ends, _BINS + 1)
    counted, _ = np.histogram(places, edges, weights=travel)
    part = np.cumsum([0.0, *counted]) / np.sum(counted)
    reached = _EVEN * np.linspace(0, 1, len(edges)) + (1 - _EVEN) * part
    return np.interp(shares, reached, edges)


class _Sum(NamedTuple):
    """A problem of columns and an output without their means, compressed as a
    `LeastSquaresProblem`; the means; and the sum of the weights that samples have. All
    are arrays of NumPy."""

    triangle: Float[np.ndarray, "k k"]
    target: Float[np.ndarray, " k"]
    remainder: Float[np.ndarray, ""]
    means: Float[np.ndarray, " k"]
    mean: Float[np.ndarray, ""]
    total: Float[np.ndarray, ""]


@jit
def _compressed(columns, w, weight):
    # The constant may have either sign: without means, none is needed.
    total, root = jnp.sum(weight), jnp.sqrt(weight)
    means, mean = weight @ columns / total, weight @ w / total
    problem = compress(root[:, None] * (columns - means), root * (w - mean))
    return problem.triangle, problem.target, problem.remainder, means, mean, total


def _weights(
    given: _Sum, free: int, sign: float, there: Bool[np.ndarray, "*s"]
) -> tuple[Float[np.ndarray, " k"], float]:
    """Weights of least squares, for the output or, by the sign -1, for its negative, of
    so many columns that are `free` to have any sign, and of those that are there of the
    others, zero or more; and what they leave."""
    triangle, target = given.triangle, sign * given.target
    # Below the rows of the free columns is what these leave of all others. Of one that
    # stands still, or is a sum of these, no more than rounding is left.
    own, left = (np.linalg.norm(x, axis=0)[free:] for x in (triangle, triangle[free:]))
    size = np.hypot(own, np.sqrt(given.total) * np.abs(given.means[free:]))
    new = left > np.sqrt(np.finfo(triangle.dtype).eps) * size
    below = triangle[free:, free:] * (there & new)
    found = _non_negative(jnp.asarray(below), jnp.asarray(target[free:]))
    signed, misfit = map(np.asarray, found)
    rest = target[:free] - triangle[:free, free:] @ signed
    first, *_ = np.linalg.lstsq(triangle[:free, :free], rest)
    return np.concatenate([first, signed]), math.hypot(misfit, given.remainder)


@jit
def _non_negative(triangle: Float[Array, "k k"], target: Float[Array, " k"]):
    """Weights of least squares, zero or more, and what they leave."""
    problem = LeastSquaresProblem(triangle, target, jnp.zeros(()), len(target))
    found = NonNegative().fit(problem).coefficients
    return found, jnp.linalg.norm(triangle @ found - target)


def best_sum(
    families: Sequence[Float[Array, "n _k"]],
    w: Float[Array, " n"],
    weight: Float[Array, " n"] | None = None,
    free: int = 0,
) -> tuple[int, float, np.ndarray, float]:
    """The family of columns, and the sign, whose sum with weights of that sign is
    closest to an output.

    **Arguments:** the families, the output, and by what `weight` each sample counts,
    all the same by default; and how many columns come first whose weights are `free` to
    have any sign.

    **Returns:** the number of the family; the sign; the weights, of least squares
    without the columns to which noise alone gives some; and the constant beside them.
    """
    weight = jnp.ones_like(w) if weight is None else weight
    sums = [_Sum(*map(np.asarray, _compressed(x, w, weight))) for x in families]
    found = [
        (sign, family, *_weights(each, free, sign, np.array(True)))
        for family, each in enumerate(sums)
        for sign in (1.0, -1.0)
    ]
    sign, family, weights, _ = min(found, key=lambda each: each[3])
    chosen = sums[family]
    while np.any(((own := weights[free:]) > 0) & (own < _LEAST * np.sum(own))):
        there = own >= _LEAST * np.sum(own)
        weights, _ = _weights(chosen, free, sign, there)
    weights = sign * weights
    return family, sign, weights, float(chosen.mean - chosen.means @ weights)


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


def _widths(radii: Float[Array, "*s"]) -> Float[Array, "*s"]:
    """Radii without their sign, which has no meaning. The derivative at 0 is 1, as of
    radii that can but grow; with 0, no fit would move them from there."""
    return jnp.where(radii < 0, -radii, radii)


def _radii(values: Numbers) -> Float[Array, "*s"]:
    return _widths(numbers(values))


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
    - `rising`, `falling`: an `Envelope` each, or another function that rises with the
        input, or `None` for the input itself. Where `rising` is above `falling`, the
        lower of both pulls up and the higher down.
    - `names`, `units`: of input and output; keyword only.

    **Raises:** `InputError` for radii and weights of different number, and envelopes
    that are no functions.

    **Source:** Krasnosel'skii and Pokrovskii (1989), doi 10.1007/978-3-642-61302-9;
    with envelopes Al Janaideh, Rakheja and Su (2011), doi 10.1109/TMECH.2010.2052366.
    """

    radii: Float[Array, " k"] = eqx.field(converter=_radii)
    weights: Float[Array, " k"] = eqx.field(converter=numbers)
    offset: Float[Array, ""] = eqx.field(converter=number, default=0.0)
    rising: Envelope | None = None
    falling: Envelope | None = None

    def __check_init__(self):
        check_elements(radii=self.radii, weights=self.weights)
        for name in ("rising", "falling"):
            envelope = getattr(self, name)
            if envelope is not None and not callable(envelope):
                raise InputError(
                    f"`{name}` must be a function of the input, such as "
                    f"`Envelope(1.0, 0.8)`, got {checks.described(envelope)}."
                )

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
        check_elements(radii=radii, weights=weights)
        total = number(direct) + jnp.sum(weights)
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
        at, share = _together(radii, weights)
        moving = at > 0
        if family == 0 or not np.any(moving):
            return cls(at, share, offset).fitted_to([recording])
        direct = np.sum(share[~moving])
        stack = cls.of_stops(at[moving], share[moving], direct, offset=offset)
        return stack.fitted_to([recording])

    @property
    def memory(self):
        return Plays(_widths(self.radii), self.rising, self.falling)

    def bounds(self):
        return {**super().bounds(), **from_zero("radii", self.radii)}

    def dimensions(self):
        envelopes = ("rising", "falling")
        return {
            "weights": (1, -1, 0),
            "offset": (1, 0, 0),
            "radii": (0, 1, 0),
            **{f"{each}.scale": (0, 1, 0) for each in envelopes},
            **{f"{each}.offset": (0, 1, 0) for each in envelopes},
            **{f"{each}.slope": (0, -1, 0) for each in envelopes},
        }

    def output(self, x, m, now):
        return self.output_of(x)(m, now)

    def output_of(self, x):
        return Weighted(self.weights, self.offset)

    def settled(self):
        return eqx.tree_at(lambda model: model.radii, self, _widths(self.radii))

    def addends(self):
        if self.rising is not None or self.falling is not None:
            return None
        if np.ndim(self.weights) != 1:
            raise InputError(
                f"this is a batch of stacks, with weights of shape "
                f"{np.shape(self.weights)}; pick one with `jax.tree.map(lambda x: "
                "x[i], model)`, or map over them by `jax.vmap`."
            )
        constant = ((float(self.offset), Term()),) if self.offset != 0 else ()
        plays = stack_of(self.weights.tolist(), np.abs(self.radii).tolist())
        return constant + together(plays)

    def density(self) -> tuple[Float[Array, " k"], Float[Array, " k"]]:
        """Radii in order, and the slope of a first loading from rest up to each: the
        sum of the weights of all plays that move by then, output over input units."""
        order = jnp.argsort(jnp.abs(self.radii))
        return jnp.abs(self.radii)[order], jnp.cumsum(self.weights[order])


@jit
def signals_of(memory: AbstractMemory, recording: Recording) -> Array:
    """The state of a memory of one array at the samples of a record."""
    return memory.at_samples(recording.path)


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


_LEVELS = 12  # rows and columns of relays that `guess` tries
_RADII, _CENTRES = 8, 10  # of the plane in radii and centres, likewise
_CLEARLY = 0.5  # of the error without a curve, that one with it must leave less than


class Preisach(AbstractOperatorLaw):
    """Relays in parallel: w = offset + sum of weights[i, j] times 1 or -1.

    The relay (i, j), i >= j, turns up where the input comes to `levels[i + 1]` and down
    where it comes back to `levels[j]`. A sample costs as much as there are levels, not
    relays: see `library.Staircase`.

    Derivatives with respect to `levels` and to the input are zero, as they are almost
    everywhere: fix the levels, and find weights by `guess`; or use `Everett`.

    **Attributes:**

    - `levels`: shape (L + 1,), input units, rising.
    - `weights`: output units, shape (L (L + 1) / 2,), those of the row i = 0 first, in
        each row from j = 0 to i; a matrix (L, L), which is zero where j > i, is taken
        too. Positive for loops that the output runs through counter-clockwise.
    - `offset`: a scalar, output units, 0 by default.
    - `initial`: how relays stand before the first input: `"demagnetised"`, up below the
        middle of the levels and down above it; or all `"up"` or `"down"`.
    - `names`, `units`: of input and output; keyword only.

    **Raises:** `InputError` for levels that do not rise, another number of weights, or
    an unknown `initial`.

    **Source:** Preisach (1935), doi 10.1007/BF01349418; Mayergoyz (1991), doi
    10.1007/978-1-4612-3028-1.
    """

    levels: Float[Array, " n"] = eqx.field(converter=floats)
    weights: Float[Array, " _r"]
    offset: Float[Array, ""] = eqx.field(converter=number, default=0.0)
    initial: str = eqx.field(static=True, default="demagnetised")

    def __init__(
        self,
        levels: Numbers,
        weights: Numbers,
        offset: ArrayLike = 0.0,
        initial: str = "demagnetised",
        *,
        names: tuple[str, str] = ("input", "output"),
        units: tuple[str, str] = ("", ""),
        fitted_range: FittedRange | None = None,
    ):
        self.levels, self.offset, self.initial = (
            floats(levels),
            number(offset),
            initial,
        )
        self.weights = _packed(numbers(weights))
        self.names, self.units, self.fitted_range = names, units, fitted_range

    def __check_init__(self):
        check_initial(self.initial)
        check_rising("levels", self.levels)
        rows = self.levels.shape[-1] - 1
        if self.weights.shape[-1:] != (rows * (rows + 1) // 2,):
            raise InputError(
                f"{rows + 1} levels make {rows * (rows + 1) // 2} relays, one for each "
                f"pair; got `weights` of shape {self.weights.shape}."
            )

    @classmethod
    def guess(cls, recording: Recording) -> "Preisach":
        """A first model read off a record: levels evenly over the input's range, and
        weights of one sign by least squares.

        **Raises:** `InputError` where input or output never change.
        """
        low, high = inputs_of(cls.__name__, recording)
        levels = jnp.linspace(low, high, _LEVELS + 1, dtype=recording.u.dtype)
        zero = cls(levels, jnp.zeros(_LEVELS * (_LEVELS + 1) // 2, levels.dtype))
        heights = signals_of(zero.memory, recording)
        i, j = np.tril_indices(_LEVELS)
        up = jnp.where(heights[:, j] > i, 1.0, -1.0)
        # The input reaches the first and the last level in one sample only: what turns
        # there hardly shows, and least squares leaves it out.
        _, _, weights, offset = best_sum([up], recording.w)
        return cls(levels, weights, offset).fitted_to([recording])

    @property
    def memory(self):
        return Staircase(self.levels, self.initial)

    def dimensions(self):
        return {"levels": (0, 1, 0), "weights": (1, 0, 0), "offset": (1, 0, 0)}

    def output(self, x, m, now):
        # Sums down the columns, of which the staircase picks one entry each.
        sums = jnp.cumsum(self.plane(), axis=0)
        sums = jnp.concatenate([jnp.zeros_like(sums[:1]), sums])
        up = jnp.sum(jnp.take_along_axis(sums, m[None].astype(int), axis=0))
        return self.offset + 2 * up - jnp.sum(self.weights)

    def plane(self) -> Float[Array, "L L"]:
        """The weights as a matrix: row i for the upper threshold, column j for the
        lower."""
        rows = self.levels.shape[0] - 1
        return (
            jnp.zeros((rows, rows), self.weights.dtype)
            .at[np.tril_indices(rows)]
            .set(self.weights)
        )


def _optional(value: Numbers | None) -> Array | None:
    return None if value is None else numbers(value)


class Everett(AbstractOperatorLaw):
    """The operator of Preisach by a smooth function of each play,

        w = offset + sign * sum of G_k(play(u, radii[k])),

    each G_k rising, straight between `centres` and constant beyond: a density on the
    plane of thresholds, in the coordinates r, half of the distance of a relay's
    thresholds, and their mean. Its Everett function has the derivatives that grids of
    relays lack, in every number and in the input.

    So does an output lag behind its input. One that leads, such as the force of a
    friction contact, of steel that yields or of a superelastic wire over a position,
    has a `curve` C, and springs beside it that slide, each with the stiffness G_k'
    where it is:

        w = offset + C(u) - sign * sum of (G_k(u) - G_k(play(u, radii[k]))),

    with `sign=-1` for springs that are stiff, as steel and contacts are. There all
    functions go straight on beyond the centres.

    **Attributes:**

    - `radii`: shape (k,), input units, from 0. Their sign has no meaning.
    - `centres`: shape (s + 1,), input units, rising.
    - `roots`: shape (k, s): by their squares, output units, G_k rises from one centre
        to the next, so that no fit makes it fall.
    - `offset`: the output in the middle of all G_k, or of C, a scalar, output units.
    - `sign`: 1 for an output that lags and rises with its input, or leads it and
        falls; -1 for the other two.
    - `curve`: by how much C rises from one centre to the next, shape (s,), output
        units, of any sign; `None` for an output that lags.
    - `names`, `units`: of input and output; keyword only.

    **Source:** Everett (1955), doi 10.1039/TF9555101551; by plays Brokate and Sprekels
    (1996), doi 10.1007/978-1-4612-4048-8; by springs that slide Iwan (1966), doi
    10.1115/1.3625199.
    """

    radii: Float[Array, " k"] = eqx.field(converter=_radii)
    centres: Float[Array, " n"] = eqx.field(converter=floats)
    roots: Float[Array, "k s"] = eqx.field(converter=numbers)
    offset: Float[Array, ""] = eqx.field(converter=number, default=0.0)
    sign: int = eqx.field(static=True, default=1)
    curve: Float[Array, " s"] | None = eqx.field(converter=_optional, default=None)

    def __check_init__(self):
        check_rising("centres", self.centres)
        expected = *self.radii.shape[-1:], self.centres.shape[-1] - 1
        if self.roots.shape[-2:] != expected:
            raise InputError(
                "`roots` must have a row for each radius and a column for each pair "
                f"of neighbouring centres, shape {expected}; got {self.roots.shape}."
            )
        if self.sign not in (1, -1):
            raise InputError(f"`sign` must be 1 or -1, got {self.sign!r}.")
        if self.curve is not None and self.curve.shape[-1:] != expected[1:]:
            raise InputError(
                "`curve` must have a number for each pair of neighbouring centres, "
                f"shape {expected[1:]}; got {self.curve.shape}."
            )

    @classmethod
    def guess(cls, recording: Recording) -> "Everett":
        """A first model read off a record: radii and centres over the input's range,
        denser where the output changes, and what each G_k rises by from least squares.
        Where that leaves less than half as much it has a `curve`, even centres, and
        radii that are denser where the output changes after turning points.

        **Raises:** `InputError` where input or output never change.
        """
        kinds = cls.kinds(recording)
        columns = [each.columns(recording) for each in kinds]
        found, _ = closer(kinds, columns, recording.w)
        return found.fitted_to([recording])

    @classmethod
    def kinds(cls, recording: Recording) -> "tuple[Everett, Everett]":
        """Of an output that lags, and of one that leads, with radii and centres as a
        record has them, and nothing that rises yet.

        **Raises:** `InputError` as `guess` does.
        """
        inputs = partial(inputs_by_travel, cls.__name__, recording)
        aside = np.linspace(0, 0.5, _RADII, endpoint=False)
        widths = inputs(0.5 + aside) - inputs(0.5 - aside)
        edges = inputs(np.linspace(0, 1, _CENTRES + 1))
        dtype = recording.u.dtype
        radii, centres = jnp.asarray(widths / 2, dtype), jnp.asarray(edges, dtype)
        roots = jnp.zeros((_RADII, _CENTRES), dtype)
        lags = cls(radii, centres, roots)
        # A force changes most where it turns back, which tells nothing of places.
        slips = jnp.asarray(_radii_of_slip(recording), dtype)
        even = jnp.linspace(centres[0], centres[-1], _CENTRES + 1)
        return lags, cls(slips, even, roots, curve=jnp.zeros(_CENTRES, dtype))

    def columns(self, recording: Recording) -> Float[Array, "n c"]:
        """What the output is a weighted sum of, beside a constant, at the samples of a
        record: how far each G_k has risen from each centre to the next, from 0 to 1;
        with a `curve` that curve before them, and of G_k what they differ by from those
        at the input itself."""
        plays = signals_of(self.memory, recording)
        if self.curve is None:
            return _ramps(plays, self.centres).reshape(len(plays), -1)
        along, behind = self._slips(recording.u, plays)
        return jnp.hstack([along, behind.reshape(len(plays), -1)])

    def weighed(self, columns: Float[Array, "*n c"]) -> Float[Array, "*n"]:
        """The output where its `columns` are these."""
        rises = self.roots**2
        if self.curve is None:
            lowest = self.offset - self.sign * jnp.sum(rises) / 2
            return lowest + self.sign * columns @ rises.ravel()
        lowest = self.offset - jnp.sum(self.curve) / 2
        return lowest + columns @ jnp.hstack([self.curve, self.sign * rises.ravel()])

    def fitted(
        self,
        columns: Float[Array, "n c"],
        w: Float[Array, " n"],
        weight: Float[Array, " n"] | None = None,
    ) -> "Everett":
        """The same radii and centres with what least squares makes of the rises, those
        of all G_k of one sign.

        **Arguments:** the `columns` of one record or several, one after the other; the
        output there; and how much each sample counts, all the same by default.
        """
        free = 0 if self.curve is None else len(self.curve)
        _, sign, weights, lowest = best_sum([columns], w, weight, free)
        rises = jnp.asarray(sign * weights[free:], w.dtype).reshape(self.roots.shape)
        curve = None if self.curve is None else jnp.asarray(weights[:free], w.dtype)
        above = sign * jnp.sum(rises) if curve is None else jnp.sum(curve)
        middle = jnp.asarray(lowest + above / 2, w.dtype)
        found = {"roots": jnp.sqrt(rises), "curve": curve, "offset": middle}
        return replace(self, **found, sign=int(sign))

    @property
    def memory(self):
        return Plays(_widths(self.radii))

    def bounds(self):
        return {**super().bounds(), **from_zero("radii", self.radii)}

    def settled(self):
        return eqx.tree_at(lambda model: model.radii, self, _widths(self.radii))

    def dimensions(self):
        across = dict.fromkeys(("radii", "centres"), (0, 1, 0))
        return across | {
            "roots": (0.5, 0, 0),
            **dict.fromkeys(("offset", "curve"), (1, 0, 0)),
        }

    def output(self, x, m, now):
        return self.offset + self._above_middle(now.u, m)

    def _above_middle(self, u, plays):
        """The output above its offset, at inputs and plays of them."""
        rises, sign = self.roots**2, self.sign
        if self.curve is None:
            share = _ramps(plays, self.centres) - 0.5
            return sign * jnp.sum(rises * share, axis=(-2, -1))
        along, behind = self._slips(u, plays)
        static = jnp.sum(self.curve * (along - 0.5), axis=-1)
        return static + sign * jnp.sum(rises * behind, axis=(-2, -1))

    def _slips(self, u, plays):
        """How far C has risen, and by how much less than at the input each G_k has."""
        along, behind = (_ramps(p, self.centres, onward=True) for p in (u, plays))
        return along, behind - along[..., None, :]

    def everett(
        self, high: Float[ArrayLike, "*a"], low: Float[ArrayLike, "*b"]
    ) -> Float[Array, "*s"]:
        """By how much the output falls where the input, having risen to `high` from
        far below, comes down to `low`; output units."""
        high, low = jnp.broadcast_arrays(jnp.asarray(high), jnp.asarray(low))
        radii = _widths(self.radii)
        top = high[..., None] - radii
        end = jnp.minimum(top, low[..., None] + radii)
        return self._above_middle(high, top) - self._above_middle(low, end)


def closer(
    kinds: tuple[Everett, Everett],
    columns: Sequence[Float[Array, "n _c"]],
    w: Float[Array, " n"],
    weight: Float[Array, " n"] | None = None,
) -> tuple[Everett, Float[Array, "n _c"]]:
    """What `fitted` makes of an output that lags, or of one that leads where that
    leaves less than half as much; and the columns of this kind."""
    weight = jnp.ones_like(w) if weight is None else weight
    pairs = [(k.fitted(x, w, weight), x) for k, x in zip(kinds, columns, strict=True)]
    lags, leads = (jnp.sum(weight * (fit.weighed(x) - w) ** 2) for fit, x in pairs)
    return pairs[int(leads < _CLEARLY**2 * lags)]


def _ramps(
    p: Float[Array, "*s"], centres: Float[Array, " n"], onward: bool = False
) -> Float[Array, "*s _m"]:
    """From 0 to 1 between each centre and the next, at several plays; `onward`, the
    first from far below, and the last to far above."""
    share = (p[..., None] - centres[:-1]) / jnp.diff(centres)
    ramps = jnp.clip(share, 0, 1)
    if not onward:
        return ramps
    first, last = (np.arange(share.shape[-1]) == i for i in (0, share.shape[-1] - 1))
    below, above = jnp.minimum(share, 0.0), jnp.maximum(share - 1.0, 0.0)
    return ramps + jnp.where(first, below, 0.0) + jnp.where(last, above, 0.0)


def _radii_of_slip(recording: Recording) -> Float[np.ndarray, " k"]:
    """Radii of plays, denser where the output changes after turning points: there are
    springs that begin to slide, each at a way back of twice its radius."""
    u, w = (np.asarray(x) for x in (recording.u, recording.w))
    parts = [each.rows for each in stretches(u)]
    back = [np.abs(u[rows] - u[rows.start]) for rows in parts]
    middles = np.concatenate([(x[1:] + x[:-1]) / 2 for x in back])
    travel = np.concatenate([np.abs(np.diff(w[rows])) for rows in parts])
    shares = (np.arange(_RADII) + 0.5) / _RADII
    return _by_travel(shares, (0.0, float(np.ptp(u))), middles, travel) / 2


def _packed(weights: Array) -> Array:
    """Weights of relays as a vector.

    **Raises:** `InputError` for a matrix with weights of no relays.
    """
    if weights.ndim < 2 or weights.shape[-1] != weights.shape[-2]:
        return weights
    if is_concrete(weights) and np.any(np.triu(np.asarray(weights), 1) != 0):
        raise InputError(
            "`weights` has numbers above its diagonal, where there are no relays: the "
            "row is that of the upper threshold, and the column that of the lower."
        )
    i, j = np.tril_indices(weights.shape[-1])
    return weights[..., i, j]
