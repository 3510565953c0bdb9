"""Scalar expressions, of which programs in other languages are made, and what each
operation of JAX becomes in them."""

import math
import operator
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from .._core.checks import InputError

REAL, WHOLE, TRUTH = "real", "whole", "truth"
"""Kinds of values: floats, integers, and what is true or false."""


@dataclass(frozen=True, eq=False, slots=True)
class Node:
    """A scalar: an operation on others. Two of one `Graph` are equal only if they are
    the same object.

    **Attributes:**

    - `op`: `constant`, `input`, `lookup` (in a table of constants), or an operation by
        its name.
    - `args`: what it is of.
    - `kind`: one of `REAL`, `WHOLE` and `TRUTH`.
    - `data`: a constant's value, an input's name or a table.
    """

    op: str
    args: tuple["Node", ...]
    kind: str
    data: Any = None


_FOLDED: dict[str, Callable] = {
    "add": operator.add,
    "sub": operator.sub,
    "mul": operator.mul,
    "neg": operator.neg,
    "abs": abs,
    "lt": operator.lt,
    "le": operator.le,
    "gt": operator.gt,
    "ge": operator.ge,
    "eq": operator.eq,
    "ne": operator.ne,
    "and": lambda a, b: a and b,
    "or": lambda a, b: a or b,
    "not": operator.not_,
}


class Graph:
    """Makes nodes, each different one once, and those that are plain at once simpler.

    Nothing that could round differently is changed, so that a program computes what the
    law does to the last bit, but for what functions such as exp are in its language.
    """

    def __init__(self):
        self._known: dict[Any, Node] = {}

    def __len__(self) -> int:
        return len(self._known)

    def input(self, name: str | tuple[str, int], kind: str = REAL) -> Node:
        """A value that is not known yet."""
        return self._node("input", (), kind, name)

    def constant(self, value: Any, kind: str) -> Node:
        """A number."""
        made = {REAL: float, WHOLE: int, TRUTH: bool}[kind](value)
        return self._node("constant", (), kind, made)

    def __call__(self, op: str, *args: Node, kind: str, data: Any = None) -> Node:
        """An operation, or what is the same and simpler."""
        if op in _FOLDED and all(arg.op == "constant" for arg in args):
            return self.constant(_FOLDED[op](*(arg.data for arg in args)), kind)
        return self._simpler(op, args) or self._node(op, args, kind, data)

    def _node(self, op: str, args: tuple[Node, ...], kind: str, data: Any) -> Node:
        # By its text, since 0.0 equals -0.0, and NaN not itself.
        key = op, tuple(map(id, args)), kind, repr(data)
        if key not in self._known:
            self._known[key] = Node(op, args, kind, data)
        return self._known[key]

    def _simpler(self, op: str, args: tuple[Node, ...]) -> Node | None:
        first, last = args[0], args[-1]
        if op in ("add", "or") and _is(first, 0):
            return last
        if op in ("add", "sub", "or") and _is(last, 0):
            return first
        if op in ("mul", "and") and _is(first, 1):
            return last
        if op in ("mul", "div", "and") and _is(last, 1):
            return first
        if op == "sub" and first.op == "add" and first.args[0] is last:
            # (t + h) - t, of times: h without the rounding of t.
            return first.args[1] if last.data == "t" else None
        if op == "sub" and _of_time(first) and _of_time(last):
            return self("sub", first.args[1], last.args[1], kind=REAL)
        if op == "select":
            return _chosen(*args)
        return None


def _is(node: Node, value: int) -> bool:
    if node.op != "constant" or math.isnan(node.data):
        return False
    return node.data == value


def _of_time(node: Node) -> bool:
    return node.op == "add" and node.args[0].data == "t"


def _chosen(condition: Node, true: Node, false: Node) -> Node | None:
    """One of two, where it is known which or both are the same; -0 counts as 0."""
    if condition.op == "constant":
        return true if condition.data else false
    if true is false:
        return true
    of = condition.args
    if condition.op == "eq" and of[0] is false and _is(of[1], 0) and _is(true, 0):
        return false
    unlike = condition.op == "ne" and of[0] is of[1]  # of NaN only
    if unlike and of[0] is false and true.op == "constant" and math.isnan(true.data):
        return false
    return None


