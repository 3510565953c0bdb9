"""A model as a program: what every language writes, in scalar expressions, and those as
text, with what generated files say of a law.

JAX traces a function into a list of operations on arrays. These are run once more, with
an expression in each place of an array: what only moves numbers about needs no
operation of its own then, constants come out as numbers, and loops of known length are
unrolled. So a model's equations are what it computes, told once, in its own methods.
"""

import re
import textwrap
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.extend.core import Literal
from jaxtyping import Array

from .._core import checks
from .._core.checks import InputError
from .._core.solution import RESULTS, ended
from ..models import AbstractModel, AbstractSequenceModel, FittedRange, comes_late
from ..models._numbers import floats
from ..models._sequence import warn_of_units
from ..recording import Recording
from ..signals import Grid, Signals
from ..simulation import FixedStep, first_state, simulate
from ._rules import (
    ALIKE,
    LOGICAL,
    REAL,
    REDUCED,
    SAME,
    TRUTH,
    WHOLE,
    Graph,
    Node,
    Rules,
    kind_of,
)
from ._sums import check_numbers, check_one, described, one_line, to_text

_MOST = 40_000  # expressions in one program

_INNER = ("jaxpr", "call_jaxpr", "fun_jaxpr")


class Tracer(Rules):
    """Traces functions of one model.

    **Arguments:** the `graph` of their expressions, and `what` is traced, for messages.
    """

    def __call__(self, function: Callable, *args: Any) -> Any:
        """What a function makes of PyTrees of arrays of nodes: a PyTree of such."""
        leaves, structure = jax.tree.flatten(args)
        shapes = [_shape(leaf) for leaf in leaves]

        def flat(*given):
            return function(*jax.tree.unflatten(structure, given))

        closed, out = jax.make_jaxpr(flat, return_shape=True)(*shapes)
        results = self._run(closed.jaxpr, closed.consts, leaves)
        lifted = [
            self.lifted(x, shape.dtype)
            for x, shape in zip(results, jax.tree.leaves(out), strict=True)
        ]
        return jax.tree.unflatten(jax.tree.structure(out), lifted)

    def _run(self, jaxpr: Any, constants: Any, args: Any) -> list:
        known: dict[Any, Any] = {}
        known.update(zip(jaxpr.constvars, map(np.asarray, constants), strict=True))
        known.update(zip(jaxpr.invars, args, strict=True))

        def read(v):
            return np.asarray(v.val) if isinstance(v, Literal) else known[v]

        for equation in jaxpr.eqns:
            inputs = [read(v) for v in equation.invars]
            outputs = self._apply(equation, inputs)
            known.update(zip(equation.outvars, outputs, strict=True))
            if len(self.graph) > _MOST:
                raise InputError(
                    f"{self.what} comes to more than {_MOST} operations, too many to "
                    "be written out; `hystjax.save` keeps it."
                )
        return [read(v) for v in jaxpr.outvars]

    def _apply(self, equation: Any, inputs: list) -> list:
        name, parameters = equation.primitive.name, equation.params
        inner = next((parameters[key] for key in _INNER if key in parameters), None)
        if name == "scan":
            return self._scan(equation, inputs)
        if name == "while":
            return self._while(parameters, inputs)
        if name == "cond":
            return self._cond(parameters, inputs)
        if inner is not None:
            return self._run(*_open(inner), inputs)
        if "_prim" in parameters:  # JAX 0.12: made of others, and says of which
            shapes = [
                jax.ShapeDtypeStruct(x.aval.shape, x.aval.dtype)
                for x in equation.invars
            ]
            made_of = jax.make_jaxpr(parameters["_prim"].expand)(*shapes)
            return self._run(*_open(made_of), inputs)
        if not any(x.dtype == object for x in inputs):  # known now
            known = [jnp.asarray(x) for x in inputs]
            result = equation.primitive.bind(*known, **parameters)
            several = result if equation.primitive.multiple_results else [result]
            return [np.asarray(each) for each in several]
        rule: Callable | None = getattr(self, f"_{name}", None)
        aval = equation.outvars[0].aval
        if name in ALIKE:
            return [inputs[0]]
        if name in LOGICAL and kind_of(aval.dtype) != TRUTH:
            raise InputError(
                f"{self.what} computes `{name}` of bits of whole numbers, for which "
                "source text is not made; `hystjax.save` keeps it."
            )
        pairs = zip(inputs, equation.invars, strict=True)
        lifted = [self.lifted(x, v.aval.dtype) for x, v in pairs]
        if name in SAME:
            return [self._each(SAME[name], lifted, aval)]
        if name in REDUCED:
            return [self._reduced(REDUCED[name], lifted[0], parameters["axes"], aval)]
        if rule is None:
            raise InputError(
                f"{self.what} computes `{name}`, for which source text is not made; "
                "`hystjax.save` keeps it."
            )
        result = rule(lifted, parameters, aval)
        return result if isinstance(result, list) else [result]

    def _scan(self, equation, inputs):
        parameters = equation.params
        body, constants = _open(parameters["jaxpr"])
        # First what stays, then what is carried, then rows, of which a step sees one at
        # a time: by that they are told apart, for versions of JAX count them otherwise.
        carried = len(body.outvars) - _longer(equation.outvars, body.outvars)
        fixed = len(inputs) - carried - _longer(equation.invars, body.invars)
        still, rest = inputs[:fixed], inputs[fixed:]
        state, rows = rest[:carried], rest[carried:]
        steps = range(parameters["length"])
        made: list[list] = []
        for i in reversed(steps) if parameters["reverse"] else steps:
            row = [np.asarray(x[i], x.dtype) for x in rows]
            out = self._run(body, constants, [*still, *state, *row])
            state = out[:carried]
            made.append(out[carried:])
        made = made[::-1] if parameters["reverse"] else made
        stacked = []
        for column, v in zip(
            zip(*made, strict=True), body.outvars[carried:], strict=True
        ):
            mixed = any(x.dtype == object for x in column)
            column = [self.lifted(x, v.aval.dtype) for x in column] if mixed else column
            stacked.append(np.stack(column))
        return [*state, *stacked]

    def _while(self, parameters, inputs):
        whether, outer = _open(parameters["cond_jaxpr"])
        body, constants = _open(parameters["body_jaxpr"])
        first, second = parameters["cond_nconsts"], parameters["body_nconsts"]
        asked, still = inputs[:first], inputs[first : first + second]
        state = inputs[first + second :]
        while True:
            (more,) = self._run(whether, outer, [*asked, *state])
            if more.dtype == object and more[()].op != "constant":
                raise InputError(
                    f"{self.what} holds a loop whose length depends on what it "
                    "computes, for which source text is not made; `hystjax.save` keeps "
                    "it."
                )
            if not (more[()].data if more.dtype == object else more):
                return state
            state = self._run(body, constants, [*still, *state])

    def _cond(self, parameters, inputs):
        which, *rest = inputs
        branches = [_open(branch) for branch in parameters["branches"]]
        if which.dtype != object:
            return self._run(*branches[int(which)], rest)
        every = [self._run(*branch, rest) for branch in branches]
        found = []
        for v, cases in zip(
            branches[0][0].outvars, zip(*every, strict=True), strict=True
        ):
            lifted = [self.lifted(case, v.aval.dtype) for case in cases]
            found.append(self._select_n([which, *lifted], {}, v.aval))
        return found


