"""The numbers of models: how they are taken, their names, a knee; and first guesses of
those of classical models, read off a recorded loop."""

import itertools
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any, NamedTuple, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from .._core import checks
from .._core.checks import InputError, is_concrete, nearest
from ..recording import Recording, as_recording


def number(value: ArrayLike) -> Array:
    """A parameter as an array of one float."""
    value = numbers(value)
    if value.ndim:
        raise InputError(
            f"a parameter must be a number, got an array of shape {value.shape}; make "
            "batches of models with `jax.vmap`."
        )
    return value


def optional(value: ArrayLike | None) -> Array | None:
    """A parameter as an array of one float, if there is one."""
    return None if value is None else number(value)


Numbers = ArrayLike | Sequence[Any]
"""What becomes an array of floats: an array, or lists of numbers."""


def numbers(value: Numbers) -> Array:
    """Parameters as an array of floats. Infinite ones may have a sense, as the limit of
    a spring that never slips.

    **Raises:** `InputError` for what are no real numbers, or NaN.
    """
    array = floats(value)
    if is_concrete(array) and np.any(np.isnan(known := np.asarray(array))):
        bad = np.argwhere(np.isnan(known))[0].tolist()
        place = f" at {bad}" if bad else ""
        raise InputError(f"parameters must be numbers, and not NaN; got nan{place}.")
    return array


def floats(value: Numbers) -> Array:
    """Parameters as an array of floats; NaN too, which a fit that went astray leaves.

    **Raises:** `InputError` for what are no real numbers.
    """
    try:
        array = jnp.asarray(value)
    except (TypeError, ValueError):
        array = None
    if array is None or jnp.iscomplexobj(array):
        raise InputError(
            "parameters must be real numbers, or arrays of them; got "
            f"{checks.described(value)}."
        )
    return array.astype(jnp.result_type(float, array))


def check_elements(**parameters: Array) -> None:
    """Raise `InputError` unless these have a number each for every element that a model
    is made of, and there is one."""
    shapes = [each.shape for each in parameters.values()]
    if len({*shapes}) > 1 or len(shapes[0]) != 1 or shapes[0] == (0,):
        named = " and ".join(f"`{name}`" for name in parameters)
        raise InputError(
            f"{named} must be arrays of one length, a number for each element; got "
            f"shapes {' and '.join(map(str, shapes))}."
        )


def check_rising(name: str, thresholds: Array) -> None:
    """Raise `InputError` unless these are two numbers and more, each above the last."""
    if thresholds.shape[-1:] in ((), (0,), (1,)) or (
        is_concrete(thresholds) and not np.all(np.diff(np.asarray(thresholds)) > 0)
    ):
        raise InputError(
            f"`{name}` must be two numbers or more, each above the last; got "
            f"{thresholds}."
        )


@dataclass(frozen=True)
class Bounded:
    """The converter of a field whose number must lie between two bounds, or on one that
    it `admits`: it refuses others, and `refine` keeps the number there. A fit may end
    on a bound: where a model has a sense there, it is to be one."""

    name: str
    lower: float = 0.0
    upper: float = np.inf
    admits: tuple[float, ...] = ()

    def __call__(self, value: ArrayLike) -> Array:
        array = number(value)
        if checks.is_concrete(array) and not self._holds(float(array)):
            raise InputError(f"`{self.name}` must be {self._in_words()}, got {value}.")
        return array

    def _holds(self, value: float) -> bool:
        return self.lower < value < self.upper or value in self.admits

    def _in_words(self) -> str:
        least = "positive" if self.lower == 0 else f"above {self.lower:g}"
        if self.lower in self.admits:
            least = f"at least {self.lower:g}"
        if np.isinf(self.upper):
            return least
        most = "at most" if self.upper in self.admits else "below"
        return f"{least} and {most} {self.upper:g}"


def field_bounds(module: eqx.Module, place: str = "") -> dict[str, tuple[float, float]]:
    """The bounds of such fields, by the names of parameters, those of parts too."""
    found = {}
    for field in fields(module):
        value, converter = getattr(module, field.name), field.metadata.get("converter")
        if isinstance(converter, Bounded):
            found[place + field.name] = converter.lower, converter.upper
        elif isinstance(value, eqx.Module):
            found |= field_bounds(value, f"{place}{field.name}.")
    return found


