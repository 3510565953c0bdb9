"""What generated files say of a law, and what they are tested with."""

from typing import Any, NamedTuple

import jax
import numpy as np

from .._core.errors import InputError
from ..recording import Recording
from ..simulation import FixedStep, simulate
from ._printing import line, wrapped
from ._program import Program

_TESTED = 400  # samples of a record that a self-test holds


class Samples(NamedTuple):
    """Times, inputs, and the outputs that hystjax has for them, shape (n,); and how far
    the largest of these is from 0."""

    t: np.ndarray
    u: np.ndarray
    w: np.ndarray

    @property
    def size(self) -> float:
        return float(np.max(np.abs(self.w))) or 1.0

    def columns(self) -> list[list[float]]:
        return [column.tolist() for column in (self.t, self.u, self.w)]


def about(law: Program, name: str, record: Recording | None) -> list[str]:
    """Lines that tell the law, its units, the ranges of what it was fitted on and of a
    record, and the version."""
    from .. import __version__

    u, w = ends(law.names, law.units)
    lines = [
        f"{name}: made by hystjax {__version__}",
        "",
        *wrapped(line(law.text)),
        "",
        f"u: {u}; w: {w}; time in s.",
    ]
    known = law.fitted_range
    if known is not None:
        lines.append(line(f"Fitted range of u: {known.in_words(law.units[0])}."))
    if record is not None:
        for symbol, values in (("u", record.u), ("w", record.w)):
            low, high = float(np.min(values)), float(np.max(values))
            lines.append(f"Of the record: {symbol} from {low:g} to {high:g}.")
    return lines


def ends(names: tuple[str, str], units: tuple[str, str]) -> list[str]:
    """Descriptions of the input and the output."""
    pairs = zip(names, units, strict=True)
    return [line(f"{name}, in {unit}" if unit else name) for name, unit in pairs]


def first_samples(model: Any, record: Recording | None) -> Samples | None:
    """The first samples of a record, its input straight in between, and the output
    there by `FixedStep(1)`, without a past; `None` of none."""
    if record is None:
        return None
    if len(record) < 2:
        raise InputError("a self-test needs a record of at least two samples.")
    n = min(len(record), _TESTED)
    straight = Recording(
        record.t[:n] if record.clocked else None, record.u[:n], record.w[:n]
    )
    run = simulate(model, straight, method=FixedStep(1))
    return Samples(*(np.asarray(jax.device_get(x)) for x in (run.t, run.u, run.w)))
