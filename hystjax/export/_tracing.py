"""From functions written in JAX to scalar expressions.

JAX traces a function into a list of operations on arrays. These are run once more, with
an expression in each place of an array: what only moves numbers about needs no
operation of its own then, constants come out as numbers, and loops of known length are
unrolled. So a model's equations are what it computes, told once, in its own methods.
"""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.extend.core import Literal

from .._core.checks import InputError
from ._nodes import REAL, TRUTH, WHOLE
from ._rules import ALIKE, REDUCED, SAME, Rules

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