SAME = {  # operations element by element, by their names here
    **{name: name for name in ("add", "sub", "mul", "div", "neg", "abs", "sign")},
    **{name: name for name in ("exp", "log", "log1p", "expm1", "sqrt", "floor")},
    **{name: name for name in ("sin", "cos", "tan", "tanh", "sinh", "cosh", "ceil")},
    **{name: name for name in ("atan", "asin", "acos", "atan2", "pow", "max", "min")},
    **{name: name for name in ("eq", "ne", "lt", "le", "gt", "ge")},
    **{name: name for name in ("and", "or", "not", "cbrt")},
    "add_any": "add",
    "lt_to": "lt",
    "le_to": "le",
}
REDUCED = {
    "reduce_sum": "add",
    "reduce_max": "max",
    "reduce_min": "min",
    "reduce_prod": "mul",
    "reduce_and": "and",
    "reduce_or": "or",
}
_OF_NOTHING = {"add": 0, "mul": 1, "max": -math.inf, "min": math.inf}
_OF_NOTHING |= {"and": True, "or": False}
LOGICAL = ("and", "or", "not", "reduce_and", "reduce_or")  # of bits too, in JAX
ALIKE = ("copy", "copy_p", "stop_gradient", "reduce_precision", "optimization_barrier")


def kind_of(dtype: Any) -> str:
    """The kind of an array's numbers."""
    if np.issubdtype(dtype, np.bool_):
        return TRUTH
    return REAL if np.issubdtype(dtype, np.floating) else WHOLE


