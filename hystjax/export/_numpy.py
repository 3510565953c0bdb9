"""Laws in Python, which need NumPy alone."""

import keyword

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
from ._rules import REAL, Node


def to_numpy(
    model: AbstractModel | AbstractSequenceModel | Solution,
    *,
    name: str = "law",
    record: Recording | None = None,
) -> str:
    """Source text of a device in Python that needs NumPy alone, of any model that
    computes what JAX can trace.

    It is a module of functions that change nothing: `start` for the state at a first
    input, `step` for a straight line to the next, `output`, and `run` along samples.
    Memory is exact, and what flows goes by the steps of `simulation.FixedStep(1)`.
    Numbers may be arrays of one shape, of as many devices.

    **Arguments:**

    - `model`: one device.
    - `name`: of the module; the file should have it too.
    - `record`: if there is one, its range is told, and run as a script the module
        compares the law along its first samples with what hystjax makes of them.

    **Raises:** `InputError` as `to_c`.
    """
    identifier(name, _TAKEN)
    model = as_model(model, "to_numpy(model)")
    law = program(model)
    write = Printer(_LANGUAGE, "")
    functions = [
        _START.format(body=_start(write, law)),
        _after(write, law),
        _rate(write, law) if law.flows else _JUMP,
        _output(write, law),
        _RUN,
    ]
    tables = [
        "\n".join([f"{name} = np.array([", *_indented(", ".join(numbers)), "])\n"])
        for name, _, numbers in write.numbered()
    ]
    comment = "\n".join(about(law, name, record))
    head = f'"""{comment}\n\n{_HEAD}\n"""\n\nimport numpy as np\n'
    test = _self_test(name, first_samples(model, record, law.timed))
    return "\n\n".join([head, *tables, *functions, *test])


# No module is imported by a keyword, and one of that name in NumPy's place.
_TAKEN = (*keyword.kwlist, "numpy")
_HEAD = "Numbers may be arrays of one shape, of as many devices."
_NAMES = {"max": "maximum", "min": "minimum", "pow": "power", "atan2": "arctan2"}
_NAMES |= {"asin": "arcsin", "acos": "arccos", "atan": "arctan", "not": "logical_not"}


def _number(node: Node) -> str:
    text = repr(node.data)
    return f"np.{text}" if text in ("nan", "inf") else text.replace("-inf", "-np.inf")


def _call(op: str, kind: str, args: tuple[str, ...]) -> str:
    joined = ", ".join(args)
    if op == "convert" and kind == REAL:
        return f"np.positive({joined}, dtype=float)"
    if op == "convert":
        return f"np.trunc({joined}).astype(int)"
    if op == "div":  # of integers
        return f"np.trunc(({args[0]}) / ({args[1]})).astype(int)"
    return f"np.{_NAMES.get(op, op)}({joined})"


_LANGUAGE = Language(
    _number,
    _call,
    entry="{name}[{i}]",
    select="np.where({condition}, {a}, {b})",
    lookup='np.take({table}, {i}, mode="clip")',
    symbols={"and": "&", "or": "|"},
)


def _assigned(statements: list[Statement]) -> list[str]:
    return [f"    {name} = {text}" for name, _, text in statements]


def _tuple(texts: list[str]) -> list[str]:
    """A tuple, an entry a line."""
    return ["(", *(f"        {text}," for text in texts), "    )"] if texts else ["()"]


def _given(name: str, texts: list[str]) -> list[str]:
    first, *rest = _tuple(texts)
    return [f"    {name} = {first}", *rest]


def _start(write: Printer, law: Program) -> str:
    statements, texts = write(law.memory_start)
    more, flow = write(law.flow_start)
    lines = [*_assigned(statements), *_given("m", texts[: law.floats])]
    lines += [*_given("k", texts[law.floats :]), *_assigned(more), *_given("x", flow)]
    return "\n".join(lines)


def _after(write: Printer, law: Program) -> str:
    statements, texts = write(law.memory_after)
    reals, wholes = texts[: law.floats], texts[law.floats :]
    lines = [*_assigned(statements), *_given("m", reals), *_given("k", wholes)]
    return _AFTER.format(body="\n".join(lines)) if texts else _FORGETFUL


def _rate(write: Printer, law: Program) -> str:
    statements, texts = write(law.rate)
    lines = [*_assigned(statements), *_given("rates", texts)]
    return _RATE.format(body="\n".join(lines)) + _STEP


