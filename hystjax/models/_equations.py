"""Models for people: as equations in text and LaTeX, and as what notebooks show."""

import types
import typing
from collections.abc import Iterator
from dataclasses import fields
from typing import Any

import equinox as eqx
import jax

from .._core.checks import InputError, is_concrete
from .._core.show import Card, Number, with_unit

TOLD = 12  # parameters that are shown, before they are only counted


def equation(model: Any, digits: int = 4) -> str:
    """A sum of terms as text, such as `w' = 0.25 u' + 0.4 u |u'| - 0.5 w |u'|`."""
    sum_of = [(c, term.text) for c, term in model.addends() or () if c != 0]
    left = "w' = " if model.target == "rate" else "w = "
    return left + signed_sum(sum_of, lambda c: f"{c:.{digits}g}", " ")


def latex_equation(model: Any, digits: int = 4) -> str:
    r"""A sum of terms in LaTeX, such as `\dot{w} = 0.25\,\dot{u}`."""
    sum_of = [(c, term.latex) for c, term in model.addends() or () if c != 0]
    left = r"\dot{w}" if model.target == "rate" else "w"
    total = signed_sum(sum_of, lambda c: _latex_number(c, digits), r"\,")
    return f"{left} = {total}"


def signed_sum(addends, number, space: str) -> str:
    """Coefficients and symbols as a sum with its signs between the addends."""
    text = ""
    for coefficient, symbol in addends:
        sign = "-" if coefficient < 0 else "+"
        size = number(abs(coefficient))
        product = size if symbol == "1" else f"{size}{space}{symbol}"
        text += f" {sign} {product}" if text else f"{sign.strip('+')}{product}"
    return text or "0"


def _latex_number(value: float, digits: int) -> str:
    mantissa, _, exponent = f"{value:.{digits}g}".partition("e")
    return rf"{mantissa} \times 10^{{{int(exponent)}}}" if exponent else mantissa


def card(model: Any) -> Card | None:
    """What is shown of a model; `None` while it is traced, or for a batch of laws."""
    leaves = jax.tree.leaves(eqx.filter(model, eqx.is_array))
    if not is_concrete(*leaves):
        return None
    if incomplete(model):
        return Card(gradient(model))
    try:
        listed = model.numbers()
        units = model.number_units()
        sum_of = model.addends() is not None
    except InputError:  # a batch
        return None
    told = listed if len(listed) <= TOLD else {}
    pairs = zip(("u", "w"), model.names, model.units, strict=True)
    return Card(
        str(model),
        tuple((symbol, with_unit(name, unit)) for symbol, name, unit in pairs),
        tuple(Number(name, x, units.get(name, "")) for name, x in told.items()),
        latex_equation(model.settled()) if sum_of else "",
    )


def incomplete(model: Any) -> bool:
    """Whether a model lacks arrays, as one does that holds cotangents: of masks and
    other arrays that are not real, there is no derivative."""
    return any(_lacking(model))


def gradient(model: Any) -> str:
    """A model without some of its arrays in words."""
    lacking = ", ".join(_lacking(model))
    said = f"not a {type(model).__name__} but a gradient, or part of one (no {lacking})"
    if not jax.tree.leaves(eqx.filter(model, eqx.is_inexact_array)):
        return said
    named = [f"{name} {float(x):.4g}" for name, x in model.parameters().items()]
    told = ", ".join(named) if len(named) <= TOLD else f"{len(named)} numbers"
    return f"{said}: {told}"


def _lacking(tree: Any, place: str = "") -> Iterator[str]:
    """Names of fields, here and in modules inside, that should hold something."""
    for field in fields(tree):
        value = getattr(tree, field.name, None)
        here = f"{place}{field.name}"
        missing = value is None and types.NoneType not in typing.get_args(field.type)
        if isinstance(value, eqx.Module):
            yield from _lacking(value, f"{here}.")
        elif missing or getattr(value, "dtype", None) == jax.dtypes.float0:
            yield here
