"""What hystjax raises and warns of, and checks of arguments at its edge, with messages
that help.

Checks of values look at concrete ones only: under `jit`, `vmap` or `grad` values are
not known, and the checks pass; but for `concrete`, and those that return a number of
Python, `whole`, `count` and `share`.
"""

import difflib
import math
import operator
import os
import sys
import warnings
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from types import FrameType
from typing import Any

import jax
import jax.core
import jax.numpy as jnp
import numpy as np
from jaxtyping import ArrayLike


class InputError(ValueError):
    """An argument that cannot be used; the message says which, why and what to do."""

    __module__ = "hystjax"  # where it is caught, and what a traceback says


class ComputationError(RuntimeError):
    """A computation that ended without a usable value; `result` holds the reason."""

    __module__ = "hystjax"

    def __init__(self, message: str, result=None):
        super().__init__(message)
        self.result = result


# Whose frames lie between a caller and what is noticed: Equinox makes modules, and the
# last two look at types in tests.
_INNER = {__name__.partition(".")[0], "equinox", "jax", "jaxtyping", "beartype"}


_is_trial = ContextVar("is_trial", default=False)


@contextmanager
def on_trial() -> Iterator[None]:
    """What is computed here is not what a caller gets: nothing is warned of."""
    before = _is_trial.set(True)
    try:
        yield
    finally:
        _is_trial.reset(before)


def warn(message: str) -> None:
    """Warn of the line that called this package, however deep in it that is noticed."""
    if _is_trial.get():
        return
    frame, level = sys._getframe(), 1
    while frame.f_back and _package(frame) in _INNER:
        frame, level = frame.f_back, level + 1
    warnings.warn(message, stacklevel=level)


def _package(frame: FrameType) -> str:
    return frame.f_globals.get("__name__", "").partition(".")[0]


def is_concrete(*arrays) -> bool:
    """Whether none of `arrays` is being traced."""
    return not any(isinstance(array, jax.core.Tracer) for array in arrays)


def concrete(what: str, *trees: Any) -> None:
    """Raise `InputError` where `what` is traced: under `jit`, whatever its arguments,
    and under `vmap` or `grad` where a leaf of `trees` depends on theirs."""
    # Under `jit` every new array is traced, even a constant; to put a number on the
    # device is the way to make one without compiling.
    if not is_concrete(jax.device_put(0.0), *jax.tree.leaves(trees)):
        raise InputError(
            f"{what} looks at the values of its arguments, and under `jax.jit`, "
            "`jax.vmap` or `jax.grad` there are none yet. Call it outside of them, in "
            "a loop over recordings where there are several."
        )


# What is raised where code asks for the value of what is traced.
VALUE_ASKED = (
    jax.errors.ConcretizationTypeError,
    jax.errors.TracerArrayConversionError,
    jax.errors.TracerIntegerConversionError,
    jax.errors.NonConcreteBooleanIndexError,
)


def described(value: Any) -> str:
    """What came, for messages: `a Recording`, `the text 'du'`, `an array of shape (3,)`
    and so on."""
    if value is None:
        return "None"
    if isinstance(value, str | os.PathLike):
        return f"the text {str(value)!r}"
    if isinstance(value, np.ndarray | jax.Array):
        return f"an array of shape {value.shape}"
    if isinstance(value, bool | int | float | complex | np.generic):
        return f"the number {value}"
    if isinstance(value, type):
        return f"the class {value.__name__}"
    return with_article(type(value).__name__)


def with_article(name: str) -> str:
    """`a Recording`, `an AbstractModel`."""
    return f"{'an' if name[0] in 'AEIOUaeio' else 'a'} {name}"


def nearest(name: Any, known: Iterable[str]) -> str:
    """`Did you mean 'du'? ` where a known name is near to one that is not known."""
    names = {each.casefold(): each for each in known}
    # Cut, since it takes the square of the length, and names may be a stranger's.
    near = difflib.get_close_matches(str(name)[:60].casefold(), names, n=1, cutoff=0.6)
    return f"Did you mean {names[near[0]]!r}? " if near else ""


def kind(name: str, value: Any, wanted: type, such_as: str) -> None:
    """Raise `InputError` for what is not of the kind that is wanted, such as the name
    of one; `such_as` is an example in code."""
    if not isinstance(value, wanted):
        raise InputError(
            f"`{name}` must be an `{wanted.__name__}`, such as `{such_as}`; got "
            f"{described(value)}."
        )