def from_zero(name: str, array: Float[Array, "*s k"]) -> dict[str, tuple[float, float]]:
    """Bounds of widths in an array. Below 0 they mean nothing, or what they do above:
    there one that a fit is to make smaller would get larger, and hold up all others."""
    return {f"{name}[{i}]": (0.0, np.inf) for i in range(array.shape[-1])}


def coefficients(
    value: ArrayLike | Sequence[ArrayLike],
) -> Array | tuple[Array, ...]:
    """One number, or those of a polynomial, lowest power first: a tuple, so that an
    axis of an array is always one of a batch."""
    if isinstance(value, Sequence):
        several = tuple(number(entry) for entry in value)
        if not several:
            raise InputError("a polynomial needs at least one coefficient, got none.")
        return several
    return number(value)


def polynomial(
    coefficients: tuple[Float[Array, ""], ...], u: Float[Array, "*s"]
) -> Float[Array, "*s"]:
    """coefficients[0] + coefficients[1] u + ..., by Horner's rule."""
    total = jnp.zeros_like(u)
    for coefficient in reversed(coefficients):
        total = total * u + coefficient
    return total


def knee(
    z: Float[Array, "*s"],
    dx: Float[Array, "*s"],
    beta: Float[Array, ""],
    gamma: Float[Array, ""],
    n: Float[Array, ""],
) -> Float[Array, "*s"]:
    """What bends the loop of a Bouc-Wen law: beta |dx| z |z|^(n-1) + gamma dx |z|^n."""
    # Not by the sign of z, which has no slope at 0, where z has one.
    return (beta * jnp.abs(dx) * z + gamma * dx * jnp.abs(z)) * magnitude(z, n - 1)


_LEAST_POWER = 0.1  # of z, by which the size is told that it has at a knee


def knee_powers(
    beta: Float[Array, ""],
    gamma: Float[Array, ""],
    n: Float[Array, ""],
    slope: Float[ArrayLike, ""] = 1.0,
) -> dict[str, tuple[str, Array]]:
    """What `powers` tells of beta and gamma, by one over the size that z has at such a
    knee, where it starts by a `slope` over x; 1 where there is none."""
    share = (jnp.abs(beta) + jnp.abs(gamma)) / jnp.abs(slope)
    bends = (share > 0) & jnp.isfinite(share)
    # Towards n = 0, a bound that fits end on, that size is soon no number any more.
    size = jnp.where(bends, share, 1.0) ** (1 / jnp.maximum(n, _LEAST_POWER))
    return {"beta": ("n", size), "gamma": ("n", size)}


def magnitude(z: Float[Array, "*s"], n: Float[Array, ""]) -> Float[Array, "*s"]:
    """|z|^n, 1 for n = 0, with a derivative at 0: the logarithm must not see the
    zero; of negative powers 0 counts as 0."""
    moved = z != 0
    size = jnp.where(moved, jnp.abs(z), 1.0)
    at_zero = jnp.where(n == 0, 1.0, 0.0)
    return jnp.where(moved, jnp.exp(n * jnp.log(size)), at_zero)


Model = TypeVar("Model", bound=eqx.Module)


def leaf_parameters(tree: Any) -> dict[str, Array]:
    """Every real number in a PyTree by its place."""
    flat: dict[str, Array] = {}
    for path, leaf in _inexact(tree):
        # Each number that a device takes out is a program run: of tens of thousands,
        # such as relays have, that would be many seconds.
        host = np.asarray(leaf) if is_concrete(leaf) else None
        for name, index in _entries(path, leaf):
            flat[name] = leaf[index] if host is None else jnp.asarray(host[index])
    return flat


def count_of_leaves(tree: Any) -> int:
    """How many `leaf_parameters` there are."""
    return sum(leaf.size for _, leaf in _inexact(tree))


def replace_leaves(tree: Any, values: Mapping[str, ArrayLike]) -> Any:
    """The PyTree with other numbers at some of these places.

    **Raises:** `InputError` for a place where there is none.
    """
    known = changed_numbers(leaf_parameters(tree), values)

    def changed(path, leaf):
        if not _is_number(path, leaf):
            return leaf
        entries = [known[name] for name, _ in _entries(path, leaf)]
        return jnp.stack(entries).reshape(leaf.shape) if entries else leaf

    return jax.tree_util.tree_map_with_path(changed, tree)


