"""Expressions as text, in any language, and what generated files say of a law."""

import textwrap
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import jax
import numpy as np

from .._core.checks import InputError
from ..recording import Recording
from ..simulation import FixedStep, simulate
from ._program import Program, ordered
from ._rules import WHOLE, Node
from ._sums import described, one_line

_LONG = 64  # letters, beyond which what is inside gets a name of its own
_PRIMARY = 10

_INFIX = {
    "or": ("or", 2),
    "and": ("and", 3),
    "eq": ("==", 4),
    "ne": ("!=", 4),
    "lt": ("<", 5),
    "le": ("<=", 5),
    "gt": (">", 5),
    "ge": (">=", 5),
    "add": ("+", 6),
    "sub": ("-", 6),
    "mul": ("*", 7),
    "div": ("/", 7),
}


class Statement(NamedTuple):
    """A name for a value: its kind and its text."""

    name: str
    kind: str
    text: str


@dataclass(frozen=True)
class Language:
    """How one language writes expressions.

    **Attributes:**

    - `number`: of a constant.
    - `call`: of a function of an operation: its name, kind and arguments.
    - `entry`: of an entry of an array, a template of its `name` and its number `i`,
        `first` of the first.
    - `select`: of a choice, a template of the `condition` and of `a` and `b`.
    - `lookup`: of an entry of a table, a template of its name, `table`, an index `i`
        from 0 and the `last` index.
    - `symbols`: of operations that are not as in most.
    """

    number: Callable[[Node], str]
    call: Callable[[str, str, tuple[str, ...]], str]
    entry: str
    select: str
    lookup: str
    symbols: Mapping[str, str]
    first: int = 0


class Printer:
    """Prints expressions in one language.

    **Attributes:** `tables`, those that were looked up, with their names; `used`, the
    operations that were written as functions, with their kinds.
    """

    def __init__(self, language: Language, prefix: str):
        self.language, self.prefix = language, prefix
        self.tables: dict[tuple, str] = {}
        self.used: set[tuple[str, str]] = set()

    def __call__(
        self, results: list[Node], letter: str = "a"
    ) -> tuple[list[Statement], list[str]]:
        """What is computed first, under names that begin with a letter; and then the
        results."""
        order = ordered(results)
        uses = Counter(id(arg) for node in order for arg in node.args)
        uses.update(map(id, results))
        known: dict[int, tuple[str, int]] = {}
        statements: list[Statement] = []
        for node in order:
            text, rank = self._text(node, known)
            plain = node.op in ("input", "constant")
            if not plain and (uses[id(node)] > 1 or len(text) > _LONG):
                name = f"{letter}{len(statements)}"
                statements.append(Statement(name, node.kind, text))
                text, rank = name, _PRIMARY
            known[id(node)] = text, rank
        return statements, [known[id(node)][0] for node in results]

    def numbered(self) -> list[tuple[str, str, list[str]]]:
        """The tables that were looked up: their names, kinds and numbers."""
        number = self.language.number
        return [
            (
                name,
                kind,
                [number(Node("constant", (), kind, value)) for value in values],
            )
            for (kind, values), name in self.tables.items()
        ]

    def _text(self, node: Node, known) -> tuple[str, int]:
        op, language = node.op, self.language
        if op == "constant":
            text = language.number(node)
            return text, 8 if text.startswith("-") else _PRIMARY
        if op == "input":
            if isinstance(node.data, str):
                return node.data, _PRIMARY
            name, i = node.data
            return language.entry.format(name=name, i=i + language.first), _PRIMARY
        args = tuple(known[id(arg)] for arg in node.args)
        if op == "lookup":
            name = self.tables.setdefault(
                (node.kind, node.data), f"{self.prefix}_table{len(self.tables)}"
            )
            last = len(node.data) - 1
            text = language.lookup.format(table=name, i=args[0][0], last=last)
            return text, _PRIMARY
        # What a quotient of integers is, languages do not agree on.
        if op in _INFIX and (op, node.kind) != ("div", WHOLE):
            return self._infix(op, args)
        if op == "neg":
            return f"-{_within(args[0], 8)}", 8
        if op == "select":
            # Not bare inside of each other, whatever the language binds first.
            condition, a, b = (_within(arg, 2) for arg in args)
            return language.select.format(condition=condition, a=a, b=b), 0
        self.used.add((op, node.kind))
        return language.call(op, node.kind, tuple(text for text, _ in args)), _PRIMARY

    def _infix(self, op: str, args) -> tuple[str, int]:
        symbol, rank = _INFIX[op]
        symbol = self.language.symbols.get(op, symbol)
        left, right = args
        # Not every language has an order of these; and none groups to the right.
        loose = _PRIMARY if rank < 6 else rank
        first = _within(left, loose)
        second = _within(right, _PRIMARY if rank < 6 else rank + 1)
        if op == "add" and second.startswith("-") and right[1] in (7, 8):
            symbol, second = "-", second[1:]
        return f"{first} {symbol} {second}", rank


