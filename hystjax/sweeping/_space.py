"""Spaces to sweep: a grid, or samples from ranges."""

import textwrap
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Int, PyTree

from .._core import checks
from .._core.checks import InputError, described
from ..recording import Recording


class Uniform(eqx.Module):
    """Every value between `low` and `high` is as likely."""

    low: float
    high: float

    def at(self, share: np.ndarray) -> np.ndarray:
        """The values that a share (0 to 1) of all lie below."""
        return self.low + (self.high - self.low) * share


class LogUniform(eqx.Module):
    """Every ratio is as likely between `low` and `high`, both positive."""

    low: float
    high: float

    def __check_init__(self):
        if not 0 < self.low < self.high:
            raise InputError(
                f"`LogUniform({self.low}, {self.high})` needs 0 < low < high."
            )

    def at(self, share: np.ndarray) -> np.ndarray:
        """The values that a share (0 to 1) of all lie below."""
        return self.low * (self.high / self.low) ** share


_SAMPLE = "sample"  # the axis of `Samples`
_STACKED = (
    "Recordings and models of one shape become an axis by "
    "`jax.tree.map(lambda *x: jnp.stack(x), *several)`."
)


class Axis(eqx.Module):
    """Values of one parameter, with what an axis of a figure needs.

    **Attributes:**

    - `values`: an array of m numbers, or of m of anything: keys, vectors, or a PyTree
        of arrays, such as recordings that were stacked, all with m entries along their
        first axis.
    - `units`: of the values.
    - `labels`: m names, for values that are not plain numbers.
    """

    values: PyTree
    units: str = eqx.field(static=True, default="")
    labels: tuple[str, ...] | None = eqx.field(static=True, default=None)

    def __init__(
        self, values: PyTree, units: str = "", labels: Sequence[str] | None = None
    ):
        """**Raises:** `InputError` for no values, for what is no number, and for
        leaves of different lengths."""
        if isinstance(values, Recording) and np.ndim(values.t) == 1:
            raise InputError(
                "one recording is no axis, whose values would be its samples: give it "
                f"in `shared`, or stack several. {_STACKED}"
            )
        try:
            self.values = jax.tree.map(jnp.asarray, _numbers(values))
        except (TypeError, ValueError):
            raise InputError(
                "an axis is of numbers, or of arrays of equal shapes, got "
                f"{textwrap.shorten(repr(values), 60)}. Number what is neither, and "
                f"give its names as `labels`. {_STACKED}"
            ) from None
        self.units = units
        self.labels = None if labels is None else tuple(map(str, labels))

    def __check_init__(self):
        leaves = jax.tree.leaves(self.values)
        lengths = {leaf.shape[:1] for leaf in leaves}
        if len(lengths) != 1 or lengths <= {(), (0,)}:
            found = ", ".join(str(leaf.shape) for leaf in leaves) or "nothing"
            raise InputError(
                "an axis needs at least one value, along the first axis of all its "
                f"arrays; got {found}."
            )
        if self.labels is not None and len(self.labels) != len(self):
            raise InputError(
                f"an axis of {len(self)} values needs as many `labels`, got "
                f"{len(self.labels)}."
            )

    def __len__(self) -> int:
        return jax.tree.leaves(self.values)[0].shape[0]

    def at(self, index: Int[Array, ""]) -> PyTree:
        """One value."""
        return jax.tree.map(lambda leaf: leaf[index], self.values)

    @property
    def coordinate(self) -> np.ndarray:
        """Labels, or the numbers themselves, or else 0, 1, ..., shape (m,)."""
        if self.labels is not None:
            return np.array(self.labels)
        plain = isinstance(self.values, jax.Array) and self.values.ndim == 1
        if plain and not jnp.issubdtype(self.values.dtype, jax.dtypes.prng_key):
            return np.asarray(self.values)
        return np.arange(len(self))