def changed_numbers(
    known: Mapping[str, Array], values: Mapping[str, ArrayLike]
) -> dict[str, Array]:
    """Numbers by name, some of them changed.

    **Raises:** `InputError` for a name that is not known.
    """
    check_names(known, values)
    return dict(known) | {name: floats(value) for name, value in values.items()}


def check_names(known: Collection[str], names: Iterable[str]) -> None:
    """Raise `InputError` for a name that is not known."""
    unknown = [name for name in names if name not in known]
    if unknown:
        raise InputError(
            f"there is no parameter {unknown[0]!r}. {nearest(unknown[0], known)}The "
            f"parameters are {', '.join(known) or 'none'}."
        )


def _inexact(tree):
    every = jax.tree_util.tree_leaves_with_path(tree)
    return [(path, leaf) for path, leaf in every if _is_number(path, leaf)]


def _is_number(path, leaf) -> bool:
    """Whether a leaf is of a model itself, and not of what it was fitted on."""
    names = {getattr(key, "name", None) for key in path}
    return eqx.is_inexact_array(leaf) and "fitted_range" not in names


def _entries(path, leaf: Array):
    """Names and indices of the numbers in one array."""
    place = jax.tree_util.keystr(path, simple=True, separator=".")
    for index in np.ndindex(leaf.shape):
        numbered = f"[{','.join(map(str, index))}]" if index else ""
        yield place + numbered, index


def field_parameters(model: eqx.Module) -> dict[str, Array]:
    """The numbers in a model's fields, by name: `n`, or `alpha[0]`, ... for those of a
    tuple."""
    flat: dict[str, Array] = {}
    for name, value in _numeric_fields(model).items():
        entries = value if isinstance(value, tuple) else (value,)
        flat |= dict(zip(_entry_names(name, value), entries, strict=True))
    return flat


def replace_fields(model: Model, values: Mapping[str, ArrayLike]) -> Model:
    """The model with other values for some of those numbers.

    **Raises:** `InputError` for a name that is of none.
    """
    old = _numeric_fields(model)
    flat = changed_numbers(field_parameters(model), values)

    def new(name):
        entries = tuple(flat[entry] for entry in _entry_names(name, old[name]))
        return entries if isinstance(old[name], tuple) else entries[0]

    return eqx.tree_at(
        lambda tree: [getattr(tree, name) for name in old], model, list(map(new, old))
    )


def _numeric_fields(model: eqx.Module) -> dict[str, Array | tuple[Array, ...]]:
    """Fields that are an array, or a tuple of arrays."""
    values = {field.name: getattr(model, field.name) for field in fields(model)}
    return {
        name: value
        for name, value in values.items()
        if eqx.is_array(value) or (isinstance(value, tuple) and eqx.is_array(value[0]))
    }


def _entry_names(name: str, value: Array | tuple[Array, ...]) -> tuple[str, ...]:
    if not isinstance(value, tuple):
        return (name,)
    return tuple(f"{name}[{i}]" for i in range(len(value)))


_LEAST = 16  # samples
_TURN = 0.05  # of the input's range, by which it must go back for a turning point
_WIDE = 0.9  # of the widest stretch: those that are this wide are the loop
_POINTS = 41  # of the loop's branches
_REACH = 0.06  # of the input's range: half width of what a point is read off
_APART = 0.25  # of that: samples that are this near to each other count as one
_NEAR = 0.2  # of a stretch, from its start or before its end
_FLAT = 0.01  # height of a loop over the output's range that is none
_MEET = 0.25  # of a loop's height, by which its ends may be apart and it closes
_OFF = 0.25  # of half a loop's width: its middle farther from 0 is none


class Stretch(NamedTuple):
    """Rows of a record between two turning points of the input, the first row
    included; the input rises or falls by `width` all in all."""

    rows: slice
    width: float