def _output(write: Printer, law: Program) -> str:
    statements, (text,) = write(law.output)
    return _OUTPUT.format(
        body="\n".join([*_assigned(statements), f"    return {text}"])
    )


_START = '''def _floats(values):
    return tuple(np.positive(value, dtype=float) for value in values)


@np.errstate(all="ignore")
def start(u, w=0.0, t=0.0):
    """The state at a first input u, where the output was w, at time t, s."""
    u, w = _floats((u, w))
{body}
    return t, u, _floats(x), _floats(m), tuple(map(np.positive, k))
'''
# Both sides of a choice are computed, of which one may divide by zero.
_AFTER = '''@np.errstate(all="ignore")
def _after(m, k, t, u0, u, du, h):
    """What is remembered after a straight line of the input."""
{body}
    return m, k
'''
_FORGETFUL = '''def _after(m, k, *_):
    """Nothing is remembered."""
    return m, k
'''
_RATE = '''@np.errstate(all="ignore")
def _rate(x, m, k, t, u, du):
    """The derivatives of what flows, per s."""
{body}
    return rates


'''
_OUTPUT = '''@np.errstate(all="ignore")
def output(state, du):
    """The output, where the input goes on with the derivative du, per s."""
    t, u, x, m, k = state
{body}
'''
_STEP = '''def _moved(x, slopes, h):
    return tuple(a + h * b for a, b in zip(x, slopes))


def step(state, u, h):
    """The state after the input has gone straight to u in h seconds."""
    t, u0, x, m, k = state
    u, h = _floats((u, h))
    du = (u - u0) / h
    half = 0.5 * h
    middle = u0 + half * du
    m1, k1 = _after(m, k, t, u0, middle, du, half)
    m2, k2 = _after(m1, k1, t + half, middle, u, du, half)
    s1 = _rate(x, m, k, t, u0, du)
    s2 = _rate(_moved(x, s1, half), m1, k1, t + half, middle, du)
    s3 = _rate(_moved(x, s2, half), m1, k1, t + half, middle, du)
    s4 = _rate(_moved(x, s3, h), m2, k2, t + h, u, du)
    slopes = (a + 2 * (b + c) + d for a, b, c, d in zip(s1, s2, s3, s4))
    return t + h, u, _moved(x, slopes, h / 6), m2, k2
'''
_JUMP = '''def step(state, u, h):
    """The state after the input has gone straight to u in h seconds."""
    t, u0, x, m, k = state
    u, h = _floats((u, h))
    m, k = _after(m, k, t, u0, u, (u - u0) / h, h)
    return t + h, u, x, m, k
'''
_RUN = '''def run(t, u, w=0.0):
    """The outputs at times t, s, two or more, under inputs u, of shape (n,) or (n,
    ...), where the output was w at first."""
    t, u = np.asarray(t, float), np.asarray(u, float)
    lengths = np.diff(t)
    state, outputs = start(u[0], w, t[0]), []
    for h, before, after in zip(lengths, u[:-1], u[1:]):
        outputs.append(output(state, (after - before) / h))
        state = step(state, after, h)
    outputs.append(output(state, (u[-1] - u[-2]) / lengths[-1]))
    return np.stack(np.broadcast_arrays(*outputs))
'''


def _self_test(name: str, samples: Samples | None) -> list[str]:
    if samples is None:
        return []
    rows = [
        line
        for symbol, column in zip("tuw", samples.columns(), strict=True)
        for line in _listed(symbol, column)
    ]
    return [
        "\n".join(
            [
                'if __name__ == "__main__":',
                "    # Times, inputs, and what hystjax has for the output.",
                *rows,
                f"    off = np.max(np.abs(run(t, u, {samples.seen!r}) - w))",
                f"    allowed = {samples.allowed!r}",
                f'    print(f"{name}: off by {{off:g}} at most, '
                '{allowed:g} allowed")',
                "    raise SystemExit(not off <= allowed)",
                "",
            ]
        )
    ]


def _listed(name: str, values: list[float]) -> list[str]:
    rows = _indented(str(values)[1:-1])
    return [f"    {name} = [", *(f"    {row}" for row in rows), "    ]"]


def _indented(text: str) -> list[str]:
    return [f"    {row}" for row in wrapped(text, 76)]