class AbstractSpace(eqx.Module):
    """Named parameters, and which of their values each lane has.

    **Attributes:**

    - `names`: of the parameters, in order (a dictionary would be sorted under `jit`).
    - `values`: the `Axis` of each.
    """

    names: tuple[str, ...] = eqx.field(static=True)
    values: tuple[Axis, ...]

    def __init__(self, **axes: Any):
        if not axes:
            raise InputError("a sweep needs at least one parameter, got none.")
        self.names = tuple(axes)
        self.values = tuple(
            axis if isinstance(axis, Axis) else Axis(axis) for axis in axes.values()
        )

    @property
    def axes(self) -> dict[str, Axis]:
        """The axes by the name of their parameter."""
        return dict(zip(self.names, self.values, strict=True))

    @property
    @abstractmethod
    def shape(self) -> dict[str, int]:
        """Lengths of the axes of the results, by name."""

    @abstractmethod
    def at(self, lane: Int[Array, ""]) -> dict[str, PyTree]:
        """The values of one lane, by the name of the parameter."""

    @abstractmethod
    def coordinates(self) -> dict[str, tuple[str, np.ndarray, dict[str, str]]]:
        """For each parameter its axis in the results, its values and its attributes."""

    def __len__(self) -> int:
        return int(np.prod(list(self.shape.values())))


class Grid(AbstractSpace):
    """All combinations of the parameters' values; the last parameter changes fastest.

    Grid(threshold=jnp.logspace(-3, 0, 50), seed=jnp.arange(100))
    """

    @property
    def shape(self):
        return {name: len(axis) for name, axis in self.axes.items()}

    def at(self, lane):
        places = jnp.unravel_index(lane, tuple(self.shape.values()))
        pairs = zip(self.axes.items(), places, strict=True)
        return {name: axis.at(place) for (name, axis), place in pairs}

    def coordinates(self):
        return {name: (name, *_described(axis)) for name, axis in self.axes.items()}


class Samples(AbstractSpace):
    """Points of a space, one a lane: the first values of all parameters, the second
    ones, and so on."""

    def __init__(self, **axes: Any):
        """**Arguments:** as of `Grid`, all with as many values.

        **Raises:** `InputError` for no parameter, or not as many values of each.
        """
        super().__init__(**axes)

    def __check_init__(self):
        lengths = {name: len(axis) for name, axis in self.axes.items()}
        if len(set(lengths.values())) > 1:
            raise InputError(f"samples need as many values of each, got {lengths}.")

    @classmethod
    def drawn(
        cls, count: int, *, seed: int = 0, **ranges: Uniform | LogUniform
    ) -> "Samples":
        """Points spread evenly over ranges, at random: one in each of `count` equal
        parts of every range (a Latin hypercube).

            Samples.drawn(1000, noise=Uniform(0, 0.2), ridge=LogUniform(1e-6, 1))

        **Arguments:** how many; the seed; and a `Uniform` or `LogUniform` for each
        parameter.

        **Raises:** `InputError` for another range, and for what is no whole number.

        **Source:** McKay, Beckman and Conover (1979),
        doi 10.1080/00401706.1979.10489755.
        """
        from scipy.stats import qmc  # takes longer to import than all the rest

        if not ranges:
            raise InputError("a sweep needs at least one parameter, got none.")
        for name, range_ in ranges.items():
            if not isinstance(range_, Uniform | LogUniform):
                raise InputError(
                    f"`{name}` must be a range, such as `Uniform(0, 1)` or `LogUniform("
                    f"1e-3, 1)`, got {described(range_)}."
                )
        checks.positive("count", checks.whole("count", count))
        checks.positive("seed", checks.whole("seed", seed), zero=True)
        unit = qmc.LatinHypercube(len(ranges), rng=seed).random(count)
        pairs = zip(ranges.items(), unit.T, strict=True)
        return cls(**{name: range_.at(share) for (name, range_), share in pairs})

    @property
    def shape(self):
        return {_SAMPLE: len(self.values[0])}

    def at(self, lane):
        return {name: axis.at(lane) for name, axis in self.axes.items()}

    def coordinates(self):
        return {name: (_SAMPLE, *_described(axis)) for name, axis in self.axes.items()}


def _described(axis: Axis) -> tuple[np.ndarray, dict[str, str]]:
    return axis.coordinate, {"units": axis.units} if axis.units else {}


def _numbers(values: PyTree) -> PyTree:
    """Sequences of numbers as arrays; PyTrees of arrays as they are."""
    plain = isinstance(values, Sequence | range) and not isinstance(values, Mapping)
    return np.asarray(values) if plain else values
