"""Models that are no differential equation, and models of either kind as arguments,
with recordings for them."""

import os
from abc import abstractmethod
from typing import Any, TypeVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._core import checks
from .._core.checks import InputError, described, is_concrete, warn
from .._core.solution import RESULTS, Solution, outcome
from ..library import Library, NoMemory
from ..recording import Recording
from ..recording._notation import differ
from ..signals import AbstractInputPath
from ._base import AbstractModel, check_outputs, in_jax

Self = TypeVar("Self", bound="AbstractSequenceModel")

_APART = 1e-3  # share by which sampling intervals may differ: times are rounded


class AbstractSequenceModel(eqx.Module):
    """A device as a map from input samples to output samples, at one sampling interval.

    There is nothing to integrate: `simulate` asks for the response. Whatever the model
    remembers it keeps inside.

    **Attributes:**

    - `interval`: time between samples, s.
    - `names`: what the input and the output are; keyword only.
    - `units`: units of the input and of the output; keyword only.
    """

    interval: eqx.AbstractVar[Float[Array, ""]]
    names: tuple[str, str] = eqx.field(
        static=True, kw_only=True, default=("input", "output")
    )
    units: tuple[str, str] = eqx.field(static=True, kw_only=True, default=("", ""))

    @abstractmethod
    def response(self, u: Float[Array, " n"], w0: Float[Array, ""]) -> Array:
        """The output at the samples, shape (n,), of the input there and the output at
        the first."""

    @property
    def memory(self) -> NoMemory:
        """None but what the model keeps inside."""
        return NoMemory()

    @property
    def fitted_range(self) -> None:
        """None is kept."""
        return None

    @property
    def rows_in_use(self) -> tuple[int, ...]:
        """None: there are no terms."""
        return ()

    def restricted(self: Self, rows: tuple[int, ...]) -> Self:
        """As it is."""
        return self

    def addends(self) -> None:
        """It is no sum of terms."""

    def check_times(self, t: Float[Array, " n"], clocked: bool) -> None:
        """Raise `InputError` unless samples are as far apart as the model knows
        them."""
        if not is_concrete(t, self.interval):
            return
        name, known = type(self).__name__, float(self.interval)
        checks.evenly_spaced(name, t, f"every {known:g} s")
        every = float(jnp.mean(jnp.diff(t)))
        if abs(every / known - 1) > _APART:
            raise InputError(
                f"`inputs` has a sample every {every:g} s, and this {name} knows "
                f"samples every {known:g} s only; resample first."
            )

    def free_run(
        self,
        method: Any,
        path: AbstractInputPath,
        w0: Float[Array, ""],
        scale: Float[Array, ""],
    ) -> tuple[Float[Array, " n"], Any, dict]:
        """The response, whatever the method."""
        answer = f"`response` of {type(self).__name__}"
        with in_jax(answer):
            w = self.response(path.samples()[0], w0)
        check_outputs(answer, w, path)
        result = outcome(jnp.all(jnp.isfinite(w)), RESULTS.diverged)
        return w, result, {"num_steps": jnp.array(len(w) - 1)}

    @abstractmethod
    def __str__(self) -> str:
        """The model for people."""


Model = TypeVar("Model", bound=AbstractModel | AbstractSequenceModel)


def as_model(given: Model | Solution, call: str, name: str = "model") -> Model:
    """A model, or that of a `Solution`.

    **Arguments:** what was given; the `call`, with its arguments in order, such as
    `simulate(model, recording)`; and the `name` of that argument.

    **Raises:** `InputError` for something else, with what is likely to be meant.
    """
    value: Any = given.value if isinstance(given, Solution) else given
    if isinstance(value, AbstractModel | AbstractSequenceModel):
        return value  # pyright: ignore[reportReturnType]
    of = " whose value is" if isinstance(given, Solution) else ""
    came = f"a Solution{of} {described(value)}" if of else described(value)
    raise InputError(
        f"`{name}` must be a model or the `Solution` of a fit, got {came}. "
        f"{_likely(value)}The order is `{call}`."
    )


def _likely(value: Any) -> str:
    """What is likely to be wrong."""
    if isinstance(value, Recording | AbstractInputPath):
        return "Were the model and the recording swapped? "
    if isinstance(value, Library):
        return "A library holds candidates; `hystjax.identify` makes a law of them. "
    if isinstance(value, str | os.PathLike):
        return "`hystjax.load` reads a saved model. "
    if isinstance(value, dict):
        return "`hystjax.models.SparseModel.from_terms` makes a law of its terms. "
    return ""


def fitting(
    model: AbstractModel | AbstractSequenceModel, group: tuple[Recording, ...]
) -> tuple[Recording, ...]:
    """Recordings with no more than the model needs: what came before them is nothing to
    one without memory, and would be compiled for.

    **Raises:** `InputError` for recordings that the model cannot follow, such as one
    without a clock for a model that depends on the rate.
    """
    for each in group:
        model.check_times(each.t, each.clocked)
    # Most have none, and to get at a method of a module takes longer than to look.
    if all(each.past is None for each in group) or model.memory.needs_past:
        return group
    return tuple(each.afresh() for each in group)


def warn_of_units(
    model: AbstractModel | AbstractSequenceModel, recording: Recording
) -> None:
    """Warn where numbers of a recording are not what the model takes them for."""
    pairs = zip(("input", "output"), model.units, recording.units, strict=True)
    apart = [
        f"{what} in {own}, and the recording's is in {given}"
        for what, own, given in pairs
        if differ(own, given)
    ]
    if apart:
        warn(
            f"the model has an {', and an '.join(apart)}. No number is converted, and "
            "what comes out is wrong where these are not two names of one unit: "
            "scale the recording, or make it with its right `units`.",
        )


def no_numbers(model: AbstractModel | AbstractSequenceModel) -> str:
    """In words, which of a model's parameters are known not to be finite."""
    given = model.parameters() if isinstance(model, AbstractModel) else {}
    known = {name: x for name, x in given.items() if is_concrete(x)}
    lost = [f"`{name}` is {x}" for name, x in known.items() if not np.isfinite(x)]
    return f"In the model that was given {lost[0]}." if lost else ""