class Loop(NamedTuple):
    """The widest loop of a record, means over all of its cycles.

    **Attributes:**

    - `u`: inputs, evenly spaced from end to end, shape (m,).
    - `rising`, `falling`: outputs there, shape (m,).
    - `start_slope`: of the output over the input after turning points.
    - `end_slope`: before them.
    - `middle_slope`: of the mean of both branches, half way between the ends.
    - `swing`: of the output, from end to end.
    """

    u: np.ndarray
    rising: np.ndarray
    falling: np.ndarray
    start_slope: float
    end_slope: float
    middle_slope: float
    swing: float

    @property
    def height(self) -> float:
        """Distance of the branches in output, where it is largest."""
        return float(np.max(np.abs(self.rising - self.falling)))

    @property
    def off_centre(self) -> bool:
        """Whether it lies to one side of 0, so that it is no loop of a device that is
        symmetric about 0, only moved."""
        return abs(float(self.u[0] + self.u[-1])) > _OFF * float(np.ptp(self.u))

    @property
    def coercive(self) -> float:
        """Half the distance of the branches in input, half way up."""
        half = (self.falling[0] + self.rising[-1]) / 2
        crossings = [
            np.interp(half, np.maximum.accumulate(w), self.u)
            for w in (self.rising, self.falling)
        ]
        return abs(crossings[0] - crossings[1]) / 2


def wide_loop(recording: Recording, *, lags: bool) -> Loop:
    """The widest loop of a record, read off by local straight lines through all samples
    of its cycles, so that noise averages out. One period that begins between its tips
    is a whole loop too.

    **Arguments:** the record; and whether the output lags behind the input, as a flux
    density does, or runs ahead, as a force does over a position.

    **Raises:** `InputError` where there is no loop, or too few samples, or one that is
    run through the other way, or whose input leaps.
    """
    u, w = _from_a_tip(*arrays(recording))
    wide, rising, falling = widest(stretches(u))
    points = np.linspace(*_common(u, wide), _POINTS)
    up, down = (_branch(u, w, points, each) for each in (rising, falling))
    gap = np.mean(up[0] - down[0])
    if abs(gap) < _FLAT * np.ptp(w):
        raise InputError(
            "`recording` has no loop: rising and falling, the output is the same; what "
            "is left is a curve."
        )
    if lags != (gap < 0):
        way = "above" if lags else "below"
        raise InputError(
            f"`recording` has a loop whose rising branch lies {way} the falling one, "
            "the other way round than this model has it. Are input and output "
            "exchanged, or is one of them of the opposite sign?"
        )
    half = _POINTS // 2
    return Loop(
        points,
        up[0],
        down[0],
        _slope(u, w, wide, after=True),
        _slope(u, w, wide, after=False),
        float(up[1][half] + down[1][half]) / 2,
        float(up[0][-1] + down[0][-1] - up[0][0] - down[0][0]) / 2,
    )


def arrays(
    recording: Recording, what: str = "guess", least: int = _LEAST
) -> tuple[np.ndarray, np.ndarray]:
    """Input and output of a record that may hold a loop, for `what` reads it off.

    **Raises:** `InputError` under tracing, for a constant column or too few samples.
    """
    as_recording(recording, f"{what}(recording)")
    checks.concrete(f"`{what}`", recording)
    checks.enough_samples(f"`{what}`", len(recording), least)
    for name, column in (("u", recording.u), ("w", recording.w)):
        checks.not_constant(name, column, "there is no loop to read off.")
    return np.asarray(recording.u), np.asarray(recording.w)


