"""A model as a program: what every language writes, in scalar expressions.

JAX traces a function into a list of operations on arrays. These are run once more, with
an expression in each place of an array: what only moves numbers about needs no
operation of its own then, constants come out as numbers, and loops of known length are
unrolled. So a model's equations are what it computes, told once, in its own methods.
"""

import re
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.extend.core import Literal

from .._core.checks import InputError
from ..models import AbstractModel, AbstractSequenceModel, FittedRange, comes_late
from ..models._numbers import numbers
from ..signals import Grid, Signals
from ..simulation import first_state
from ._rules import ALIKE, REAL, REDUCED, SAME, TRUTH, WHOLE, Graph, Node, Rules
from ._sums import check_known, to_text

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
            return self._scan(parameters, inputs)
        if name == "while":
            return self._while(parameters, inputs)
        if name == "cond":
            return self._cond(parameters, inputs)
        if inner is not None:
            return self._run(*_open(inner), inputs)
        if not any(x.dtype == object for x in inputs):  # known now
            known = [jnp.asarray(x) for x in inputs]
            result = equation.primitive.bind(*known, **parameters)
            several = result if equation.primitive.multiple_results else [result]
            return [np.asarray(each) for each in several]
        rule: Callable | None = getattr(self, f"_{name}", None)
        aval = equation.outvars[0].aval
        if name in ALIKE:
            return [inputs[0]]
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

    def _scan(self, parameters, inputs):
        body, constants = _open(parameters["jaxpr"])
        fixed, carried = parameters["num_consts"], parameters["num_carry"]
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
        return jax.tree.map(numbers, model.rate(x, m, now))

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
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]{0,30}", name):
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
            f"a {type(model).__name__} has no equations of which source text could be "
            "made: it is no model of memory, flow and output, such as a network that "
            "maps sequences. `hystjax.save` keeps models of hystjax."
        )
    check_known(model)
    model = model.settled()
    try:
        x, m, now = _first(model)
        shape = jnp.shape(model.output(x, m, now))
        model.rate(x, m, now)
    except (IndexError, TypeError, ValueError) as error:
        raise InputError(_BATCH) from error
    if shape != ():
        raise InputError(_BATCH)
    return model.restricted(model.rows_in_use)


_BATCH = (
    "one device can be exported at a time, and this is a batch, or gives an output "
    "that is no number; pick one with `jax.tree.map(lambda x: x[i], model)`."
)


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
