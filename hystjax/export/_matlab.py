"""Laws in MATLAB (and Octave): one file of one function."""

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
    program,
    wrapped,
)
from ._rules import REAL, TRUTH, Node


def to_matlab(
    model: AbstractModel | AbstractSequenceModel | Solution,
    *,
    name: str = "law",
    record: Recording | None = None,
) -> str:
    """Source text of a function of MATLAB and Octave, of any model that computes what
    JAX can trace: `w = law(t, u, w0)` are the outputs along samples, and
    `[w, s] = law(t, u, w0, s)` goes on from the state of a call before.

    Memory is exact, and what flows goes by the steps of `simulation.FixedStep(1)`.

    **Arguments:**

    - `model`: one device.
    - `name`: of the function; the file should have it too.
    - `record`: if there is one, its range is told, and `law()` compares the law along
        its first samples with what hystjax makes of them.

    **Raises:** `InputError` as `to_c`.
    """
    identifier(name, _TAKEN)
    model = as_model(model, "to_matlab(model)")
    law = program(model)
    samples = first_samples(model, record, law.timed)
    write = Printer(_LANGUAGE, name)
    functions = [_start(write, law)]
    if law.memory_after:
        functions.append(_after(write, law))
    functions += [_rate(write, law), _STEP] if law.flows else [_JUMP]
    if not law.memory_after:
        functions.append(_FORGETFUL)
    functions.append(_output(write, law))
    functions += [_table(name, row) for name, _, row in write.numbered()]
    functions += [_PICK, _PROPER]
    comment = [*about(law, name, record), "", *_USE.format(name=name).splitlines()]
    tested = [] if samples is None else _USE_OF_TEST.format(name=name).splitlines()
    lines = [f"%   {line}".rstrip() for line in comment + tested]
    head = _MAIN.format(
        name=name,
        upper=name.upper(),
        comment="\n".join(lines),
        test="" if samples is None else _TEST,
    )
    functions += [] if samples is None else [_self_test(name, samples)]
    return "\n".join([head, *functions])


_TAKEN = ("start", "after", "rate", "advance", "response", "pick", "proper", "tested")
_TAKEN += ("break", "case", "catch", "classdef", "continue", "else", "elseif", "end")
_TAKEN += ("for", "function", "global", "if", "otherwise", "parfor", "persistent")
_TAKEN += ("return", "spmd", "switch", "try", "while")
# Of Octave alone.
_TAKEN += ("do", "until", "endif", "endfor", "endparfor", "endwhile", "endswitch")
_TAKEN += ("endfunction", "end_try_catch", "unwind_protect", "unwind_protect_cleanup")
_TAKEN += ("end_unwind_protect",)
# Functions that are called: one of that name would be called in their place.
_TAKEN += ("abs", "sign", "zeros", "numel", "size", "struct", "isreal", "nargin")
_TAKEN += ("floor", "ceil", "fix", "double", "max", "min", "mod", "sqrt", "nthroot")
_TAKEN += ("sin", "cos", "tan", "asin", "acos", "atan", "atan2", "sinh", "cosh", "tanh")
_TAKEN += ("exp", "expm1", "log", "log1p", "assert", "all", "true", "false")
_TAKEN += ("NaN", "Inf")
# Variables where the function itself is called, or that it returns.
_TAKEN += ("t", "u", "w", "s", "off", "missed")
_PROPERLY = ("sqrt", "log", "log1p", "asin", "acos")  # complex numbers of some reals


def _number(node: Node) -> str:
    if node.kind == TRUTH:
        return str(node.data).lower()
    return repr(node.data).replace("nan", "NaN").replace("inf", "Inf")


def _call(op: str, kind: str, args: tuple[str, ...]) -> str:
    joined = ", ".join(args)
    if op == "pow":
        return f"proper(({args[0]}) ^ ({args[1]}))"
    if op in _PROPERLY:
        return f"proper({op}({joined}))"
    if op == "not":
        return f"(~({joined}))"
    if op == "div":  # of integers
        return f"fix(({args[0]}) / ({args[1]}))"
    if op == "convert":
        return f"{'double' if kind == REAL else 'fix'}({joined})"
    return f"nthroot({joined}, 3)" if op == "cbrt" else f"{op}({joined})"


_LANGUAGE = Language(
    _number,
    _call,
    entry="{name}({i})",
    select="pick({condition}, {a}, {b})",
    lookup="{table}({i})",
    symbols={"and": "&&", "or": "||", "ne": "~="},
    first=1,
)


def _assigned(statements: list[Statement]) -> list[str]:
    return [f"    {name} = {text};" for name, _, text in statements]


def _vector(name: str, texts: list[str]) -> list[str]:
    """A column, entry by entry: between brackets spaces would part what is one."""
    rows = [f"    {name}({i + 1}) = {text};" for i, text in enumerate(texts)]
    return [f"    {name} = zeros({len(texts)}, 1);", *rows]


def _function(signature: str, comment: str, lines: list[str]) -> str:
    return "\n".join([f"function {signature}", f"% {comment}", *lines, "end", ""])


