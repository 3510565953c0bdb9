"""What every fitting verb returns: a value, how it ended, and what is known of it."""

import functools
import operator
from collections import Counter
from collections.abc import Callable
from dataclasses import MISSING, fields, replace
from typing import Any, TypeVar

import diffrax
import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from .checks import ComputationError, is_concrete
from .show import Card, Shown, quantity


class RESULTS(diffrax.RESULTS):  # pyright: ignore[reportGeneralTypeIssues]
    """Ways a computation can end; those of Diffrax and Optimistix, and a few more."""

    __module__ = "hystjax"  # what one of them says that it is

    empty_support = (
        "No term is left, and the law is zero. `STLSQ` drops terms below its "
        "`threshold`: lower that; where columns are normalised, it is a share of the "
        "root mean square of what is explained. `NonNegative` has no term with a "
        "coefficient above zero: turn the sign of the input or of the output. Terms "
        "that are zero on the recording, such as plays wider than its input, are "
        "dropped by all: give others."
    )
    no_law = (
        "No law was found that explains the output clearly better than a constant "
        "does, or than what is known of it. Are input and output exchanged? Candidates "
        "of a higher degree may help, or more time, where `seconds` ended the search."
    )
    inaccurate = (
        "The steps that were tried are too long for the accuracy that was asked for. "
        "Outside of `jit`, `vmap` and `grad` another method takes over, unless it "
        "fails; inside, choose one: `method=hystjax.simulation.Adaptive.stiff()`, or "
        "`FixedStep` with enough `substeps`."
    )
    diverged = (
        "The simulated output did not stay finite. The law is unstable on this input: "
        "use fewer terms, another threshold, or a law that forgets its initial value."
    )
    not_finite = (
        "A candidate term or the derivative is NaN or inf somewhere on the recording, "
        "and nothing can be regressed. Likely a function of one's own is not defined "
        "there, such as log(u) at u = 0: leave it out, or guard it with `jnp.where`. "
        "Or `TotalVariation` did not converge: its `estimate(t, w)` says more. "
        "Otherwise squares of the values overflow: choose other units."
    )
    unreachable = (
        "No input within reach takes the output all the way to the reference; "
        '`stats["reached"]` says where one does. Look at its limits, at noise that '
        "asks for leaps, and whether the model can go there at all."
    )
    unsorted_time = (
        "`t` does not increase strictly. Sort the rows and remove repeated times; "
        "outside of `jax.jit` and `jax.vmap` the message says where they are."
    )


class Solution(Shown):
    """The outcome of a verb.

    **Attributes:**

    - `value`: what was asked for, such as a model.
    - `result`: a member of `hystjax.RESULTS`.
    - `stats`: a dictionary of what is known about the computation.
    """

    value: Any
    result: RESULTS
    stats: dict[str, Any]

    def _card(self) -> Card | None:
        if not is_concrete(self.result._value):
            return None
        value: Any = self.value
        inner = value._card() if isinstance(self.value, Shown) else None
        inner = inner or Card(type(value).__name__)
        errors = self.stats.get("standard_errors", {})
        numbers = value.listed(errors) if inner.numbers else ()
        unit = getattr(value, "units", ("", ""))[1]
        known = tuple(
            (name, quantity(x, unit if name in _IN_OUTPUT_UNITS else ""))
            for name, value in self.stats.items()
            if (x := _number(name, value)) is not None
        )
        title = f"Solution: {ended_in_words(self.result)}\n{inner.title}"
        facts = (*inner.facts, *known)
        return replace(inner, title=title, facts=facts, numbers=numbers)


Findings = TypeVar("Findings", bound="AbstractFindings")


class AbstractFindings(eqx.Module):
    """What a verb has found, typed and by name: what one part of the library hands to
    another. To the user it is told as a `Solution`, whose `stats` hold all but `value`
    and `result` by the same names; `None` is not told where it is the default.
    """

    value: eqx.AbstractVar[Any]
    result: eqx.AbstractVar[RESULTS]

    def solution(self) -> Solution:
        """The same as it is told."""
        return Solution(self.value, self.result, self.stats())

    def stats(self) -> dict[str, Any]:
        """What is known beside the value."""
        needed = _names(type(self), optional=False)
        every = {name: getattr(self, name) for name in _names(type(self))}
        return {k: x for k, x in every.items() if x is not None or k in needed}

    @classmethod
    def told_by(cls, given: Any) -> bool:
        """Whether that is a `Solution` with all of it in its `stats`."""
        needed = set(_names(cls, optional=False))
        return isinstance(given, Solution) and needed <= given.stats.keys()

    @classmethod
    def of(cls: type[Findings], solution: Solution) -> Findings:
        """What such a `Solution` tells."""
        stats = solution.stats
        known = {name: stats[name] for name in _names(cls) if name in stats}
        return cls(solution.value, solution.result, **known)