class Rules:
    """Rules by name of an operation, after an underscore: of its inputs, arrays of
    nodes, its parameters, and the shape of its result.

    **Arguments:** the `graph` of the expressions, and `what` is traced, for messages.
    """

    def __init__(self, graph: Graph, what: str):
        self.graph, self.what = graph, what

    # Element by element.

    def _each(self, op: str, lifted: list, aval: Any) -> np.ndarray:
        kind = kind_of(aval.dtype)

        def one(*args):
            return self.graph(op, *args, kind=kind)

        return elementwise(one, *lifted)

    def lifted(self, x: Any, dtype: Any) -> np.ndarray:
        """Numbers as nodes."""
        if x.dtype == object:
            return x
        kind = kind_of(dtype)
        return elementwise(lambda value: self.graph.constant(value, kind), x)

    def _select_n(self, inputs, parameters, aval):
        which, *cases = inputs
        kind = kind_of(aval.dtype)

        def one(which, *cases):
            if which.kind == TRUTH:
                return self.graph("select", which, cases[1], cases[0], kind=kind)
            chosen = cases[-1]
            for i in range(len(cases) - 2, -1, -1):
                number = self.graph.constant(i, WHOLE)
                here = self.graph("eq", which, number, kind=TRUTH)
                chosen = self.graph("select", here, cases[i], chosen, kind=kind)
            return chosen

        return elementwise(one, np.broadcast_to(which, cases[0].shape), *cases)

    def _clamp(self, inputs, parameters, aval):
        kind = kind_of(aval.dtype)

        def one(low, x, high):
            least = self.graph("max", low, x, kind=kind)
            return self.graph("min", least, high, kind=kind)

        return elementwise(one, *inputs)

    def _integer_pow(self, inputs, parameters, aval):
        power = parameters["y"]
        one = self.graph.constant(1, REAL)

        def raised(x):
            # By squares, in the order in which XLA multiplies.
            result, square, left = None, x, abs(power)
            while left:
                if left & 1:
                    result = square if result is None else self._times(result, square)
                left >>= 1
                square = self._times(square, square) if left else square
            result = result or one
            return self.graph("div", one, result, kind=REAL) if power < 0 else result

        return elementwise(raised, inputs[0])

    def _square(self, inputs, parameters, aval):
        return elementwise(lambda x: self._times(x, x), inputs[0])

    def _polynomial(self, inputs, parameters, aval):  # of JAX 0.12
        x, *coefficients = inputs
        *lower, total = coefficients
        for coefficient in reversed(lower):
            total = self._each(
                "add", [self._each("mul", [total, x], aval), coefficient], aval
            )
        return total

    def _times(self, a: Node, b: Node) -> Node:
        return self.graph("mul", a, b, kind=a.kind)

    def _logistic(self, inputs, parameters, aval):
        one, g = self.graph.constant(1, REAL), self.graph

        def sigmoid(x):
            left = g("exp", g("neg", x, kind=REAL), kind=REAL)
            return g("div", one, g("add", one, left, kind=REAL), kind=REAL)

        return elementwise(sigmoid, inputs[0])

    def _is_finite(self, inputs, parameters, aval):
        zero = self.graph.constant(0, REAL)

        def finite(x):  # of inf and NaN, less themselves, NaN is left
            gap = self.graph("sub", x, x, kind=REAL)
            return self.graph("eq", gap, zero, kind=TRUTH)

        return elementwise(finite, inputs[0])

    def _convert_element_type(self, inputs, parameters, aval):
        kind = kind_of(aval.dtype)
        zero = {k: self.graph.constant(0, k) for k in (REAL, WHOLE)}

        def converted(x):
            if x.kind == kind:
                return x
            if x.op == "constant":
                return self.graph.constant(x.data, kind)
            if kind == TRUTH:
                return self.graph("ne", x, zero[x.kind], kind=TRUTH)
            if x.kind == TRUTH:
                sides = (self.graph.constant(i, kind) for i in (1, 0))
                return self.graph("select", x, *sides, kind=kind)
            return self.graph("convert", x, kind=kind)

        return elementwise(converted, inputs[0])

    # Which only moves numbers.

    def _broadcast_in_dim(self, inputs, parameters, aval):
        x, shape = inputs[0], parameters["shape"]
        places = parameters["broadcast_dimensions"]
        wide = [1] * len(shape)
        for size, place in zip(x.shape, places, strict=True):
            wide[place] = size
        return np.broadcast_to(x.reshape(wide), shape)

    def _reshape(self, inputs, parameters, aval):
        return inputs[0].reshape(aval.shape)

    _squeeze = _expand_dims = _reshape

    def _transpose(self, inputs, parameters, aval):
        return inputs[0].transpose(parameters["permutation"])

    def _slice(self, inputs, parameters, aval):
        limits = parameters["start_indices"], parameters["limit_indices"]
        strides = parameters["strides"] or [1] * inputs[0].ndim
        return inputs[0][tuple(map(slice, *limits, strides))]

    def _concatenate(self, inputs, parameters, aval):
        return np.concatenate(inputs, axis=parameters["dimension"])

    def _stack(self, inputs, parameters, aval):
        return np.stack(inputs, axis=parameters.get("axis", 0))

    def _unstack(self, inputs, parameters, aval):
        axis = parameters.get("axis", 0)
        return [np.asarray(x, object) for x in np.moveaxis(inputs[0], axis, 0)]

    def _rev(self, inputs, parameters, aval):
        return np.flip(inputs[0], parameters["dimensions"])

    def _split(self, inputs, parameters, aval):
        ends = np.cumsum(parameters["sizes"])[:-1]
        return np.split(inputs[0], ends, axis=parameters["axis"])

    def _dynamic_slice(self, inputs, parameters, aval):
        x, *start = inputs
        sizes = parameters["slice_sizes"]
        offsets = list(np.ndindex(*sizes))
        found = [
            self._entry(x, _shifted(start, sizes, x, offset)) for offset in offsets
        ]
        return _array(found, sizes)

    def _gather(self, inputs, parameters, aval):
        x, indices = inputs
        numbers, sizes = parameters["dimension_numbers"], parameters["slice_sizes"]
        batched = [i for i in range(len(aval.shape)) if i not in numbers.offset_dims]
        gone = {*numbers.collapsed_slice_dims, *numbers.operand_batching_dims}
        kept = [d for d in range(x.ndim) if d not in gone]
        zero = self.graph.constant(0, WHOLE)
        found = []
        for place in np.ndindex(*aval.shape):
            batch = [place[i] for i in batched]
            start: list[Any] = [zero] * x.ndim
            for i, dimension in enumerate(numbers.start_index_map):
                start[dimension] = indices[(*batch, i)]
            pairs = zip(
                numbers.operand_batching_dims,
                numbers.start_indices_batching_dims,
                strict=True,
            )
            for dimension, of in pairs:
                start[dimension] = self.graph.constant(batch[of], WHOLE)
            offset = [0] * x.ndim
            for dimension, i in zip(kept, numbers.offset_dims, strict=True):
                offset[dimension] = place[i]
            found.append(self._entry(x, _shifted(start, sizes, x, offset)))
        return _array(found, aval.shape)

    def _entry(self, x: np.ndarray, place: list) -> Node:
        """The entry of an array at a place of numbers, but one that is computed; within
        the array, as a slice of JAX's is."""
        computed = [d for d, (i, _, _) in enumerate(place) if i.op != "constant"]
        if len(computed) > 1:
            raise InputError(
                f"{self.what} looks tables up by two computed numbers, for which "
                "source text is not made; `hystjax.save` keeps it."
            )
        at: list[Any] = []
        for index, offset, last in place:
            known = index.op == "constant"
            at.append(min(max(index.data, 0), last) + offset if known else slice(None))
        row: Any = x[tuple(at)]
        if not computed:
            return row
        index, offset, last = place[computed[0]]
        row = row[offset : offset + last + 1]
        if len(row) == 1:
            return row[0]
        if all(each.op == "constant" for each in row):
            table = tuple(each.data for each in row)
            return self.graph("lookup", index, kind=row[0].kind, data=table)
        chosen = row[-1]
        for i in range(len(row) - 2, -1, -1):
            number = self.graph.constant(i, WHOLE)
            here = self.graph("le", index, number, kind=TRUTH)
            chosen = self.graph("select", here, row[i], chosen, kind=row[i].kind)
        return chosen

    def _scatter(self, inputs, parameters, aval):
        x, indices, new = inputs
        if any(i.op != "constant" for i in indices.flat):
            raise InputError(
                f"{self.what} writes to computed places of an array, for which source "
                "text is not made; `hystjax.save` keeps it."
            )
        # Where which number goes, found by numbers that tell them apart.
        old = jnp.arange(x.size).reshape(x.shape)
        fresh = x.size + jnp.arange(new.size).reshape(new.shape)
        places = jnp.asarray(elementwise(lambda i: i.data, indices).astype(int))
        plain = {**parameters, "update_jaxpr": None, "update_consts": ()}
        ids = jax.lax.scatter_p.bind(old, places, fresh, **plain)
        every = np.concatenate([x.ravel(), new.ravel()])
        return every[np.asarray(ids)]

    # Sums and the like.

    def _reduced(self, op: str, x: np.ndarray, axes: Any, aval: Any) -> np.ndarray:
        kind = kind_of(aval.dtype)
        for axis in sorted(axes, reverse=True):
            rows = list(np.moveaxis(x, axis, 0))
            if not rows:  # a sum of nothing is 0, as JAX has it
                nothing = _OF_NOTHING[op]
                return self.lifted(np.full(aval.shape, nothing), aval.dtype)
            x = np.asarray(rows[0], object)
            for row in rows[1:]:
                x = elementwise(lambda a, b: self.graph(op, a, b, kind=kind), x, row)
        return np.asarray(x, object)

    def _cumsum(self, inputs, parameters, aval, op="add"):
        axis, reverse = parameters["axis"], parameters["reverse"]
        rows = list(np.moveaxis(inputs[0], axis, 0))
        rows = rows[::-1] if reverse else rows
        kind = kind_of(aval.dtype)
        sums = [rows[0]]
        for row in rows[1:]:
            pair = sums[-1], row
            sums.append(
                elementwise(lambda a, b: self.graph(op, a, b, kind=kind), *pair)
            )
        sums = sums[::-1] if reverse else sums
        return np.moveaxis(np.stack(sums), 0, axis)

    def _cummax(self, inputs, parameters, aval):
        return self._cumsum(inputs, parameters, aval, "max")

    def _dot_general(self, inputs, parameters, aval):
        a, b = inputs
        (left, right), (batch_a, batch_b) = parameters["dimension_numbers"]
        if batch_a or batch_b:
            raise InputError(
                f"{self.what} multiplies batches of matrices, for which source text is "
                "not made; `hystjax.save` keeps it."
            )
        kind = kind_of(aval.dtype)
        a = np.moveaxis(a, left, range(-len(left), 0))
        b = np.moveaxis(b, right, range(len(right)))
        size = int(np.prod([1, *b.shape[: len(right)]]))
        rows, columns = a.reshape(-1, size), b.reshape(size, -1)
        found = []
        for row in rows:
            for column in columns.T:
                total = self.graph.constant(0, kind)
                for pair in zip(row, column, strict=True):
                    product = self.graph("mul", *pair, kind=kind)
                    total = self.graph("add", total, product, kind=kind)
                found.append(total)
        return _array(found, aval.shape)


def _shifted(start: list, sizes: Any, x: np.ndarray, offset: Any) -> list:
    """Of each axis: where a slice starts, how far in it a place is, and the last start
    for which all of the slice is in the array."""
    lasts = (n - size for n, size in zip(x.shape, sizes, strict=True))
    starts = (each if isinstance(each, Node) else each[()] for each in start)
    return list(zip(starts, offset, lasts, strict=True))


def elementwise(function: Callable, *arrays: Any) -> np.ndarray:
    with np.errstate(all="ignore"):  # what is known is computed as it would be later
        made = np.frompyfunc(function, len(arrays), 1)(*arrays)
    return np.asarray(made, object)


def _array(nodes: list[Node], shape: Any) -> np.ndarray:
    array = np.empty(len(nodes), object)
    array[:] = nodes
    return array.reshape(shape)
