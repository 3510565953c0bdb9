"""What a sweep goes over, a grid or samples from ranges; what a lane of it returns, as
named arrays; and lanes as a labelled dataset."""

import textwrap
from abc import abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.tree_util import DictKey, GetAttrKey, SequenceKey, tree_flatten_with_path
from jaxtyping import Array, Int, PyTree

from .._core import checks
from .._core.checks import InputError, described
from .._core.solution import RESULTS, Solution, names_by_code, outcome
from ..models import AbstractModel
from ..recording import Recording


class Uniform(eqx.Module):
    """Every value between `low` and `high` is as likely."""

    low: float
    high: float

    def __check_init__(self):
        if not _rising(self.low, self.high):
            raise InputError(f"`Uniform({self.low}, {self.high})` needs low < high.")

    def at(self, share: np.ndarray) -> np.ndarray:
        """The values that a share (0 to 1) of all lie below."""
        low, high = float(self.low), float(self.high)  # whose range may be infinite
        return low * (1 - share) + high * share


class LogUniform(eqx.Module):
    """Every ratio is as likely between `low` and `high`, both positive."""

    low: float
    high: float

    def __check_init__(self):
        if not _rising(0, self.low, self.high):
            raise InputError(
                f"`LogUniform({self.low}, {self.high})` needs 0 < low < high."
            )

    def at(self, share: np.ndarray) -> np.ndarray:
        """The values that a share (0 to 1) of all lie below."""
        low, high = float(self.low), float(self.high)  # whose ratio may be infinite
        return low ** (1 - share) * high**share


def _rising(*ends: Any) -> bool:
    """Whether these are finite numbers, each above the last."""
    try:
        numbers = np.asarray(ends)
    except ValueError:  # several numbers beside one
        return False
    plain = numbers.ndim == 1 and numbers.dtype.kind in "iuf"
    return plain and bool(np.all(np.diff(numbers) > 0) and np.all(np.isfinite(numbers)))


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
        if not isinstance(labels, Iterable | None):
            raise InputError(
                f"`labels` must be a list of names, got {described(labels)}."
            )
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
        checks.count("count", count)
        checks.count("seed", seed, 0)
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


RESULT = "result"
_NONFINITE: Any = RESULTS.nonfinite
_Item = type(RESULTS.successful)


class Variable(eqx.Module):
    """A named array of a lane.

    **Attributes:**

    - `values`: of any shape.
    - `dims`: names of its axes, or none for unnamed ones.
    - `labels`: of its last axis.
    - `coded`: whether the values are numbers of members of `RESULTS`.
    """

    values: Array
    dims: tuple[str, ...] = eqx.field(static=True, default=())
    labels: tuple[str, ...] = eqx.field(static=True, default=())
    coded: bool = eqx.field(static=True, default=False)


def variables(output: Any) -> dict[str, Variable]:
    """The arrays of what a lane returned, by name, and how it ended as `result`.

    Of a `Solution` these are what its model tabulates (the coefficients and support of
    a `SparseModel`, the parameters of others), and those of `stats` that are numbers or
    vectors, alone or in a dictionary. Of anything else they are all arrays in it, named
    by where they are. What does not say how it ended has ended as the first of the
    results in it that is no success; without one it has succeeded if all its numbers
    are finite, but for those of parts that say themselves how they ended.

    **Raises:** `InputError` for what is no number, two arrays of one name, and a
    `result` that does not say how the lane ended.
    """
    if isinstance(output, Solution):
        found, told = _of_value(output.value), _of_stats(output.stats)
        told |= {RESULT: _code(output.result)}
        if both := sorted(found.keys() & told.keys()):
            raise InputError(
                f"a number of the model and one of `stats` are both called "
                f"{both[0]!r}: return what is wanted of them as a dictionary."
            )
        return found | told
    found = _of_own(output)
    if RESULT not in found:
        told = tuple(
            name.removesuffix(RESULT)
            for name, each in found.items()
            if each.coded and name.endswith(f".{RESULT}")
        )
        floats = [
            each.values
            for name, each in found.items()
            if eqx.is_inexact_array(each.values) and not name.startswith(told)
        ]
        finite = jnp.all(jnp.array([jnp.all(jnp.isfinite(each)) for each in floats]))
        last = _code(outcome(finite, _NONFINITE))
        codes = [v.values.ravel() for v in (*found.values(), last) if v.coded]
        found[RESULT] = _first_failure(jnp.concatenate(codes))
    return found