def _longer(all_: Any, one: Any) -> int:
    """How many variables have an axis more outside of a loop than inside."""
    return sum(x.aval.ndim > y.aval.ndim for x, y in zip(all_, one, strict=True))


def _shape(leaf: np.ndarray) -> jax.ShapeDtypeStruct:
    kinds = {REAL: float, WHOLE: np.int32, TRUTH: bool}
    kind = leaf.ravel()[0].kind if leaf.size else REAL
    return jax.ShapeDtypeStruct(leaf.shape, jax.dtypes.canonicalize_dtype(kinds[kind]))


def _open(inner: Any) -> tuple[Any, Any]:
    """A jaxpr, and its constants."""
    return (inner.jaxpr, inner.consts) if hasattr(inner, "consts") else (inner, ())


class Layout(NamedTuple):
    """Where the numbers of a state are: the PyTree of its arrays, and how many floats
    and integers there are in it."""

    structure: Any
    shapes: tuple[Any, ...]
    reals: int
    wholes: int


class Program(NamedTuple):
    """What a device does, as results of expressions in its inputs.

    Inputs are `u` and `du`, before a step `u0`, the length `h` of a step, `t` and `w`;
    and the entries of `x`, floats that flow, and `m` and `k`, floats and integers of
    the memory, as pairs of a name and a number from 0.

    **Attributes:**

    - `flows`, `floats`, `integers`: how many there are of `x`, `m` and `k`.
    - `memory_start`: m and k at a first input; `flow_start`: x there, where the
        output was w.
    - `memory_after`: m and k after the input has gone straight from u0 to u.
    - `rate`: the derivatives of x; `output`: the output.
    - `timed`: whether time itself has a say.
    - `text`, `names`, `units`: the law, and what goes in and out.
    - `fitted_range`: how far the inputs went that it was fitted on, where it knows.
    """

    flows: int
    floats: int
    integers: int
    memory_start: list[Node]
    flow_start: list[Node]
    memory_after: list[Node]
    rate: list[Node]
    output: list[Node]
    timed: bool
    text: str
    names: tuple[str, str]
    units: tuple[str, str]
    fitted_range: FittedRange | None


