"""Models as arguments, and what comes in their place."""

import os
from typing import Any, TypeVar

from .._core.checks import described
from .._core.errors import InputError
from .._core.solution import Solution
from ..library import Library
from ..recording import Recording
from ..signals import AbstractInputPath
from ._base import AbstractModel
from ._sequence import AbstractSequenceModel

Model = TypeVar("Model", bound=AbstractModel | AbstractSequenceModel)


def as_model(given: Model | Solution, call: str) -> Model:
    """A model, or that of a `Solution`.

    **Arguments:** what was given; and the `call`, with its arguments in order, such as
    `simulate(model, recording)`.

    **Raises:** `InputError` for something else, with what is likely to be meant.
    """
    value: Any = given.value if isinstance(given, Solution) else given
    if isinstance(value, AbstractModel | AbstractSequenceModel):
        return value  # pyright: ignore[reportReturnType]
    of = " whose value is" if isinstance(given, Solution) else ""
    came = f"a Solution{of} {described(value)}" if of else described(value)
    raise InputError(
        f"`model` must be a model or the `Solution` of a fit, got {came}. "
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
