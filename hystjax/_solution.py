"""What every fitting verb returns: a value, how it ended, and what is known of it."""

from collections.abc import Callable
from typing import Any

import diffrax
import equinox as eqx
import numpy as np
from jaxtyping import Array, Bool

from ._checks import is_concrete
from ._errors import ComputationError


class RESULTS(diffrax.RESULTS):  # pyright: ignore[reportGeneralTypeIssues]
    """Ways a computation can end; those of Diffrax and Optimistix, and two more."""

    empty_support = (
        "No term survived the threshold, the law is w' = 0. Lower the threshold; with "
        "`normalise=True` it is a share of the derivative's root mean square."
    )
    inaccurate = (
        "The steps that were tried are too long for the accuracy that was asked for. "
        "Outside of `jit`, `vmap` and `grad` another method takes over; inside, choose "
        "one: `method=hystjax.simulation.Adaptive.stiff()`, or `FixedStep` with enough "
        "`substeps`."
    )
    diverged = (
        "The simulated output did not stay finite. The law is unstable on this input: "
        "use fewer terms, another threshold, or a law that forgets its initial value."
    )


class Solution(eqx.Module):
    """The outcome of a verb.

    **Attributes:**

    - `value`: what was asked for, such as a model.
    - `result`: a member of `hystjax.RESULTS`.
    - `stats`: a dictionary of what is known about the computation.
    """

    value: Any
    result: RESULTS
    stats: dict[str, Any]


def outcome(good: Bool[Array, ""], otherwise: RESULTS) -> RESULTS:
    """Success where `good`, else the given reason."""
    return RESULTS.where(good, RESULTS.successful, otherwise)  # pyright: ignore


def raise_unless_successful(
    computed: Any, detail: Callable[[Any], str] = lambda _: ""
) -> Any:
    """`computed`, or an error when `computed.result` says that it is unusable.

    Concrete results raise a plain `ComputationError`, whose message ends with
    `detail(computed)`; traced ones raise at run time through `equinox.error_if`.
    """
    result = computed.result
    if not is_concrete(result._value):
        return result.error_if(computed, result != RESULTS.successful)
    if np.any(np.asarray(result._value) != np.asarray(RESULTS.successful._value)):
        message = f"{RESULTS[result]} {detail(computed)}".strip()
        raise ComputationError(message, result)
    return computed