def _from_a_tip(u: np.ndarray, w: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """One period that begins between its tips, from its first tip on: as recorded, one
    of its branches is in two parts. All else, such as a virgin curve and the way back
    and forth, which does not end where it began, is as it was."""
    parts = stretches(u)
    if len(parts) != 3:
        return u, w
    first, middle, last = parts
    if abs(first.width + last.width) < _WIDE * abs(middle.width):
        return u, w
    beyond = np.flatnonzero((u[last.rows] - u[0]) * last.width >= 0)
    stop = last.rows.start + beyond[0] if beyond.size else len(u)
    order = np.argsort(u[middle.rows])
    across = np.interp(u[0], u[middle.rows][order], w[middle.rows][order])
    ends = w[[0, stop - 1]]
    if abs(ends[1] - ends[0]) > _MEET * abs(across - ends.mean()):
        return u, w
    turn = middle.rows.start
    halves = slice(turn, stop), slice(0, turn + 1)
    u, w = (np.concatenate([x[half] for half in halves]) for x in (u, w))
    return u, w


def stretches(u: np.ndarray) -> list[Stretch]:
    """The record cut at the turning points of its input, but for those of noise."""
    least, turns, way, last = _TURN * np.ptp(u), [0], 0.0, 0
    for row, value in enumerate(u):
        if (value - u[last]) * way >= 0 and value != u[last]:
            way, last = np.sign(value - u[last]) if way == 0 else way, row
        elif abs(value - u[last]) > least:
            turns.append(last)
            way, last = -way, row
    turns.append(len(u) - 1)
    return [
        Stretch(slice(a, b + 1), float(u[b] - u[a]))
        for a, b in itertools.pairwise(turns)
        if b > a
    ]


def widest(every: list[Stretch]) -> tuple[list[Stretch], list[Stretch], list[Stretch]]:
    """The widest stretches, all, those that rise and those that fall.

    **Raises:** `InputError` unless there are both.
    """
    largest = max(abs(each.width) for each in every)
    wide = [each for each in every if abs(each.width) >= _WIDE * largest]
    if len({np.sign(each.width) for each in wide}) < 2:
        # A virgin curve and the way back are a loop, the widest that there is.
        wide = [f(every, key=lambda each: each.width) for f in (max, min)]
    rising = [each for each in wide if each.width > 0]
    falling = [each for each in wide if each.width < 0]
    if not rising or not falling:
        raise InputError(
            "`recording` has no loop: its input runs in one direction only. Use a "
            "record with a cycle in it."
        )
    return wide, rising, falling


def _common(u: np.ndarray, wide: list[Stretch]) -> tuple[float, float]:
    """The inputs that all of these stretches go through."""
    lows = [u[each.rows].min() for each in wide]
    highs = [u[each.rows].max() for each in wide]
    return max(lows), min(highs)


def _branch(u, w, points, stretches):
    """Outputs and slopes at several inputs, by straight lines through the samples
    around each, near ones first."""
    u = np.concatenate([u[each.rows] for each in stretches])
    w = np.concatenate([w[each.rows] for each in stretches])
    reach = _REACH * np.ptp(points)
    # At least three samples take part, however sparse they are, and not three that are
    # one: with a whole number of samples a cycle, all cycles have nearly the same.
    _, apart = np.unique(
        np.floor((u - points[0]) / (_APART * reach)), return_index=True
    )
    if len(apart) < 3:
        raise InputError(
            "`recording` has no loop that can be read off: rising or falling, its "
            "input leaps from end to end, with fewer than three different values on "
            "the way. Sample it while it moves, or use a record whose input moves "
            "more slowly."
        )
    third = np.sort(np.abs(u[apart] - points[:, None]), axis=1)[:, 2:3]
    distance = (u - points[:, None]) / np.maximum(reach, 1.5 * third)
    weight = np.maximum(0.0, 1 - distance**2)
    away = u - points[:, None]
    total, first, second = (np.sum(weight * away**k, axis=1) for k in range(3))
    level, moment = weight @ w, (weight * away) @ w
    determinant = total * second - first**2
    slope = (total * moment - first * level) / determinant
    return (second * level - first * moment) / determinant, slope


def _slope(u, w, wide: list[Stretch], after: bool) -> float:
    """The slope of the output over the input just after, or before, the turning points
    of some stretches, which share it and its change with the distance from there."""
    rows, levels, w_all = [], [], []
    for i, each in enumerate(wide):
        turn = u[each.rows][0 if after else -1]
        distance = (u[each.rows] - turn) / np.abs(each.width)
        near = np.abs(distance) <= _NEAR
        rows.append(np.stack([distance, distance * np.abs(distance)])[:, near])
        levels.append(np.full(near.sum(), i))
        w_all.append(w[each.rows][near] / np.abs(each.width))
    group = np.concatenate(levels)[:, None] == np.arange(len(wide))
    columns = np.column_stack([*np.concatenate(rows, axis=1), group])
    found, *_ = np.linalg.lstsq(columns, np.concatenate(w_all))
    return float(found[0])


def non_negative(columns: np.ndarray, w: np.ndarray) -> tuple[np.ndarray, float]:
    """Least squares without negative coefficients, and the root of what they leave."""
    from scipy.optimize import nnls  # slow to import, and rarely needed

    return nnls(columns, w)
