"""What a fit can be told: which numbers of a model are fitted; what a residual costs,
squares or less than that for outliers; and how a long trajectory is cut up meanwhile.
"""

import math
from abc import abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from typing import Any, TypeAlias

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._core import checks
from .._core.checks import InputError, described, nearest
from .._core.compiling import depends
from ..models import AbstractModel

Bounds = Mapping[str, tuple[float, float]]
Ties = Mapping[str, tuple[float, str]]

_INSIDE = 0.01  # how far inside its bounds a fit starts at least, relative
_NEAR = 0.1  # of the unbounded space: 0.25 % of the width between two bounds


class Parameters(eqx.Module):
    """The free parameters of a model as an unbounded vector.

    Bounded parameters are passed through a sine's square, or with one bound a
    hyperbola, that turn back at the bounds: a fit can end on one. Those whose unit is a
    power that another one decides, as the model's `powers` tell, are in their unit at
    the model's own values: in m^-n, where n changes, a number far from 1 would change
    many times over for the same law, and a fit follow a bent valley.

    **Attributes:**

    - `model`: gives the fixed parameters their values.
    - `names`: free parameters, p of them, in the order of every vector.
    - `ties`: parameters that follow a free one, as (name, factor, name of that one).
    - `lower`, `upper`: bounds, shape (p,), infinite where there are none.
    - `limited`: whether any of them is finite.

    **Source:** James and Roos (1975), doi 10.1016/0010-4655(75)90039-9.
    """

    model: AbstractModel
    names: tuple[str, ...] = eqx.field(static=True)
    ties: tuple[tuple[str, float, str], ...] = eqx.field(static=True)
    lower: Float[Array, " p"]
    upper: Float[Array, " p"]
    limited: bool = eqx.field(static=True)

    @property
    def change_memory(self) -> bool:
        """Whether what the model remembers depends on any of them: if not, it is the
        same throughout a fit."""

        def memory(values):
            leaves = jax.tree.leaves(self.build(values).memory)
            return [leaf for leaf in leaves if eqx.is_array(leaf)]

        return depends(memory, self.values())

    def values(self) -> Float[Array, " p"]:
        """The model's own values of the free parameters, in the precision of the
        recordings, which may be more than that in which the model was saved."""
        parameters = self.model.parameters()
        values = jnp.stack([parameters[name] for name in self.names])
        return values.astype(jnp.result_type(float))

    def build(self, values: Float[Array, " p"]) -> AbstractModel:
        """The model with these values, ties included."""
        free = {name: values[i] for i, name in enumerate(self.names)}
        tied = {name: factor * free[source] for name, factor, source in self.ties}
        return self.model.with_parameters(free | tied)

    def bounded(self, unbounded: Float[Array, " p"]) -> Float[Array, " p"]:
        """Values of the parameters at a point of the unbounded space."""
        if not self.limited:
            return self.rescaled(unbounded, 1)
        below, above, size = self._ends()
        # From the nearer bound: far beyond what is fitted the other one may be.
        low, high = jnp.sin(unbounded / 2) ** 2, jnp.cos(unbounded / 2) ** 2
        both = jnp.where(low < high, below + size * low, above - size * high)
        growth = size * (jnp.sqrt(unbounded**2 + 1) - 1)
        one = jnp.where(jnp.isfinite(self.lower), below + growth, above - growth)
        return self.rescaled(self._choose(both, one, unbounded), 1)

    def unbounded(self, values: Float[Array, " p"]) -> Float[Array, " p"]:
        """Inverse of `bounded`; values at a bound or beyond are moved inside, by a
        share of their size, since at a bound the map has no slope to leave it by."""
        values = self.rescaled(values, -1)
        if not self.limited:
            return values
        below, above, size = self._ends()

        def share(distance, end):
            least = jnp.maximum(jnp.abs(values), jnp.abs(end)) / size
            least = jnp.where(least > 0, jnp.minimum(least, 1.0), 1.0)
            return jnp.maximum(distance / size, _INSIDE * least)

        low, high = share(values - below, below), share(above - values, above)
        both = 2 * jnp.arctan2(jnp.sqrt(low), jnp.sqrt(high))
        growth = jnp.where(jnp.isfinite(self.lower), values - below, above - values)
        one = jnp.sqrt((1 + jnp.maximum(growth / size, _INSIDE)) ** 2 - 1)
        return self._choose(both, one, values)

    def rescaled(self, values: Float[Array, " p"], way: int) -> Float[Array, " p"]:
        """Values, of which some have powers for units, from those units at the model's
        own values to those at these values (1), or back (-1)."""
        powers = self.model.powers()
        if not powers:
            return values
        before, after = self.model.parameters(), self.build(values).parameters()
        # With a bound other than 0 a parameter stays in the unit of the bound.
        ends = jnp.stack([self.lower, self.upper])
        scalable = jnp.all((ends == 0) | jnp.isinf(ends), axis=0)
        factors = jnp.ones_like(values)
        for row, name in enumerate(self.names):
            if name in powers:
                other, size = powers[name]
                change = after[other] - before[other]
                factors = factors.at[row].set(jnp.power(size, way * change))
        return jnp.where(scalable, factors, 1.0) * values

    def pinned(self, unbounded: Float[Array, " p"]) -> Float[Array, " p"]:
        """The same point, but with parameters that are near a bound on it, where the
        map turns back: without a slope they stay there while others are fitted."""
        turn = jnp.round(unbounded / jnp.pi) * jnp.pi
        nearest = self._choose(turn, jnp.zeros_like(turn), jnp.full_like(turn, jnp.inf))
        return jnp.where(jnp.abs(unbounded - nearest) < _NEAR, nearest, unbounded)

    def _ends(self):
        """Bounds with harmless numbers where there are none, and a size: the width
        between two, or the distance of the model's own value from a lone one, that of
        the farthest of its array where it is on it."""
        below = jnp.where(jnp.isfinite(self.lower), self.lower, 0.0)
        above = jnp.where(jnp.isfinite(self.upper), self.upper, below + 1.0)
        own = self.values()
        lone = jnp.where(jnp.isfinite(self.lower), below, above)
        least = _INSIDE * jnp.maximum(jnp.abs(own), jnp.abs(lone))
        distance = jnp.maximum(jnp.abs(own - lone), least)
        # On a bound of 0 nothing tells a size but the others of its array.
        arrays = np.array([name.partition("[")[0] for name in self.names])
        of_array = jnp.where(arrays[:, None] == arrays, distance, 0.0).max(axis=1)
        distance = jnp.where(distance > 0, distance, of_array)
        distance = jnp.where(distance > 0, distance, 1.0)
        two = jnp.isfinite(self.lower) & jnp.isfinite(self.upper)
        return below, above, jnp.where(two, above - below, distance)

    def _choose(self, both, one, none):
        has_lower, has_upper = jnp.isfinite(self.lower), jnp.isfinite(self.upper)
        some = jnp.where(has_lower | has_upper, one, none)
        return jnp.where(has_lower & has_upper, both, some)