def program(model: AbstractModel | AbstractSequenceModel) -> Program:
    """The program of a model, out of its own methods.

    **Raises:** `InputError` for batches, networks of sequences, devices whose output
    comes late, those that flow behind an operator or remember their own state, and for
    what these languages have no words for.
    """
    model = _checked(model)
    what = f"this {type(model).__name__}"
    graph = Graph()
    trace = Tracer(graph, what)
    memory = model.memory

    def value(name: str) -> Any:
        return _scalar(graph.input(name))

    def rates(x, m, now):  # floats too, in the order of what flows
        return jax.tree.map(floats, model.rate(x, m, now))

    t, u, du, w, u0, h = map(value, ("t", "u", "du", "w", "u0", "h"))
    none: Any = _scalar(graph.constant(0, REAL))
    now = Signals(t, u, du)
    started = trace(memory.start, Signals(t, u, none))
    memory_layout = _layout(started)
    m = _inputs(graph, memory_layout, "m", "k")
    first = trace(partial(first_state, model), m, Signals(t, u, none), w)
    flow_layout = _layout(first)
    _check_flow(model, bool(flow_layout.reals), what)
    x = _inputs(graph, flow_layout, "x", "")
    later: Any = _scalar(graph("add", t[()], h[()], kind=REAL))
    after = trace(memory.after, m, Signals(t, u0, du), Signals(later, u, du))
    rate, output = trace(rates, x, m, now), trace(model.output, x, m, now)
    if comes_late(model):
        raise InputError(
            f"{what} has an output that comes late, which a step from one sample to "
            "the next cannot know; export its `device`, and delay what comes out."
        )
    parts = [_flat(graph, each) for each in (started, first, after, rate, output)]
    return Program(
        flow_layout.reals,
        memory_layout.reals,
        memory_layout.wholes,
        *parts,
        timed=any("t" in inputs_of(part) for part in parts),
        text=to_text(model),
        names=model.names,
        units=model.units,
        fitted_range=model.fitted_range,
    )


def inputs_of(results: list[Node]) -> set[str]:
    """Names of the inputs that results are made of; arrays by their name."""
    return {
        node.data if isinstance(node.data, str) else node.data[0]
        for node in ordered(results)
        if node.op == "input"
    }