def keywords(call: str, given: Iterable[str], known: Sequence[str]) -> None:
    """Raise `InputError` for an argument that a call does not have, with what it has:
    of a call that hands its arguments on, Python would name another one."""
    unknown = [name for name in given if name not in known]
    if unknown:
        raise InputError(
            f"`{call}` has no argument `{unknown[0]}`. {nearest(unknown[0], known)}It "
            f"has {', '.join(known)}."
        )


def several(name: str, values: Any, wanted: type, verb: str) -> None:
    """Raise `InputError` unless all of several things are what a verb returned."""
    if not isinstance(values, Sequence) or not all(
        isinstance(each, wanted) for each in values
    ):
        raise InputError(
            f"`{name}` must be what `{verb}` returned, got {described(values)}."
        )


def key(name: str, value: Any) -> None:
    """Raise `InputError` for a seed where a key of `jax.random` is wanted."""
    array = isinstance(value, np.ndarray | jax.Array)
    typed = array and jnp.issubdtype(value.dtype, jax.dtypes.prng_key)
    # Of an older kind a key is two numbers or more.
    if not typed and not (array and value.dtype == np.uint32 and value.ndim):
        raise InputError(
            f"`{name}` must be a key of `jax.random`, got {described(value)}; write "
            "`jax.random.key(0)`, with a seed of your own."
        )
    if value.ndim != (0 if typed else 1):
        raise InputError(
            f"`{name}` must be one key, got {value.shape[0]}; pick one, or call this "
            "for each with `jax.vmap`."
        )


def answers(**given: Any) -> None:
    """Raise `InputError` for what is neither `True` nor `False`, such as a length of a
    period for `periodic`, which Python would take for a yes."""
    for name, value in given.items():
        if not isinstance(value, bool | np.bool_):
            raise InputError(f"`{name}` must be True or False, got {described(value)}.")


def number(name: str, value: Any) -> jax.Array:
    """`value` as one of JAX's default floats; raises `InputError` for an array, for an
    answer such as `True`, and for what is no real number."""
    try:
        array = jnp.zeros(0) if isinstance(value, bool) else jnp.asarray(value)
    except (TypeError, ValueError):
        array = jnp.zeros(0)
    if array.shape != () or jnp.iscomplexobj(array):
        raise InputError(f"`{name}` must be one number, got {described(value)}.")
    return array.astype(jnp.result_type(float))


def whole(name: str, value: Any) -> int:
    """A whole number as an int; raises `InputError` for what is none."""
    try:
        if isinstance(value, bool):  # an answer, such as `lead_in=True`, and no number
            raise TypeError
        return operator.index(value)
    except TypeError:
        raise InputError(
            f"`{name}` must be a whole number, got {described(value)}."
        ) from None


def count(name: str, value: Any, least: int = 1) -> int:
    """A whole number that is no less than another one, as an int; raises `InputError`
    for anything else."""
    number = whole(name, value)
    if number < least:
        raise InputError(f"`{name}` must be at least {least}, got {number}.")
    return number


def share(name: str, value: Any, otherwise: str = "") -> float:
    """A share from 0 to 1 as a number of Python.

    **Raises:** `InputError` for anything else; `otherwise` says what else may be given.
    """
    try:
        known = np.asarray(value)
    except ValueError:  # lists of different lengths
        known = np.zeros(1)
    if known.dtype.kind not in "biuf" or known.ndim or not 0 <= known <= 1:
        raise InputError(
            f"`{name}` must be a share from 0 to 1{otherwise}; got {described(value)}."
        )
    return float(known)


def vector(name: str, value: ArrayLike | Sequence[ArrayLike]) -> jax.Array:
    """`value` as a 1-D array of JAX's default floats, so that all columns share one
    type; raises `InputError` when it is not one."""
    wanted = jnp.result_type(float)
    try:
        array = value if isinstance(value, jax.Array) else _by_numpy(value, wanted)
    except (TypeError, ValueError) as error:
        raise InputError(
            f"`{name}` must be a 1-D array of numbers, got {type(value).__name__} "
            f"({error})."
        ) from None
    if array.ndim != 1:
        remedy = (
            "Pass one column at a time; batches are made with `jax.vmap`."
            if array.ndim
            else "Put one number into a list."
        )
        raise InputError(f"`{name}` must be 1-D, got shape {array.shape}. {remedy}")
    if jnp.issubdtype(array.dtype, jnp.complexfloating):
        raise InputError(f"`{name}` must be real, got {array.dtype}.")
    return array.astype(wanted)