def parameters(
    model: AbstractModel, fixed: Sequence[str], bounds: Bounds, tied: Ties
) -> Parameters:
    """Sort a model's parameters into fixed, tied, and free ones with their bounds: the
    model's own where none are given.

    **Raises:** `InputError` for a name that is none of the model's, bounds that cross
    or of a parameter that is not free, a tie to one that is not free, a parameter both
    fixed and tied, or when nothing is left to fit.
    """
    known = tuple(model.parameters())
    _check_pairs("bounds", bounds, "(lower, upper)", (float("-inf"), 1.0))
    _check_pairs("tied", tied, "(factor, parameter)", (1.0, known[0] if known else ""))
    sources = [source for _, source in tied.values()]
    _check_names(known, fixed=fixed, bounds=bounds, tied=[*tied, *sources])
    powers = model.powers()
    _check_names(known, powers=[*powers, *(other for other, _ in powers.values())])
    names = tuple(name for name in known if name not in fixed and name not in tied)
    if not known:
        raise InputError(
            f"this {type(model).__name__} has no number to fit: those that are to be "
            "are arrays of floats, such as `jnp.asarray(0.3)`."
        )
    if not names:
        raise InputError("nothing is left to fit: every parameter is fixed or tied.")
    lost = [source for source in sources if source not in names]
    if lost:
        raise InputError(f"`tied` refers to {lost}, which are not free themselves.")
    both = [name for name in fixed if name in tied]
    if both:
        raise InputError(f"`fixed` and `tied` both name {both}; choose one.")
    idle = [name for name in bounds if name not in names]
    if idle:
        raise InputError(f"`bounds` of {idle} do nothing: these are fixed or tied.")
    own = {name: ends for name, ends in model.bounds().items() if name in names}
    bounds = own | dict(bounds)
    ends = np.array([bounds.get(name, (-np.inf, np.inf)) for name in names], float)
    lower, upper = (jnp.asarray(column) for column in ends.T)
    crossed = [name for name, (low, high) in bounds.items() if not low < high]
    if crossed:
        raise InputError(f"`bounds` of {crossed} must be (lower, upper) in this order.")
    ties = tuple((name, *tie) for name, tie in tied.items())
    limited = any(math.isfinite(end) for pair in bounds.values() for end in pair)
    return Parameters(model, names, ties, lower, upper, limited)