def _names(findings: type[AbstractFindings], optional: bool = True) -> list[str]:
    """What is told in `stats`; or of that what is always there."""
    told = [each for each in fields(findings) if each.name not in ("value", "result")]
    return [each.name for each in told if optional or each.default is MISSING]


_IN_OUTPUT_UNITS = ("rmse", "w0", "step_error", "spread", "noise_floor")


def _number(name: str, value: Any) -> float | None:
    """A single known real number, however it is kept; else `None`."""
    plain = isinstance(value, np.generic | np.ndarray | int | float)
    if not (plain or eqx.is_array(value)) or not is_concrete(value):
        return None
    array = np.asarray(value)
    single = array.ndim == 0 or (array.size == 1 and name in _IN_OUTPUT_UNITS)
    return float(array.ravel()[0]) if single and array.dtype.kind in "iuf" else None


def names_by_code() -> dict[int, str]:
    """What all ways to end are called, by the numbers that arrays hold for them."""
    return {int(x._value): name for name, x in RESULTS._name_to_item.items()}


def ended_in_words(result: RESULTS) -> str:
    """How a computation ended, such as `successful`; of a batch how many did so. For
    concrete results only."""
    names, codes = names_by_code(), np.asarray(result._value)
    if codes.ndim == 0:
        return names[int(codes)]
    counts = Counter(codes.ravel().tolist()).most_common()
    return ", ".join(f"{count} {names[code]}" for code, count in counts)


def outcome(good: Bool[Array, ""], otherwise: RESULTS) -> RESULTS:
    """Success where `good`, else the given reason."""
    return RESULTS.where(good, RESULTS.successful, otherwise)  # pyright: ignore


def if_sorted(result: RESULTS, *times: Float[Array, " _n"]) -> RESULTS:
    """The result, or `unsorted_time` where some `times` do not increase strictly, which
    a recording cannot check while it is traced."""
    if is_concrete(*times):
        good = all(np.all(np.diff(np.asarray(t)) > 0) for t in times)
        return result if good else RESULTS.unsorted_time
    good = jnp.stack([jnp.all(jnp.diff(t) > 0) for t in times])
    return RESULTS.where(jnp.all(good), result, RESULTS.unsorted_time)  # pyright: ignore


def ended(result: RESULTS, *ways: Any) -> Any:
    """Whether the result is one of these: not by JAX where it is known, which would
    compile each comparison."""
    number: Any = result._value
    number = np.asarray(number) if is_concrete(number) else number
    return functools.reduce(operator.or_, (number == way._value for way in ways))


def raise_unless_successful(
    computed: Any, detail: Callable[[Any], str] = lambda _: ""
) -> Any:
    """`computed`, or an error when `computed.result` says that it is unusable. What is
    `inaccurate` can be used, and says so.

    Concrete results raise a plain `ComputationError`, whose message ends with
    `detail(computed)`; traced ones raise at run time through `equinox.error_if`.
    """
    result = computed.result
    usable = ended(result, RESULTS.successful, RESULTS.inaccurate)
    if not is_concrete(result._value):
        return result.error_if(computed, ~usable)
    if not np.all(usable):
        message = f"{in_words(result)} {detail(computed)}".strip()
        raise ComputationError(message, result)
    return computed


# Of Diffrax and Optimistix, whose own words name options that hystjax does not have.
_REMEDIES = {
    "max_steps_reached": (
        "The simulation took more steps than it may. The model is likely stiff: it "
        "settles much faster than it is sampled, or its rate is not smooth. Try "
        "`method=hystjax.simulation.Adaptive.stiff()`, whose solver `Kvaerno5` is "
        "made for that, or a larger `rtol`."
    ),
    "nonlinear_max_steps_reached": (
        "The fit did not settle within `max_steps` steps. Begin nearer to the data: at "
        "a law from `identify` or a model's `guess`, or with "
        "`shooting=hystjax.refinement.Nudging()`; fix parameters that the data do not "
        "tell (`fixed`); or allow more `max_steps`."
    ),
}


def in_words(result: RESULTS) -> str:
    """How a computation ended, and what helps. For one concrete result."""
    return _REMEDIES.get(ended_in_words(result), RESULTS[result])