def value_asked(function: Any, arguments: Mapping[str, Any]) -> InputError:
    """What to say of a function that asks for the value of what is traced.

    **Arguments:** the function, and arguments that it could be called with by name; the
    one whose value it asks for is that without which, as a plain number, tracing fails.
    """
    found = [name for name in arguments if _traced_but(name, function, arguments)]
    whose = f"`{found[0]}`" if len(found) == 1 else "one of its arguments"
    a = found[0] if len(found) == 1 else next(iter(arguments))
    return InputError(
        f"`function` asks for the value of {whose}, as `float({a})`, `if {a} > 0:` and "
        "functions of NumPy and `math` do, and in a sweep there is none yet: lanes are "
        "one program of JAX, in which arguments are traced. Leave `float` and `int` "
        "out, use `jax.numpy` for NumPy and `math`, and `jax.numpy.where("
        f"{a} > 0, this, that)` for `if`. What decides over shapes, terms or texts "
        "cannot be swept: call `sweep` for each of its values."
    )


def _traced_but(name: str, function: Any, arguments: Mapping[str, Any]) -> bool:
    """Whether a function can be traced in all arguments but one."""
    known = {name: jax.tree.map(_as_numpy, arguments[name])}
    others = {key: value for key, value in arguments.items() if key != name}
    try:
        eqx.filter_eval_shape(lambda others: function(**known, **others), others)
    except Exception:  # of whatever kind: it is said already that it fails
        return False
    return True


def _as_numpy(leaf: Any) -> Any:
    """A number that stays known: under `jit` what JAX makes of its own is traced."""
    return leaf if _is_key(leaf) or not eqx.is_array(leaf) else np.asarray(leaf)[()]


def _first_failure(codes: Int[Array, " n"]) -> Variable:
    good: Any = RESULTS.successful
    return Variable(codes[jnp.argmax(codes != good._value)], coded=True)


def _of_value(value: Any) -> dict[str, Variable]:
    if isinstance(value, AbstractModel):
        return {
            name: Variable(jnp.asarray(array), ("term",) if labels else (), labels)
            for name, (array, labels) in value.tabulated().items()
        }
    return {} if value is None else _of_own(value)


def _of_stats(stats: dict[str, Any]) -> dict[str, Variable]:
    plain = {
        key: value
        for key, value in stats.items()
        if eqx.is_array_like(value) or isinstance(value, dict)
    }
    found = _of_tree(plain)
    return {name: each for name, each in found.items() if each.values.ndim < 2}


def _of_own(tree: Any) -> dict[str, Variable]:
    """The arrays of what the caller put together, of which nothing may get lost."""
    names = set()
    for path, leaf in _leaves(tree):
        name = _name(path)
        # What a model or a recording has of these is no result.
        in_object = any(isinstance(key, GetAttrKey) for key in path)
        if in_object and (leaf is None or callable(leaf)):
            continue
        if not _is_kept(leaf):
            data = "`jax.random.key_data` of it" if _is_key(leaf) else "a number for it"
            raise InputError(
                f"`function` returns {name!r}, {_in_words(leaf)}, and a dataset of "
                f"lanes holds numbers: leave it out, or return {data}."
            )
        if name == RESULT and not _is_result(leaf):
            raise InputError(
                f"`function` returns {name!r}, which in a sweep is how a lane ended, "
                "such as the `result` of a `Solution`; give these numbers another name."
            )
        if name in names:
            raise InputError(
                f"`function` returns two arrays that are called {name!r} here; give "
                "one of them another name."
            )
        names.add(name)
    return _of_tree(tree)


def _of_tree(tree: Any) -> dict[str, Variable]:
    return {_name(path): _leaf(leaf) for path, leaf in _leaves(tree) if _is_kept(leaf)}


def _leaves(tree: Any) -> list[tuple[Any, Any]]:
    def ends(leaf):
        return leaf is None or _is_result(leaf)

    return tree_flatten_with_path(tree, is_leaf=ends)[0]


def _is_kept(leaf: Any) -> bool:
    text = isinstance(leaf, np.ndarray | np.generic) and leaf.dtype.kind not in "biufcV"
    return _is_result(leaf) or (
        eqx.is_array_like(leaf) and not text and not _is_key(leaf)
    )


def _is_key(leaf: Any) -> bool:
    array = isinstance(leaf, jax.Array)
    return array and jnp.issubdtype(leaf.dtype, jax.dtypes.prng_key)


def _in_words(leaf: Any) -> str:
    if leaf is None:
        return "None"
    if _is_key(leaf):
        return "a key of `jax.random`"
    return f"{textwrap.shorten(repr(leaf), 60)} ({type(leaf).__name__})"


