"""Laws in Modelica: a package of functions, and a block that steps by them."""

import math

from .._core.checks import InputError
from .._core.solution import Solution
from ..models import AbstractModel, AbstractSequenceModel, as_model
from ..recording import Recording
from ._program import (
    Language,
    Printer,
    Program,
    Samples,
    Statement,
    about,
    first_samples,
    identifier,
    in_32_bits,
    program,
    wrapped,
)
from ._rules import REAL, TRUTH, WHOLE, Node


def to_modelica(
    model: AbstractModel | AbstractSequenceModel | Solution,
    *,
    name: str = "law",
    record: Recording | None = None,
) -> str:
    """Source text of a package of Modelica 3.4, of any model that computes what JAX can
    trace; it needs no other package.

    Its block `Device` has an input `u`, straight from one of its `period`s to the next,
    an output `w`, and a parameter `w0`, the output at the start, of laws of its rate.
    What it steps by are functions, `start`, `step` and `response`. Memory is exact, and
    what flows goes by the steps of `simulation.FixedStep(1)`.

    **Arguments:**

    - `model`: one device.
    - `name`: of the package.
    - `record`: if there is one, its range is told, and the function `tested` compares
        the law along its first samples with what hystjax makes of them.

    **Raises:** `InputError` as `to_c`, and for tables that hold numbers that are none.
    """
    identifier(name, _TAKEN)
    model = as_model(model, "to_modelica(model)")
    law = program(model)
    samples = first_samples(model, record, law.timed)
    write = Printer(_LANGUAGE, "the")
    functions = [_state(law), _start(write, law)]
    functions += [_after(write, law)] if law.memory_after else []
    functions += [_rate(write, law)] if law.flows else []
    functions += [_step(law), _response(write, law)]
    tables = [_table(*each) for each in write.numbered()]
    helpers = [text for each, text in _HELPERS.items() if each in write.used]
    functions += [*tables, *helpers, _DEVICE]
    functions += [] if samples is None else [_self_test(samples)]
    comment = "\n".join(f"// {each}".rstrip() for each in about(law, name, record))
    body = "\n\n".join(functions)
    return f"{comment}\npackage {name}\n{body}\nend {name};\n"


_TAKEN = ("algorithm", "and", "annotation", "block", "break", "class", "connect")
_TAKEN += ("connector", "constant", "constrainedby", "der", "discrete", "each", "else")
_TAKEN += ("elseif", "elsewhen", "encapsulated", "end", "enumeration", "equation")
_TAKEN += ("expandable", "extends", "external", "false", "final", "flow", "for")
_TAKEN += ("function", "if", "import", "impure", "in", "initial", "inner", "input")
_TAKEN += ("loop", "model", "not", "operator", "or", "outer", "output", "package")
_TAKEN += ("parameter", "partial", "protected", "public", "pure", "record", "redeclare")
_TAKEN += ("replaceable", "return", "stream", "then", "true", "type", "when", "while")
_TAKEN += ("within",)
# Types and functions of the language: one of that name would be meant in their place.
_TAKEN += ("Real", "Integer", "Boolean", "String", "time", "sample", "assert")
_TAKEN += ("abs", "sign", "max", "min", "div", "mod", "rem", "floor", "ceil", "integer")
_TAKEN += ("sqrt", "exp", "log", "sin", "cos", "tan", "asin", "acos", "atan", "atan2")
_TAKEN += ("sinh", "cosh", "tanh")
_KINDS = {REAL: "Real", WHOLE: "Integer", TRUTH: "Boolean"}
_ARRAYS = {"x": "Real", "m": "Real", "k": "Integer"}


def _number(node: Node) -> str:
    if node.kind == TRUTH:
        return str(node.data).lower()
    if node.kind == WHOLE:
        return in_32_bits(node.data)
    if not math.isfinite(node.data):
        raise InputError(
            f"the law computes with {node.data}, which Modelica cannot write; use "
            "`to_c`, or an FMU."
        )
    return repr(node.data)


def _call(op: str, kind: str, args: tuple[str, ...]) -> str:
    joined = ", ".join(args)
    if op == "pow":
        return f"(({args[0]}) ^ ({args[1]}))"
    if op == "not":
        return f"(not ({joined}))"
    if op == "convert":
        return f"(1.0 * ({joined}))" if kind == REAL else f"whole({joined})"
    return f"{op}({joined})"


_LANGUAGE = Language(
    _number,
    _call,
    entry="{name}[{i}]",
    select="if {condition} then {a} else {b}",
    lookup="{table}({i})",
    symbols={"ne": "<>"},
    first=1,
)