_POWERS = 50.0  # of ten, up to which squares and products of four are numbers


def sized(**columns: ArrayLike) -> None:
    """Raise `InputError` for columns in a unit in which their squares, or products, may
    be no numbers."""
    for name, column in columns.items():
        size = float(np.max(np.abs(np.asarray(column, np.float64)), initial=0.0))
        if size and abs(power := math.log10(size)) > _POWERS:
            raise InputError(
                f"`{name}` is about 1e{power:.0f}, and floating-point numbers do not "
                "hold its powers; choose another unit for it, in which values are "
                "nearer to 1."
            )


def _by_numpy(value: Any, wanted: Any) -> jax.Array:
    """What is known as an array of a type: JAX alone would compile a program for every
    new length. What NumPy knows no numbers in is left to JAX; what is masked is NaN."""
    _check_unit(value)
    try:
        known = np.asarray(unmasked(value))
    except jax.errors.TracerArrayConversionError:
        return jnp.asarray(value)
    if known.dtype.kind in "OSUMm":
        raise TypeError(
            f"of type {known.dtype}; where all are numbers, `numpy.asarray(x, float)` "
            "makes them such"
        )
    if known.dtype.kind not in "biuf":
        return jnp.asarray(value)
    return jnp.asarray(np.array(known, wanted), wanted)  # a copy of our own


def _check_unit(value: Any) -> None:
    """Raise `TypeError` for a quantity of pint or Astropy, whose unit NumPy leaves out:
    milliseconds would be taken for seconds."""
    if hasattr(value, "magnitude") and hasattr(value, "units"):
        unit, bare = value.units, "x.to(unit).magnitude"
    elif hasattr(value, "to_value") and hasattr(value, "unit"):
        unit, bare = value.unit, "x.to_value(unit)"
    else:
        return
    raise TypeError(
        f"in {unit}, which would be lost: `{bare}` gives the numbers in a unit, which "
        "of times is s"
    )


def unmasked(value: Any) -> Any:
    """A masked array with NaN, NaT, "" or None in place of what is masked; anything
    else as it is."""
    if not isinstance(value, np.ma.MaskedArray):
        return value
    kind = value.dtype.kind
    if kind in "biu":
        value = value.astype(float)
    missing = {"m": "NaT", "M": "NaT", "S": "", "U": "", "O": None}
    filling: Any = np.array(missing.get(kind, np.nan), value.dtype)
    return value.filled(filling)


def rows(array: jax.Array, which: slice | np.ndarray) -> jax.Array:
    """Some rows, cut by NumPy where values are known: JAX would compile a program for
    every new cut."""
    if not is_concrete(array):
        return array[which]
    return jnp.asarray(np.asarray(array)[which].copy(), array.dtype)


def finite(name: str, array: jax.Array, otherwise: str = "") -> None:
    """Raise `InputError` when `array` holds NaN or inf; `otherwise` says what else
    helps than to remove or fill these."""
    if not is_concrete(array):
        return
    bad = np.flatnonzero(~np.isfinite(np.asarray(array)))
    if bad.size:
        raise InputError(
            f"`{name}` has {bad.size} value(s) that are NaN or inf, the first at row "
            f"{bad[0]}. Remove those rows, or fill them (`numpy.interp`), first."
            f"{otherwise}"
        )


def weights(given: Any, w: jax.Array) -> jax.Array:
    """Weights of the samples of an output; raises `InputError` for another length, or
    for what is negative or not finite."""
    if np.shape(given) == (1, *w.shape):  # as verbs of several recordings take them
        raise InputError(
            "`weights` must be an array of one number a sample, got a list of one such "
            "array; of one recording leave out the brackets."
        )
    array = vector("weights", given)
    same_length(weights=array, w=w)
    finite("weights", array)
    positive("weights", array, zero=True)
    return array