def _name(path: Any) -> str:
    return ".".join(map(_key, path)) or "value"


def _leaf(leaf: Any) -> Variable:
    return _code(leaf) if _is_result(leaf) else Variable(jnp.asarray(leaf))


def _code(result: Any) -> Variable:
    known = result._enumeration is RESULTS
    code = (result if known else RESULTS.promote(result))._value
    return Variable(jnp.asarray(code), coded=True)


def _is_result(leaf: Any) -> bool:
    return isinstance(leaf, _Item)


def _key(key: Any) -> str:
    match key:
        case DictKey():
            return str(key.key)
        case GetAttrKey():
            return key.name
        case SequenceKey():
            return str(key.idx)
    return jax.tree_util.keystr((key,))


if TYPE_CHECKING:
    import xarray

_PACKAGES = ("jax", "equinox", "numpy")


def dataset(
    space: AbstractSpace,
    found: Mapping[str, np.ndarray],
    described: Mapping[str, Variable],
    dims: Mapping[str, str | Sequence[str]],
    coords: Mapping[str, Any],
) -> "xarray.Dataset":
    """A dataset with the axes of the space.

    **Arguments:** the space; arrays with an axis of lanes first, by name; what is known
    of them; and names and values of their further axes that go before that.

    **Raises:** `InputError` when those do not fit the arrays.
    """
    import xarray  # brings pandas: only those who sweep pay

    for argument, by_name in (("dims", dims), ("coords", coords)):
        if not isinstance(by_name, Mapping):
            raise InputError(
                f"`{argument}` must be a mapping of names, got "
                f"{checks.described(by_name)}."
            )
    _check_known("dims", "array", dims, found)
    shape, labels = space.shape, dict(coords)
    data = {}
    for name, array in found.items():
        own = _own_axes(name, array.ndim - 1, described[name], dims)
        _check_axes(name, own, [*space.shape, *space.axes, *found])
        if described[name].labels and own == described[name].dims:
            labels.setdefault(own[-1], list(described[name].labels))
        whole = array.reshape(*shape.values(), *array.shape[1:])
        axes = (*shape, *own)
        data[name] = _reasons(axes, whole) if described[name].coded else (axes, whole)
    _check_names(space, data)
    own = {axis for axes, *_ in data.values() for axis in axes} - set(shape)
    _check_known("coords", "further axis", coords, own)
    attributes = {"lanes": len(space)} | {name: version(name) for name in _PACKAGES}
    try:
        return xarray.Dataset(data, {**labels, **space.coordinates()}, attributes)
    except ValueError as error:
        raise InputError(
            f"`dims` and `coords` do not fit what `function` returns: {error}"
        ) from None


def _own_axes(name: str, count: int, described: Variable, dims) -> tuple[str, ...]:
    given = dims.get(name, described.dims)
    own = (given,) if isinstance(given, str) else tuple(given)
    own = own or tuple(f"{name}_{i}" for i in range(count))
    if len(own) != count:
        raise InputError(
            f"`dims` names {len(own)} axes of {name!r} ({', '.join(own)}), and it has "
            f"{count} in each lane."
        )
    return own


def _check_axes(name: str, own: tuple[str, ...], taken: Sequence[str]) -> None:
    twice = [axis for i, axis in enumerate(own) if axis in (*taken, *own[:i])]
    if twice:
        raise InputError(
            f"an axis of {name!r} has the name {twice[0]!r}, which is that of another "
            "axis, of an array or of a parameter; choose another for that, or for this "
            "in `dims`."
        )


def _check_known(argument: str, what: str, given, known) -> None:
    unknown = [name for name in given if name not in known]
    if unknown:
        raise InputError(
            f"`{argument}` names {unknown[0]!r}, and no {what} of the results has that "
            f"name; there are: {', '.join(map(repr, sorted(known))) or 'none'}."
        )


def _reasons(axes: tuple[str, ...], codes: np.ndarray):
    """Results by name, and in words those that are no success."""
    names = names_by_code()
    reasons = {
        names[code]: RESULTS._index_to_message[code] for code in np.unique(codes)
    }
    reasons.pop("successful", None)
    return axes, np.array([names[code] for code in sorted(names)])[codes], reasons


def _check_names(space: AbstractSpace, data: Mapping[str, Any]) -> None:
    both = sorted((set(space.axes) | set(space.shape)) & set(data))
    if both:
        raise InputError(
            f"`function` returns {', '.join(map(repr, both))}, which is a parameter "
            "of the sweep too; give one of them another name."
        )