def _declared(statements: list[Statement]) -> list[str]:
    return [f"{_KINDS[kind]} {name};" for name, kind, _ in statements]


def _assigned(statements: list[Statement]) -> list[str]:
    return [f"{name} := {text};" for name, _, text in statements]


def _entries(name: str, texts: list[str]) -> list[str]:
    return [f"{name}[{i + 1}] := {text};" for i, text in enumerate(texts)]


def _sizes(law: Program) -> dict[str, int]:
    """Arrays of a state that have entries."""
    sizes = {"x": law.flows, "m": law.floats, "k": law.integers}
    return {name: size for name, size in sizes.items() if size}


def _arrays(law: Program, names: str, suffix: str = "") -> list[str]:
    sizes = _sizes(law)
    return [f"{_ARRAYS[n]} {n}{suffix}[{sizes[n]}];" for n in names if n in sizes]


def _function(name: str, about: str, inputs, outputs, inner, lines) -> str:
    rows = [f'  function {name} "{about}"']
    rows += [f"    input {each}" for each in inputs]
    rows += [f"    output {each}" for each in outputs]
    rows += ["  protected", *(f"    {each}" for each in inner)] if inner else []
    rows += ["  algorithm", *(f"    {line}" for line in lines)]
    return "\n".join([*rows, f"  end {name};"])


def _state(law: Program) -> str:
    fields = ['Real t "time, s";', "Real u;", *_arrays(law, "xmk")]
    rows = [f"    {field}" for field in fields]
    return "\n".join(['  record State "Of a device"', *rows, "  end State;"])


def _start(write: Printer, law: Program) -> str:
    statements, texts = write(law.memory_start)
    more, flow = write(law.flow_start, "b")
    inner = [*_arrays(law, "mk"), *_declared([*statements, *more])]
    lines = _assigned(statements)
    lines += _entries("m", texts[: law.floats]) + _entries("k", texts[law.floats :])
    lines += [*_assigned(more), "s.t := t;", "s.u := u;"]
    lines += [f"s.{n} := {n};" for n in "mk" if n in _sizes(law)]
    lines += _entries("s.x", flow)
    inputs = ["Real u;", "Real w;", "Real t = 0.0;"]
    about = "The state at a first input u, where the output was w, at time t"
    return _function("start", about, inputs, ["State s;"], inner, lines)


def _after(write: Printer, law: Program) -> str:
    statements, texts = write(law.memory_after)
    inputs = _arrays(law, "mk") + [f"Real {n};" for n in ("t", "u0", "u", "du", "h")]
    lines = [*_assigned(statements), *_entries("m_after", texts[: law.floats])]
    lines += _entries("k_after", texts[law.floats :])
    outputs = _arrays(law, "mk", "_after")
    about = "What is remembered after a straight line of the input"
    return _function("after", about, inputs, outputs, _declared(statements), lines)


def _rate(write: Printer, law: Program) -> str:
    statements, texts = write(law.rate)
    inputs = _arrays(law, "xmk") + [f"Real {n};" for n in ("t", "u", "du")]
    outputs = [f"Real slopes[{law.flows}];"]
    lines = [*_assigned(statements), *_entries("slopes", texts)]
    about = "The derivatives of what flows, per s"
    return _function("rate", about, inputs, outputs, _declared(statements), lines)


def _step(law: Program) -> str:
    kept = [n for n in "mk" if n in _sizes(law)]

    def after(target: str, source: str, times: str) -> list[str]:
        """One call of `after`, if there is something to remember."""
        targets = [f"{n}{target}" for n in kept]
        given = [f"{source}{n}" if source == "s." else f"{n}{source}" for n in kept]
        left = f"({', '.join(targets)})" if len(kept) > 1 else "".join(targets)
        return [f"{left} := after({', '.join([*given, times])});"] if kept else []

    def memory(stage: str) -> str:
        return "".join(f"s.{n}, " if not stage else f"{n}{stage}, " for n in kept)

    inner = ["Real du;"]
    lines = ["du := (u - s.u) / h;"]
    last = "1"
    if law.flows:
        last = "2"
        slopes = [f"Real s{i}[{law.flows}];" for i in (1, 2, 3, 4)]
        inner += ["Real half;", "Real middle;", *_arrays(law, "mk", "1"), *slopes]
        lines += ["half := 0.5 * h;", "middle := s.u + half * du;"]
        lines += after("1", "s.", "s.t, s.u, middle, du, half")
        lines += after("2", "1", "s.t + half, middle, u, du, half")
        stages = [("", "s.t, s.u"), ("1", "s.t + half, middle")]
        stages += [("1", "s.t + half, middle"), ("2", "s.t + h, u")]
        moved = ["s.x", "s.x + half * s1", "s.x + half * s2", "s.x + h * s3"]
        for i, ((stage, where), x) in enumerate(zip(stages, moved, strict=True), 1):
            lines.append(f"s{i} := rate({x}, {memory(stage)}{where}, du);")
        lines.append("next.x := s.x + (h / 6) * (s1 + 2 * (s2 + s3) + s4);")
    else:
        lines += after("1", "s.", "s.t, s.u, u, du, h")
    inner += _arrays(law, "mk", last)
    lines += [f"next.{n} := {n}{last};" for n in kept]
    lines += ["next.t := s.t + h;", "next.u := u;"]
    inputs = ["State s;", "Real u;", "Real h;"]
    about = "The state after the input has gone straight to u in h seconds"
    return _function("step", about, inputs, ["State next;"], inner, lines)