def ordered(results: list[Node]) -> list[Node]:
    """All that results are made of, and they, each after what it is of."""
    order: dict[int, Node] = {}
    stack = [(node, False) for node in reversed(results)]
    while stack:
        node, ready = stack.pop()
        if ready:
            order.setdefault(id(node), node)
        elif id(node) not in order:
            stack.append((node, True))
            stack.extend((arg, False) for arg in reversed(node.args))
    return list(order.values())


def identifier(name: str, taken: tuple[str, ...] = ()) -> str:
    """A name that every language takes, and that is not one of those `taken`."""
    allowed = r"[A-Za-z][A-Za-z0-9_]{0,30}"
    if not isinstance(name, str) or not re.fullmatch(allowed, name):
        raise InputError(
            f"`name` becomes part of names in source text: a letter, then up to 30 "
            f"letters, digits and underscores; got {name!r}."
        )
    if name in taken:
        raise InputError(f"`name` is {name!r}, which means something else there.")
    return name


def _checked(model: Any) -> AbstractModel:
    if not isinstance(model, AbstractModel):
        raise InputError(
            f"{checks.described(model)} has no equations of which source text could be "
            "made: it is no model of memory, flow and output, such as a network that "
            "maps sequences. `hystjax.save` keeps models of hystjax."
        )
    check_one(model)
    model = model.settled()
    check_numbers(model)
    return model.restricted(model.rows_in_use)


def _check_flow(model: AbstractModel, flows: bool, what: str) -> None:
    """Raise `InputError` for what flows in ways that are not written out."""
    x, m, now = _first(model)
    if flows and len(model.legs((m, m, m), Grid(now.t, now, now, now))) > 1:
        raise InputError(
            f"{what} flows behind a play, a stop or a lag, where steps are cut inside, "
            "of which source text is not made. Export its `device`, and drive that by "
            "the signal."
        )
    caught_up = jax.make_jaxpr(lambda x: model.caught_up(x, m, now))(x).jaxpr
    if caught_up.outvars != caught_up.invars:
        raise InputError(
            f"{what} has a spring with a memory of what moves it, which is advanced "
            "inside of steps, and of which source text is not made; `hystjax.save` "
            "keeps it."
        )


def _first(model: AbstractModel) -> tuple[Any, Any, Signals]:
    """A first state, of what flows and of the memory, and the input there."""
    zero = jnp.zeros(())
    now = Signals(zero, zero, zero)
    m = model.memory.start(now)
    return first_state(model, m, now, zero), m, now


def _scalar(node: Node) -> np.ndarray:
    array = np.empty((), object)
    array[()] = node
    return array


def _layout(state: Any) -> Layout:
    leaves, structure = jax.tree.flatten(state)
    kinds = [leaf.ravel()[0].kind for leaf in leaves for _ in range(leaf.size)]
    shapes = tuple((leaf.shape, leaf.ravel()[0].kind) for leaf in leaves)
    reals = kinds.count(REAL)
    return Layout(structure, shapes, reals, len(kinds) - reals)


def _inputs(graph: Graph, layout: Layout, reals: str, wholes: str) -> Any:
    """A state, its entries numbered in order; switches are integers that are not 0."""
    used = {reals: 0, wholes: 0}
    zero = graph.constant(0, WHOLE)

    def entry(kind: str) -> Node:
        name = reals if kind == REAL else wholes
        number = used[name]
        used[name] += 1
        node = graph.input((name, number), REAL if kind == REAL else WHOLE)
        return graph("ne", node, zero, kind=TRUTH) if kind == TRUTH else node

    leaves = []
    for shape, kind in layout.shapes:
        array = np.empty(int(np.prod([1, *shape])), object)
        array[:] = [entry(kind) for _ in array]
        leaves.append(array.reshape(shape))
    return jax.tree.unflatten(layout.structure, leaves)


