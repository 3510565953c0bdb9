"""How expressions are written in C99."""

import math
from typing import NamedTuple

from ._nodes import REAL, TRUTH, WHOLE, Node
from ._printing import Language

KINDS = {REAL: "{p}_real", WHOLE: "int", TRUTH: "bool"}

# Operations that C99 has no operator for, and for floats no function either; what is
# not here is a function of <math.h>.
HELPERS = {
    ("sign", REAL): "return ({p}_real)((a > 0) - (a < 0));",
    ("sign", WHOLE): "return (a > 0) - (a < 0);",
    ("max", REAL): "return (a > b) ? a : b;",
    ("min", REAL): "return (a < b) ? a : b;",
    ("max", WHOLE): "return (a > b) ? a : b;",
    ("min", WHOLE): "return (a < b) ? a : b;",
    ("abs", WHOLE): "return (a < 0) ? -a : a;",
}
_MATH = {"abs": "fabs"}


class Words(NamedTuple):
    """How C is written with one prefix."""

    prefix: str

    def number(self, node: Node) -> str:
        if node.kind != REAL:
            return {True: "true", False: "false"}.get(node.data, str(node.data))
        if not math.isfinite(node.data):
            text = "NAN" if math.isnan(node.data) else "INFINITY"
        else:
            text = repr(abs(node.data))
        sign = "-" if math.copysign(1, node.data) < 0 else ""
        return f"{sign}{self.prefix.upper()}_R({text})"

    def call(self, op: str, kind: str, args: tuple[str, ...]) -> str:
        joined = ", ".join(args)
        if op == "not":
            return f"(!({joined}))"
        if op == "div":
            return f"(({args[0]}) / ({args[1]}))"
        if op == "convert":
            return f"(({KINDS[kind].format(p=self.prefix)})({joined}))"
        if (op, kind) in HELPERS:
            return f"{self.prefix}_{op}{'' if kind == REAL else 'i'}({joined})"
        return f"{self.prefix.upper()}_M({_MATH.get(op, op)})({joined})"

    def language(self) -> Language:
        return Language(
            self.number,
            self.call,
            entry="{name}[{i}]",
            select="{condition} ? {a} : {b}",
            lookup=f"{{table}}[{self.prefix}_at({{i}}, {{last}})]",
            symbols={"and": "&&", "or": "||"},
        )