def _within(part: tuple[str, int], rank: int) -> str:
    text, own = part
    return text if own >= rank else f"({text})"


def line(text: str) -> str:
    """Any text, made fit for one line of a comment in any of the languages."""
    whole = one_line(text)
    for mark in ("*/", "/*", '"', "\\", "%{", "%}", "?"):
        whole = whole.replace(mark, " ")
    return whole


def wrapped(text: str, width: int = 78) -> list[str]:
    """Text in lines of a length."""
    return textwrap.wrap(text, width, break_long_words=False) or [""]


_TESTED = 400  # samples of a record that a self-test holds
SINGLE = 1e-3  # of the largest output, to which single precision knows the others


class Samples(NamedTuple):
    """Times, inputs, and the outputs that hystjax has for them, shape (n,); and by how
    much others, computed in double precision, may differ from these."""

    t: np.ndarray
    u: np.ndarray
    w: np.ndarray

    @property
    def allowed(self) -> float:
        share = 1e-9 if self.w.dtype == np.float64 else SINGLE
        return share * self.size

    @property
    def size(self) -> float:
        """How far the largest output is from 0."""
        return float(np.max(np.abs(self.w))) or 1.0

    def columns(self) -> list[list[float]]:
        return [column.tolist() for column in (self.t, self.u, self.w)]


def about(law: Program, name: str, record: Recording | None) -> list[str]:
    """Lines that tell the law, its units, the ranges of what it was fitted on and of a
    record, and the version."""
    from .. import __version__

    u, w = ends(law.names, law.units)
    lines = [
        f"{name}: made by hystjax {__version__}",
        "",
        *wrapped(line(law.text)),
        "",
        f"u: {u}; w: {w}; time in s.",
    ]
    known = law.fitted_range
    if known is not None:
        lines.append(line(f"Fitted range of u: {known.in_words(law.units[0])}."))
    if record is not None:
        for symbol, values in (("u", record.u), ("w", record.w)):
            low, high = float(np.min(values)), float(np.max(values))
            lines.append(f"Of the record: {symbol} from {low:g} to {high:g}.")
    return lines


def ends(names: tuple[str, str], units: tuple[str, str]) -> list[str]:
    """Descriptions of the input and the output."""
    pairs = zip(names, units, strict=True)
    return [line(described(*pair)) for pair in pairs]


def first_samples(model: Any, record: Recording | None) -> Samples | None:
    """The first samples of a record, its input straight in between, and the output
    there by `FixedStep(1)`, without a past; `None` of none."""
    if record is None:
        return None
    if len(record) < 2:
        raise InputError("a self-test needs a record of at least two samples.")
    n = min(len(record), _TESTED)
    straight = Recording(
        record.t[:n] if record.clocked else None, record.u[:n], record.w[:n]
    )
    run = simulate(model, straight, method=FixedStep(1))
    return Samples(*(np.asarray(jax.device_get(x)) for x in (run.t, run.u, run.w)))