def _flat(graph: Graph, state: Any) -> list[Node]:
    """The entries of a state: floats in order, and then integers."""
    nodes = [node for leaf in jax.tree.leaves(state) for node in leaf.ravel()]
    one, zero = (graph.constant(i, WHOLE) for i in (1, 0))
    switches = [
        graph("select", node, one, zero, kind=WHOLE) if node.kind == TRUTH else node
        for node in nodes
        if node.kind != REAL
    ]
    return [node for node in nodes if node.kind == REAL] + switches


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


def in_32_bits(whole: int) -> str:
    """A whole number, as the languages hold it that have a type for these.

    **Raises:** `InputError` for one that would be another there, in silence.
    """
    if not -(2**31) <= whole < 2**31:
        raise InputError(
            f"the law computes with the whole number {whole}, and 32 bits do not hold "
            "it there; compute with floats, such as `jnp.asarray(n, float)`."
        )
    return str(whole)


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
            return f"-{_within(args[0], _PRIMARY)}", 8
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
        if second.startswith("-"):
            # No sign may follow an operator: two signs are another operator in C, and
            # in Modelica it is no sentence.
            if op == "add":
                symbol, second = "-", second[1:]
            else:
                second = f"({second})"
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
    """Times, inputs, and the outputs that hystjax has for them, shape (n,); the output
    that was seen at the first, from which it starts; and by how much others, computed
    in double precision, may differ from these."""

    t: np.ndarray
    u: np.ndarray
    w: np.ndarray
    seen: float

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
        _check_record(record)
        for symbol, values in (("u", record.u), ("w", record.w)):
            low, high = float(np.min(values)), float(np.max(values))
            lines.append(f"Of the record: {symbol} from {low:g} to {high:g}.")
    return lines


def ends(names: tuple[str, str], units: tuple[str, str]) -> list[str]:
    """Descriptions of the input and the output."""
    pairs = zip(names, units, strict=True)
    return [line(described(*pair)) for pair in pairs]


def _check_record(record: Any) -> None:
    checks.kind("record", record, Recording, "hystjax.Recording(t, u, w)")


def first_samples(model: Any, record: Recording | None, timed: bool) -> Samples | None:
    """The first samples of a record, its input straight in between, and the output
    there by `FixedStep(1)`, without a past; `None` of none. They begin at 0 s unless
    time itself has a say."""
    if record is None:
        return None
    _check_record(record)
    if len(record) < 2:
        raise InputError("a self-test needs a record of at least two samples.")
    n = min(len(record), _TESTED)
    # Of seconds since 1970 the middles of steps are rounded, and lags with them.
    t = record.t[:n] if timed else record.t[:n] - record.t[0]
    straight = Recording(t if record.clocked else None, record.u[:n], record.w[:n])
    warn_of_units(model, record)
    # How far the record goes is no matter of a test, and these are not its times.
    bare = model.fitted_on(None)
    run = simulate(bare, straight, method=FixedStep(1), throw=False)
    if not ended(run.result, RESULTS.successful) or _blows_up(bare, straight, run.w):
        raise InputError(
            "the `record` has no output to test by: the law is lost on it where each "
            "interval between its samples is one step of Runge and Kutta, as in what "
            "is exported. Give a record that is sampled more finely, or none, unless "
            "`hystjax.simulate` loses it too: the law is then unstable there."
        )
    t, u, w = (np.asarray(jax.device_get(x)) for x in (run.t, run.u, run.w))
    return Samples(t, u, w, float(straight.w[0]))


_FAR = 10.0  # times the recorded output, from which another is looked at


def _blows_up(model: AbstractModel, record: Recording, w: Array) -> bool:
    """Whether an output gets far from where the model does by as many steps as it
    needs: steps that are too long may end in numbers that are still finite."""
    if not jnp.max(jnp.abs(w)) > _FAR * jnp.max(jnp.abs(record.w)):
        return False
    run = simulate(model, record, throw=False)
    apart = jnp.max(jnp.abs(w - run.w))
    return bool(ended(run.result, RESULTS.successful) and apart > jnp.ptp(run.w))