def same_length(**arrays: jax.Array) -> None:
    """Raise `InputError` when the named arrays differ in length."""
    lengths = {name: len(array) for name, array in arrays.items()}
    if len(set(lengths.values())) > 1:
        listed = ", ".join(f"`{name}` {length}" for name, length in lengths.items())
        raise InputError(
            f"Lengths differ: {listed}. All columns of a recording need one value a "
            "sample."
        )


def enough_samples(
    what: str, got: int, needed: int, instead: str = "a wider window"
) -> None:
    """Raise `InputError` when fewer than `needed` samples are there; `instead` of a
    longer recording what helps."""
    if got < needed:
        raise InputError(
            f"{what} needs at least {needed} samples, got {got}. Use a longer "
            f"recording or {instead}."
        )


_FAR, _RESTARTS = 10, 20  # steps that times go back by at a restart, and how often


def increasing(name: str, array: jax.Array) -> None:
    """Raise `InputError` unless `array` increases strictly."""
    if not is_concrete(array):
        return
    steps = np.diff(np.asarray(array))
    bad = np.flatnonzero(steps <= 0)
    if not bad.size:
        return
    row = int(bad[0]) + 1
    kind = "repeats" if steps[bad[0]] == 0 else "goes back"
    hint = "Sort the rows and remove repeated times."
    far = _FAR * np.median(np.abs(steps))
    goes_on = np.all(steps[np.minimum(bad + 1, len(steps) - 1)] <= far)
    if -np.min(steps) > far and goes_on and bad.size <= _RESTARTS:
        hint = (
            "If these are several runs one after the other, make a recording of each, "
            f"the first of them up to row {row}, and give a list. Else sort the rows."
        )
    if kind == "repeats" and np.all(steps >= 0):
        hint = (
            "If times were rounded, of samples at one pace, give that pace instead: "
            "`t = period * numpy.arange(n)`. Else remove the repeated rows."
        )
    if array.dtype == jnp.float32:
        hint += (
            " If the file is in order, the steps are too small for float32: switch on "
            "64-bit numbers with `jax.config.update('jax_enable_x64', True)`."
        )
    raise InputError(
        f"`{name}` must increase strictly; it {kind} at row {row} "
        f"({float(array[row - 1])!r} then {float(array[row])!r}), {bad.size} time(s) "
        f"in all. {hint}"
    )


def evenly_spaced(what: str, t: jax.Array, otherwise: str) -> None:
    """Raise `InputError` unless the steps of the times `t` agree within 1 %."""
    if not is_concrete(t):
        return
    steps = np.diff(np.asarray(t, np.float64))
    spread = np.ptp(steps) / np.mean(steps)
    if spread > 0.01:
        raise InputError(
            f"{what} needs evenly sampled times, but the steps of `t` vary by "
            f"{spread:.1%}; resample first, {otherwise}."
        )


_LEAP = 2.0  # times the largest step of an input, that whole periods may end with
_AGAIN = 1e-6  # of the steps beside it, by which a row may be off one that it repeats
_HELD = 0.1  # of the steps, that are 0 where an input is rounded or rests


def whole_periods(what: str, u: jax.Array, w: jax.Array, otherwise: str = "") -> None:
    """Raise `InputError` for an input that cannot go round, and warn where its last row
    is the first again."""
    if not is_concrete(u):
        return
    inputs = np.asarray(u)
    leap, steps = abs(inputs[0] - inputs[-1]), np.diff(inputs)
    largest = np.max(np.abs(steps))
    if leap > _LEAP * largest:
        raise InputError(
            f"{what} takes whole periods of the input, which goes on from the last row "
            f"as at the first: here it would leap by {leap:.3g}, and between rows it "
            f"changes by {largest:.3g} at most. Make the recording of rows that are "
            f"whole periods{otherwise}."
        )
    # Beside a tip inputs are alike on both sides of it, and the outputs have to say.
    passing = steps[0] * steps[-1] > 0
    held = np.mean(steps == 0) > _HELD  # where all neighbours may be alike
    known = passing or (is_concrete(w) and _comes_again(np.asarray(w)))
    if known and not held and _comes_again(inputs):
        warn(
            "the last row of the recording is its first again, as where a loop is "
            f"drawn closed. {what} goes on to the first row from there, and takes a "
            "period that is one sample too long. Make the recording without that row.",
        )