def _start(write: Printer, law: Program) -> str:
    statements, texts = write(law.memory_start)
    more, flow = write(law.flow_start)
    lines = _assigned(statements)
    lines += [*_vector("m", texts[: law.floats]), *_vector("k", texts[law.floats :])]
    lines += [*_assigned(more), *_vector("x", flow)]
    lines += ["    s = struct('t', t, 'u', u, 'x', x, 'm', m, 'k', k);"]
    comment = "The state at a first input u, where the output was w, at time t."
    return _function("s = start(u, w, t)", comment, lines)


def _after(write: Printer, law: Program) -> str:
    statements, texts = write(law.memory_after)
    lines = [*_assigned(statements), *_vector("m_after", texts[: law.floats])]
    lines += _vector("k_after", texts[law.floats :])
    signature = "[m_after, k_after] = after(m, k, t, u0, u, du, h)"
    return _function(signature, "What is remembered after a straight line.", lines)


def _rate(write: Printer, law: Program) -> str:
    statements, texts = write(law.rate)
    lines = [*_assigned(statements), *_vector("slopes", texts)]
    comment = "The derivatives of what flows, per s."
    return _function("slopes = rate(x, m, k, t, u, du)", comment, lines)


def _output(write: Printer, law: Program) -> str:
    statements, (text,) = write(law.output)
    lines = ["    t = s.t; u = s.u; x = s.x; m = s.m; k = s.k;"]
    lines += [*_assigned(statements), f"    w = {text};"]
    comment = "The output, where the input goes on with the derivative du, per s."
    return _function("w = response(s, du)", comment, lines)


def _table(name: str, numbers: list[str]) -> str:
    lines = [f"    values = {_row(numbers)};"]
    lines += [f"    v = values(min(max(i, 0), {len(numbers) - 1}) + 1);"]
    return _function(f"v = {name}(i)", "Entry i, from 0.", lines)


def _row(numbers: list[str]) -> str:
    rows = wrapped(", ".join(numbers), 76)
    return "[" + " ...\n        ".join(["", *rows]) + "]"


def _self_test(name: str, samples: Samples) -> str:
    t, u, w = (_row(list(map(repr, column))) for column in samples.columns())
    lines = [f"    t = {t};", f"    u = {u};", f"    w = {w};"]
    lines += [f"    missed = abs({name}(t, u, {samples.seen!r}) - w);"]
    lines += [f"    assert(all(missed <= {samples.allowed!r}));"]  # NaN is not
    lines += ["    off = max(missed);"]
    return _function(
        "off = tested()", "How far this is off what hystjax has for a record.", lines
    )


_USE = """w = {name}(t, u, w0) are the outputs at two or more times t, s, under inputs
u, straight between samples; w0 is the first output, of laws of its rate.
[w, s] = {name}(t, u, w0, s) goes on from the state s of a call before, whose last
sample is the first of this one."""
_USE_OF_TEST = "off = {name}() tests it, and is how far it is off."
_MAIN = """function [w, s] = {name}(t, u, w0, s)
%{upper} A device with hysteresis.
%
{comment}
{test}    if nargin < 3
        w0 = 0;
    end
    if nargin < 4
        s = start(u(1), w0, t(1));
    end
    n = numel(t);
    w = zeros(size(u));
    for i = 1:n
        j = min(i, n - 1);
        h = t(j + 1) - t(j);
        w(i) = response(s, (u(j + 1) - u(j)) / h);
        if i < n
            s = advance(s, u(i + 1), h);
        end
    end
end
"""
_TEST = """    if nargin == 0
        w = tested();
        s = [];
        return
    end
"""
_STEP = """function s = advance(s, u, h)
% The state after the input has gone straight to u in h seconds.
    du = (u - s.u) / h;
    half = 0.5 * h;
    middle = s.u + half * du;
    [m1, k1] = after(s.m, s.k, s.t, s.u, middle, du, half);
    [m2, k2] = after(m1, k1, s.t + half, middle, u, du, half);
    s1 = rate(s.x, s.m, s.k, s.t, s.u, du);
    s2 = rate(s.x + half * s1, m1, k1, s.t + half, middle, du);
    s3 = rate(s.x + half * s2, m1, k1, s.t + half, middle, du);
    s4 = rate(s.x + h * s3, m2, k2, s.t + h, u, du);
    x = s.x + (h / 6) * (s1 + 2 * (s2 + s3) + s4);
    s = struct('t', s.t + h, 'u', u, 'x', x, 'm', m2, 'k', k2);
end
"""
_JUMP = """function s = advance(s, u, h)
% The state after the input has gone straight to u in h seconds.
    [m, k] = after(s.m, s.k, s.t, s.u, u, (u - s.u) / h, h);
    s = struct('t', s.t + h, 'u', u, 'x', s.x, 'm', m, 'k', k);
end
"""
_FORGETFUL = """function [m, k] = after(m, k, varargin)
% Nothing is remembered.
end
"""
_PICK = """function v = pick(condition, a, b)
    if condition
        v = a;
    else
        v = b;
    end
end
"""
_PROPER = """function v = proper(v)
% No number, where there is no real one.
    if ~isreal(v)
        v = NaN;
    end
end
"""