def _check_pairs(argument: str, given, what: str, example: tuple) -> None:
    """Raise `InputError` unless the values of a dictionary are pairs, with a name where
    the example has one, and else with numbers."""
    if not isinstance(given, Mapping):
        raise InputError(
            f"`{argument}` must be a dictionary of pairs {what} by parameter, got "
            f"{described(given)}."
        )
    for name, pair in given.items():
        paired = isinstance(pair, tuple | list) and len(pair) == 2
        if not paired or not all(map(_alike, pair, example)):
            raise InputError(
                f"`{argument}` of {name!r} must be a pair {what}, such as "
                f"`{{{name!r}: {example}}}`; got {pair!r}."
            )


def _alike(value, example) -> bool:
    """Whether a value is a name, or else a number, as the example is."""
    if isinstance(example, str):
        return isinstance(value, str)
    return np.ndim(value) == 0 and np.asarray(value).dtype.kind in "iuf"


def _check_names(known, **given) -> None:
    for argument, names in given.items():
        if isinstance(names, str) or not isinstance(names, Iterable):
            raise InputError(f"`{argument}` must be a list of names, got {names!r}.")
        unknown = [name for name in names if name not in known]
        if unknown:
            raise InputError(
                f"`{argument}` names {unknown}, but the model's parameters are "
                f"{', '.join(known)}. {nearest(unknown[0], known)}".rstrip()
            )


Residuals = Float[Array, "*s"]


class AbstractLoss(eqx.Module):
    """The cost rho(r) of residuals in output units; rho(r) = r^2 / 2 near 0."""

    @abstractmethod
    def signed_root(self, residuals: Residuals) -> Residuals:
        """sign(r) sqrt(2 rho(r)): a residual whose square is twice the cost, so that
        least-squares solvers apply."""

    @abstractmethod
    def influence(self, residuals: Residuals) -> Residuals:
        """d rho / d r."""


class Squares(AbstractLoss):
    """r^2 / 2: best for Gaussian noise."""

    def signed_root(self, residuals):
        return residuals

    def influence(self, residuals):
        return residuals


class Huber(AbstractLoss):
    """Squares up to a threshold, straight lines beyond.

    **Attributes:**

    - `threshold`: output units; 1.345 standard deviations of the noise keep 95 % of the
        efficiency of squares.

    **Source:** Huber (1964), doi 10.1214/aoms/1177703732.
    """

    threshold: float | Array

    def __check_init__(self):
        checks.number("threshold", self.threshold)
        checks.positive("threshold", self.threshold)

    def signed_root(self, residuals):
        size = jnp.abs(residuals)
        far = size > self.threshold
        safe = jnp.where(far, size, self.threshold)
        root = jnp.sqrt(self.threshold * (2 * safe - self.threshold))
        return jnp.where(far, jnp.sign(residuals) * root, residuals)

    def influence(self, residuals):
        return jnp.clip(residuals, jnp.negative(self.threshold), self.threshold)


class Cauchy(AbstractLoss):
    """scale^2 log(1 + (r / scale)^2) / 2: gross outliers count for almost nothing.

    **Attributes:**

    - `scale`: output units; 2.385 standard deviations of the noise keep 95 % of the
        efficiency of squares.

    **Source:** Holland and Welsch (1977), doi 10.1080/03610927708827533.
    """

    scale: float | Array

    def __check_init__(self):
        checks.number("scale", self.scale)
        checks.positive("scale", self.scale)

    def signed_root(self, residuals):
        square = (residuals / self.scale) ** 2
        small = square < 1e-12
        safe = jnp.where(small, 1.0, square)
        return residuals * jnp.where(small, 1.0, jnp.sqrt(jnp.log1p(safe) / safe))

    def influence(self, residuals):
        return residuals / (1 + (residuals / self.scale) ** 2)