def _comes_again(x: np.ndarray) -> bool:
    beside = min(abs(x[1] - x[0]), abs(x[-1] - x[-2]))
    return bool(abs(x[-1] - x[0]) < _AGAIN * beside)


def not_constant(name: str, array: jax.Array, why: str) -> None:
    """Raise `InputError` when all values of `array` are equal."""
    if is_concrete(array) and np.ptp(np.asarray(array)) == 0:
        raise InputError(
            f"`{name}` is constant ({float(array[0])!r}); {why} Check the column, or "
            "choose a window in which it changes."
        )


def not_zero(name: str, value: ArrayLike, why: str) -> None:
    """Raise `InputError` for a number that is 0, with the reason."""
    if is_concrete(value) and np.any(np.asarray(value) == 0):
        raise InputError(f"`{name}` must not be 0: {why}")


def positive(name: str, value: ArrayLike, *, zero: bool = False) -> None:
    """Raise `InputError` unless every value of `value` is positive (or zero)."""
    if not is_concrete(value):
        return
    try:
        array = np.asarray(value)
    except ValueError:  # lists of different lengths
        array = np.asarray(None)
    if array.dtype.kind in "cOSUMm":  # complex ones, which NumPy compares, too
        raise InputError(f"`{name}` must be a number, got {described(value)}.")
    good = array >= 0 if zero else array > 0
    if np.all(good):
        return
    bound, got = "zero or more" if zero else "positive", f"{value}"
    if array.size > 1:  # of many the first that is not
        bad = np.argwhere(~good).tolist()
        got = f"{array[tuple(bad[0])]:g} at {bad[0]}"
        got += f", and {len(bad) - 1} more such" if len(bad) > 1 else ""
    raise InputError(f"`{name}` must be {bound}, got {got}.")


_ROUNDED = 1e-3  # share of a step or of a range, by which rounding shows


def warn_rounded_times(t: jax.Array) -> None:
    """Warn when times so far from zero are rounded by a share of a step that shows."""
    if not is_concrete(t) or len(t) < 2:
        return
    times = np.asarray(t, np.float64)
    step, eps = np.min(np.diff(times)), jnp.finfo(t.dtype).eps
    # Steps that are none are refused elsewhere, and whole numbers are not rounded.
    rounding = float(eps) * np.max(np.abs(times)) / step if step > 0 else 0.0
    if rounding > _ROUNDED and np.any(times % 1):
        wider = ", or switch on 64-bit numbers" if t.dtype == jnp.float32 else ""
        warn(
            f"{t.dtype} rounds times so far from zero by about {rounding:.1%} of a "
            f"step: subtract the first from `t` before{wider}.",
        )


def warn_rounded_input(u: jax.Array) -> None:
    """Warn when float32 rounds an input far from zero by a share of its range that
    shows in what remembers it."""
    if u.dtype != jnp.float32 or not is_concrete(u):
        return
    values = np.asarray(u, np.float64)
    reach = np.ptp(values)
    rounding = np.finfo(np.float32).eps * np.max(np.abs(values)) / (reach or np.inf)
    if rounding > _ROUNDED / 10:
        warn(
            f"float32 rounds an input so far from zero by about {rounding:.1%} of its "
            "range: subtract its middle, or switch on 64-bit numbers with "
            "`jax.config.update('jax_enable_x64', True)` before making the recording.",
        )


def warn_single_precision(t: jax.Array, w: jax.Array) -> None:
    """Warn when float32 rounding is visible in the derivative of `w`.

    Rounding errors of w enter a difference quotient divided by the step, so that
    closely sampled records lose digits quickly; those of t are told of recordings.
    """
    if t.dtype != jnp.float32 or not is_concrete(t, w):
        return
    times, values = np.asarray(t, np.float64), np.asarray(w, np.float64)
    step = np.min(np.diff(times))
    slope = np.sqrt(np.mean(np.gradient(values, times) ** 2))
    most = np.max(np.abs(values))
    rounding = np.finfo(np.float32).eps * most / (step * slope or np.inf)
    if rounding > _ROUNDED:
        warn(
            f"float32 rounds the derivative of this record by about {rounding:.1%}; "
            "switch on 64-bit numbers with "
            "`jax.config.update('jax_enable_x64', True)` before making the recording.",
        )
