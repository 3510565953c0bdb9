"""What the fields of a recording must be."""

import operator
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array

from .._core import checks
from .._core.errors import InputError
from ..signals import Exact

_GAPS = (
    " Dropouts of an output can stay: `hystjax.bridged` makes a recording across them, "
    "and the weights by which fits leave them out."
)


def check_columns(t: Array, u: Array, w: Array) -> None:
    """Times, inputs and outputs are of one length, finite, and in order."""
    checks.same_length(t=t, u=u, w=w)
    checks.enough_samples("a recording", len(t), 3)
    checks.finite("t", t)
    checks.finite("u", u)
    checks.finite("w", w, _GAPS)
    checks.increasing("t", t)


def check_exact(interpolation: Exact, t: Array, u: Array) -> None:
    """Regression sees the samples and simulation the function: they must agree."""
    if not checks.is_concrete(t, u, *jax.tree.leaves(interpolation)):
        return
    with jax.ensure_compile_time_eval():
        apart = float(jnp.max(jnp.abs(jax.vmap(interpolation.function)(t) - u)))
        size = float(jnp.max(jnp.abs(u)))
    if apart > 1e-3 * size:
        raise InputError(
            f"`u` and the function of `interpolation.Exact` differ by up to "
            f"{apart:.3g}; replace a measured input by `with_input(function)`."
        )


def check_reach(times: Array, known: Array, clocked: bool) -> None:
    """Times to resample at must lie within those of the recording."""
    reach = jnp.stack([times[0] - known[0], known[-1] - times[-1]])
    if checks.is_concrete(reach) and jnp.any(reach < 0):
        unit = " s" if clocked else ""
        asked, held = (
            f"{float(x[0]):g}{unit} to {float(x[-1]):g}{unit}" for x in (times, known)
        )
        raise InputError(
            f"`t` runs from {asked}, beyond the recording's {held}; hystjax does not "
            "extrapolate measurements."
        )


def whether_clocked(t: Any, clocked: bool | None) -> bool:
    """Whether there is a clock, by default where there are times."""
    if t is None and clocked:
        raise InputError(
            "`clocked=True` needs times, but `t` is None; give `t`, or leave `clocked` "
            "out for a recording without a clock."
        )
    return t is not None if clocked is None else bool(clocked)


def whole_row(number: int) -> int:
    """The number of a row."""
    try:
        return operator.index(number)
    except TypeError:
        raise InputError(
            f"`window` takes whole numbers of rows, got {number!r}; `between` takes "
            "times, and `split` a fraction."
        ) from None


def pair_of(name: str, value: tuple[str, str]) -> tuple[str, str]:
    """Two texts, of the input and of the output."""
    if isinstance(value, str) or len(value) != 2:
        raise InputError(
            f"`{name}` must be a pair, for the input and for the output; got {value!r}."
        )
    return str(value[0]), str(value[1])
