"""Scalar expressions, of which programs in other languages are made."""

import math
import operator
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

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
