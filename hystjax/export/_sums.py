"""Laws for use elsewhere: plain text, LaTeX, SymPy and NumPy source."""

import re
from typing import Any

import jax
import numpy as np

from .._core import checks
from .._core.checks import InputError
from .._core.solution import Solution
from ..library import AbstractOperator, AbstractVariable, Term, operators_of
from ..library._variable import PLAIN
from ..models import AbstractModel, as_model, equation
from ..models._base import check_answers, latex_equation


def to_text(model: AbstractModel | Solution, digits: int = 4) -> str:
    """The law in plain text, such as `w' = 0.25 u' + 0.4 u |u'| - 0.5 w |u'|`.

    **Arguments:**

    - `model`: the law, not a batch; other models print their own equations.
    - `digits`: significant digits of the coefficients.
    """
    checks.count("digits", digits)
    model = as_model(model, "to_text(model)")
    check_one(model)
    return str(model) if model.addends() is None else equation(model, digits)


def to_latex(model: AbstractModel | Solution, digits: int = 4) -> str:
    r"""The law in LaTeX, without dollar signs, such as
    `\dot{w} = 0.25\,\dot{u} - 0.5\,w\,|\dot{u}|`; arguments as for `to_text`.

    **Raises:** `InputError` for a model that is no sum of terms.
    """
    checks.count("digits", digits)
    return latex_equation(_law(model, "to_latex(model)"), digits)


def to_sympy(model: AbstractModel | Solution) -> Any:
    """w' (or w, of a law of the value) as a SymPy expression in the real symbols `w`,
    `u` and `du`.

    Coefficients are floats of 53 bits; functions of your own, and what the law
    remembers, become undefined functions.

    **Raises:** `InputError` for a model that is no sum of terms.
    """
    import sympy

    addends = _addends(_law(model, "to_sympy(model)"))
    return sympy.Add(*(sympy.Float(c) * term.sympy() for c, term in addends))


def to_python(model: AbstractModel | Solution) -> str:
    """Source text of a function `rate(w, u, du)` that needs NumPy alone, or `value(u)`
    for laws of the value, `value(u, du)` for such as hold the input's rate.

    Laws that remember get a further argument, `memory`, and two more functions: `start`
    makes it at a first input, and `after` takes it along a straight line to the next.

    Coefficients are written to the last bit, and names and units are documented.

    **Raises:** `InputError` for a model that is no sum of terms, and for laws with
    functions of your own, or with signals of other signals.
    """
    model = _law(model, "to_python(model)")
    addends = _addends(model)
    lines = [_python_addend(c, term) for c, term in addends]
    value = model.target == "value"
    rated = value and any(re.search(r"\bdu\b", each) for each in lines)
    if all(term == Term() for _, term in addends):
        lines.append(f"+ np.zeros_like({'u' if value else 'w'})")  # of the same shape
    lines[0] = lines[0].removeprefix("+ ")
    u, w = (described(*pair) for pair in zip(model.names, model.units, strict=True))
    operators = operators_of([term for _, term in addends])
    what = _VALUE if value else _RATE
    unpacked = "".join(f"{each.python}, " for each in operators)
    source = what.format(
        law=_quoted(to_text(model)),
        w=_quoted(w),
        u=_quoted(u),
        unit=_quoted(model.units[1] or "the unit of w"),
        memory=(", du" if rated else "") + (", memory" if operators else ""),
        du=_DU if rated else "",
        unpacked=f"    {unpacked}= memory\n" if operators else "",
        total="\n        ".join(lines),
    )
    return source + _remembered(operators, unpacked)


_RATE = '''import numpy as np


def rate(w, u, du{memory}):
    """The law {law}

    w: {w}.
    u: {u}.
    du: the derivative du/dt, t in seconds.
    All three are numbers, or arrays of one shape.

    Returns dw/dt, in {unit} per second.
    """
{unpacked}    return (
        {total}
    )
'''
_VALUE = '''import numpy as np


def value(u{memory}):
    """The law {law}

    w: {w}.
    u: {u}, a number or an array.
{du}
    Returns w, in {unit}.
    """
{unpacked}    return (
        {total}
    )
'''
_DU = "    du: the derivative du/dt, t in seconds, of the same shape.\n"
_MEMORY = '''

def start(u):
    """What the law remembers at a first input u, of a device without a past."""
    return (
        {starts}
    )


def after(memory, u0, u1, h):
    """What it remembers after the input has gone straight from u0 to u1 in h s."""
    {unpacked}= memory
    return (
        {afters}
    )
'''