Stages: TypeAlias = tuple[
    Float[Array, " s"], Float[Array, " s"], Float[Array, " s"] | None
]


class AbstractShooting(eqx.Module):
    """A sequence of least-squares problems, each started where the last one ended.

    The last fit is always a single trajectory from each recording's start.
    """

    @property
    @abstractmethod
    def segments(self) -> int:
        """Pieces, each with a free start, that a recording is cut into."""

    @abstractmethod
    def stages(self) -> Stages:
        """For each of the stages before the last fit: the share of the samples that
        counts; the weight of the gaps between pieces relative to the output; and the
        gain of nudging, if there is any."""


def _each_stage(name: str, values: Any) -> tuple[float, ...]:
    """A number for each of the stages."""
    try:
        return tuple(map(float, values))
    except (TypeError, ValueError):
        raise InputError(
            f"`{name}` must be a list of numbers, one for each stage, such as `[0.5]`; "
            f"got {described(values)}."
        ) from None


class SingleShooting(AbstractShooting):
    """One trajectory a recording, over growing horizons.

    **Attributes:**

    - `horizons`: shares of each recording's samples, from the first to the last one
        that has weight, that are fitted before all of them; increasing. Far from the
        truth a short horizon has fewer false minima.
    """

    horizons: tuple[float, ...] = eqx.field(
        converter=partial(_each_stage, "horizons"), static=True, default=()
    )

    def __check_init__(self):
        if list(self.horizons) != sorted({h for h in self.horizons if 0 < h < 1}):
            raise InputError(
                "`horizons` must increase and lie between 0 and 1, got "
                f"{self.horizons}; the whole recording always comes last."
            )

    @property
    def segments(self):
        """One."""
        return 1

    def stages(self):
        horizons = jnp.array(self.horizons, float)
        return horizons, jnp.zeros_like(horizons), None


class MultipleShooting(AbstractShooting):
    """Pieces side by side, each with a free start, whose gaps are closed step by step.

    For long recordings, and laws that are unstable on the way to the solution.

    **Attributes:**

    - `pieces`: number of them, at least 2.
    - `weights`: weight of the gaps at each stage, relative to the whole output's
        spread; increasing.

    **Source:** Bock (1983), doi 10.1007/978-1-4684-7324-7_7.
    """

    pieces: int = eqx.field(
        converter=partial(checks.count, "pieces", least=2), static=True, default=10
    )
    weights: tuple[float, ...] = eqx.field(
        converter=partial(_each_stage, "weights"),
        static=True,
        default=(0.1, 1.0, 10.0, 100.0),
    )

    def __check_init__(self):
        rising = sorted({weight for weight in self.weights if weight > 0})
        if not self.weights or list(self.weights) != rising:
            raise InputError(
                f"`weights` must be positive and increase, got {self.weights}."
            )

    @property
    def segments(self):
        """As many as there are pieces."""
        return self.pieces

    def stages(self):
        weights = jnp.array(self.weights, float)
        return jnp.ones_like(weights), weights, None


class Nudging(AbstractShooting):
    """One trajectory a recording, drawn to the measured output at every sample that has
    weight or leads in to those, less at each stage.

    A drawn trajectory cannot get out of step with the record, nor far from it: where a
    free run has false minima (a resonance that is off), or is lost, this one mostly
    has neither. It needs no further unknowns, and works on models with hidden states.

    **Attributes:**

    - `gains`: for each stage, the share of its distance from the measured output by
        which the simulated output is moved after every sample; decreasing. A trajectory
        remembers some 1 / gain samples: start with less than a period of the output.

    **Source:** Vyasarayani, Uchida, Carvalho and McPhee (2011),
    doi 10.1007/s11044-011-9260-0, who add the distance to the derivative.
    """

    gains: tuple[float, ...] = eqx.field(
        converter=partial(_each_stage, "gains"), static=True, default=(0.5, 0.2, 0.05)
    )

    def __check_init__(self):
        falling = sorted({g for g in self.gains if 0 < g < 1}, reverse=True)
        if not self.gains or list(self.gains) != falling:
            raise InputError(
                f"`gains` must decrease and lie between 0 and 1, got {self.gains}; the "
                "free run, without gain, always comes last."
            )

    @property
    def segments(self):
        """One."""
        return 1

    def stages(self):
        gains = jnp.array(self.gains, float)
        return jnp.ones_like(gains), jnp.zeros_like(gains), gains
