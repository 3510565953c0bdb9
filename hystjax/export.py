"""Laws for use elsewhere: plain text, LaTeX, SymPy and NumPy source."""

from typing import Any

from . import _checks
from ._errors import InputError
from .library import AbstractVariable, Term
from .library._variable import PLAIN
from .models import AbstractLaw, AbstractModel, equation
from .models._base import signed_sum


def to_text(model: AbstractModel, digits: int = 4) -> str:
    """The law in plain text, such as `w' = 0.25 u' + 0.4 u |u'| - 0.5 w |u'|`.

    **Arguments:**

    - `model`: the law, not a batch; other models print their own equations.
    - `digits`: significant digits of the coefficients.
    """
    _checks.positive("digits", digits)
    return equation(model, digits) if isinstance(model, AbstractLaw) else str(model)


def to_latex(model: AbstractModel, digits: int = 4) -> str:
    r"""The law in LaTeX, without dollar signs, such as
    `\dot{w} = 0.25\,\dot{u} - 0.5\,w\,|\dot{u}|`; arguments as for `to_text`."""
    _checks.positive("digits", digits)
    addends = [(c, term.latex) for c, term in _addends(model)]
    total = signed_sum(addends, lambda c: _latex_number(c, digits), r"\,")
    return rf"\dot{{w}} = {total}"


def to_sympy(model: AbstractModel) -> Any:
    """w' as a SymPy expression in the real symbols `w`, `u` and `du`.

    Coefficients are floats of 53 bits; functions of your own become undefined
    functions of `(w, u, du)`.
    """
    import sympy

    return sympy.Add(*(sympy.Float(c) * term.sympy() for c, term in _addends(model)))


def to_python(model: AbstractModel) -> str:
    """Source text of a function `rate(w, u, du)` that needs NumPy alone.

    Coefficients are written to the last bit, and names and units are documented.

    **Raises:** `InputError` for laws with functions of your own.
    """
    addends = _addends(model)
    lines = [_python_addend(c, term) for c, term in addends]
    if all(term == Term() for _, term in addends):
        lines.append("+ np.zeros_like(w)")  # or the result would have no shape
    lines[0] = lines[0].removeprefix("+ ")
    u, w = (_described(*pair) for pair in zip(model.names, model.units, strict=True))
    return _SOURCE.format(
        law=_quoted(to_text(model)),
        w=_quoted(w),
        u=_quoted(u),
        unit=_quoted(model.units[1] or "the unit of w"),
        total="\n        ".join(lines),
    )


_SOURCE = '''import numpy as np


def rate(w, u, du):
    """The law {law}

    w: {w}.
    u: {u}.
    du: the derivative du/dt, t in seconds.
    All three are numbers, or arrays of one shape.

    Returns dw/dt, in {unit} per second.
    """
    return (
        {total}
    )
'''


def _addends(model: AbstractModel) -> list[tuple[float, Term]]:
    if not isinstance(model, AbstractLaw):
        raise InputError(
            f"a {type(model).__name__} has hidden states, so that it is no law w' = "
            "f(w, u, u') to export; `hystjax.save` keeps it, `to_text` prints it."
        )
    return [(c, term) for c, term in model.addends() if c != 0]


def _described(name: str, unit: str) -> str:
    return f"{name}, in {unit}" if unit else name


def _quoted(text: str) -> str:
    """Any text, made fit for one line of a docstring."""
    line = "".join(c for c in " ".join(text.split()) if c.isprintable())
    return line.replace("\\", "\\\\").replace('"', '\\"')


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


def _latex_number(value: float, digits: int) -> str:
    mantissa, _, exponent = f"{value:.{digits}g}".partition("e")
    return rf"{mantissa} \times 10^{{{int(exponent)}}}" if exponent else mantissa