def _remembered(operators: tuple[AbstractOperator, ...], unpacked: str) -> str:
    if not operators:
        return ""
    chained = [each.name for each in operators if not isinstance(each.of, str)]
    if chained:
        raise InputError(
            f"the law holds {', '.join(chained)}, signals of other signals, of which "
            "source text is not made; `hystjax.save` keeps the law."
        )
    starts, afters = (
        "\n        ".join(f"{each}," for each in lines)
        for lines in (
            [operator.python_start() for operator in operators],
            [operator.python_after() for operator in operators],
        )
    )
    return _MEMORY.format(starts=starts, afters=afters, unpacked=unpacked)


def check_one(model: AbstractModel) -> None:
    """Raise `InputError` for a model whose numbers are being traced, and for several in
    a batch."""
    if not checks.is_concrete(*jax.tree.leaves(model)):
        raise InputError("`model` is being traced; export it outside `jit` and `vmap`.")
    if not isinstance(model, AbstractModel):  # of whole sequences, which are printed
        return
    try:
        check_answers(model)
    except InputError as error:
        # That an answer is not written in JAX has nothing to do with a batch.
        if isinstance(error.__cause__, checks.VALUE_ASKED):
            raise
        raise InputError(
            "one device can be exported at a time, and this is a batch, or a model "
            f"whose answers do not fit one another: {error} Pick one of a batch with "
            "`jax.tree.map(lambda x: x[i], model)`."
        ) from error


def check_numbers(model: AbstractModel) -> None:
    """Raise `InputError` for a model with a parameter that is NaN, from which a machine
    would get nothing else."""
    lost = [name for name, x in model.parameters().items() if np.isnan(x)]
    if lost:
        raise InputError(
            f"`{lost[0]}` of this {type(model).__name__} is NaN, and so would be all "
            "that comes out of its source text. If a fit has ended there, its `result` "
            "says why."
        )


def _law(model: AbstractModel | Solution, call: str) -> AbstractModel:
    """The sum of terms that a call is about, its names in step with its numbers."""
    model = as_model(model, call)
    check_one(model)
    if model.addends() is None:
        raise InputError(
            f"this {type(model).__name__} is no sum of terms w' = f(w, u, u') or w = "
            "f(u), of which source text could be made: it has hidden states, or does "
            "not say its `addends()`; `to_text` prints it."
        )
    check_numbers(model)
    return model.settled()


def _addends(law: AbstractModel) -> list[tuple[float, Term]]:
    return [(c, term) for c, term in law.addends() or () if c != 0]


def described(name: str, unit: str) -> str:
    """Such as `displacement, in µm`."""
    return f"{name}, in {unit}" if unit else name


def one_line(text: str) -> str:
    """What can be printed of a text, in one line."""
    return "".join(c for c in " ".join(text.split()) if c.isprintable())


def _quoted(text: str) -> str:
    """Any text, made fit for one line of a docstring."""
    return one_line(text).replace("\\", "\\\\").replace('"', '\\"')


def _python_addend(coefficient: float, term: Term) -> str:
    sign = "-" if coefficient < 0 else "+"
    return f"{sign} " + " * ".join([repr(abs(coefficient)), *_python_factors(term)])


def _python_factors(term: Term) -> list[str]:
    powers = dict(term.factors)
    signs = []
    if powers.get(_MAGNITUDE, 0) < 0 and powers.get(_OUTPUT, 0) > 0:
        # w |w|^(n-1) of a Bouc-Wen law with n < 1, which is 0 at w = 0
        powers[_OUTPUT] -= 1
        powers[_MAGNITUDE] += 1
        signs = ["np.sign(w)"]
    return signs + [_python_power(v, power) for v, power in powers.items() if power]


_OUTPUT, _MAGNITUDE = PLAIN["w"], PLAIN["|w|"]


def _python_power(variable: AbstractVariable, power: float) -> str:
    symbol = variable.python
    if power < 0:  # of 0 it counts as 0, as in the law
        safe = f"np.where({symbol} == 0, 1.0, {symbol})"
        return f"np.where({symbol} == 0, 0.0, {safe} ** {power!r})"
    return symbol if power == 1 else f"{symbol}**{power!r}"