def _response(write: Printer, law: Program) -> str:
    statements, (text,) = write(law.output)
    arrays = list(_sizes(law))
    inner = ["Real t;", "Real u;", *_arrays(law, "xmk"), *_declared(statements)]
    lines = [f"{n} := s.{n};" for n in ("t", "u", *arrays)]
    lines += [*_assigned(statements), f"w := {text};"]
    about = "The output, where the input goes on with the derivative du, per s"
    inputs = ["State s;", "Real du;"]
    return _function("response", about, inputs, ["Real w;"], inner, lines)


def _table(name: str, kind: str, numbers: list[str]) -> str:
    last = len(numbers) - 1
    inner = [f"constant {_KINDS[kind]} values[{last + 1}] = {_row(numbers)};"]
    lines = [f"v := values[min(max(i, 0), {last}) + 1];"]
    outputs = [f"{_KINDS[kind]} v;"]
    return _function(name, "Entry i, from 0", ["Integer i;"], outputs, inner, lines)


def _row(numbers: list[str]) -> str:
    return "{" + "\n      ".join(wrapped(", ".join(numbers), 76)) + "}"


def _self_test(samples: Samples) -> str:
    n = len(samples.t)
    columns = (_row(list(map(repr, column))) for column in samples.columns())
    inner = [
        f"constant Real {name}[{n}] = {row};"
        for name, row in zip("tuw", columns, strict=True)
    ]
    inner += ["State s;", "Real h;"]
    lines = f"""off := 0.0;
s := start(u[1], {samples.seen!r}, t[1]);
for i in 1:{n - 1} loop
  h := t[i + 1] - t[i];
  off := max(off, abs(response(s, (u[i + 1] - u[i]) / h) - w[i]));
  s := step(s, u[i + 1], h);
end for;
assert(off <= {samples.allowed!r}, "not what hystjax has");"""
    about = "How far this is off what hystjax has for a record"
    return _function("tested", about, [], ["Real off;"], inner, lines.splitlines())


# What there are no words for; logarithms and powers near 1 are Kahan's, right to
# rounding.
_HELPERS = {
    ("convert", WHOLE): """  function whole
    input Real a;
    output Integer v;
  algorithm
    v := if a < 0 then -integer(-a) else integer(a);
  end whole;""",
    ("log1p", REAL): """  function log1p
    input Real a;
    output Real v;
  algorithm
    v := if 1 + a == 1 then a else log(1 + a) * (a / ((1 + a) - 1));
  end log1p;""",
    ("expm1", REAL): """  function expm1
    input Real a;
    output Real v;
  protected
    Real e;
  algorithm
    e := exp(a);
    v := if e == 1 then a else if e - 1 == -1 then -1 else (e - 1) * a / log(e);
  end expm1;""",
    ("cbrt", REAL): """  function cbrt
    input Real a;
    output Real v;
  algorithm
    v := sign(a) * abs(a) ^ (1 / 3);
  end cbrt;""",
}
_DEVICE = """  block Device "Steps along an input that is straight between times"
    parameter Real period(unit = "s") = 0.001 "from one step to the next";
    parameter Real w0 = 0.0 "the output at the start";
    input Real u;
    output Real w "by the input's derivative before";
  protected
    State s;
    Real before, reached, h;
  algorithm
    when initial() then
      s := start(u, w0, time);
      w := response(s, 0.0);
      reached := time;
    elsewhen sample(period, period) then
      before := s.u;
      h := time - reached; // shorter or longer where time does not start at 0
      s := step(s, u, h);
      w := response(s, (u - before) / h);
      reached := time;
    end when;
  end Device;"""
