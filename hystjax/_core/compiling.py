"""Compiling: for calls that are made once, from Python, and side by side; one
branch for all of a batch; programs looked into; and modules changed at less cost than a
short program has."""

import functools
import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import contextmanager
from contextvars import ContextVar, copy_context
from typing import Any, ParamSpec, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.core import eval_context
from jax.custom_batching import custom_vmap
from jax.extend.core import Literal, get_opaque_trace_state
from jaxtyping import Array, Shaped

from .checks import is_concrete

_Inputs = ParamSpec("_Inputs")
_Output = TypeVar("_Output")

# With the older emitters of XLA for CPUs, programs such as that of `refine` compile in
# half the time and run as fast. Other devices ignore it.
_QUICKER = ("xla_cpu_use_fusion_emitters", False)

# Without optimisation they compile in half of that, and may run twice as long.
_UNOPTIMISED = ("xla_backend_optimization_level", 0)

_FEW = 100_000  # samples, through which one run takes less than to optimise for it

_runs_once = ContextVar("runs_once", default=False)


@contextmanager
def run_once(samples: int) -> Iterator[None]:
    """What is compiled here runs a single time, through so many samples."""
    before = _runs_once.set(samples < _FEW)
    try:
        yield
    finally:
        _runs_once.reset(before)


def jit(function: Callable[_Inputs, _Output]) -> Callable[_Inputs, _Output]:
    """`equinox.filter_jit` that compiles quickly where it is called from Python.

    Inside of `jit`, `grad` and the like it is what `filter_jit` is: how a program is
    compiled is said where it begins.
    """

    @functools.wraps(function)
    def traced(*args: _Inputs.args, **kwargs: _Inputs.kwargs) -> _Output:
        # The mesh in use, named: unnamed, JAX takes it for another one than inside of
        # loops, and traces again there what it has traced already. Products of float32
        # in float32: GPUs and TPUs would take 10 or 7 bits for the 23 of a number.
        with (
            jax.sharding.use_abstract_mesh(jax.sharding.get_abstract_mesh()),
            jax.default_matmul_precision("highest"),
        ):
            return function(*args, **kwargs)

    programs: dict[tuple, Callable[_Inputs, _Output]] = {}

    def compiled(options: tuple) -> Callable[_Inputs, _Output]:
        if options not in programs:
            more: Any = {"compiler_options": dict(options)}  # not in its overloads
            programs.setdefault(options, eqx.filter_jit(traced, **more))
        return programs[options]

    @functools.wraps(function)
    def call(*args: _Inputs.args, **kwargs: _Inputs.kwargs) -> _Output:
        options = (_QUICKER, _UNOPTIMISED) if _runs_once.get() else (_QUICKER,)
        known = tuple(filter(_known, options)) if alone(args, kwargs) else ()
        return compiled(known)(*args, **kwargs)

    return call


def alone(*args: Any) -> bool:
    """Whether a program that is called with these is one of its own, and no part of
    another: what comes out of it can be looked at."""
    return is_concrete(*jax.tree.leaves(args)) and not _inside()


with eval_context():
    _OUTSIDE = get_opaque_trace_state()


def _inside() -> bool:
    """Whether what is computed here, of constants too, becomes part of a program."""
    return get_opaque_trace_state() != _OUTSIDE


@functools.cache
def _known(option: tuple[str, Any]) -> bool:
    """Whether this version of XLA has an option, which names its inner parts."""

    def nothing(x: Any):
        return x

    try:
        jax.jit(nothing, compiler_options=dict([option])).lower(0.0).compile()
    except jax.errors.JaxRuntimeError:
        return False
    return True


def launched() -> bool:
    """Whether what is traced now will run where each step of a loop is launched by
    itself, which takes longer than a short step does: anywhere but on a processor."""
    settings: Any = jax.config  # whose attributes are made as it runs
    device = settings.jax_default_device or jax.default_backend()
    return getattr(device, "platform", device) != "cpu"


@custom_vmap
def largest(count: Shaped[Array, ""]) -> Shaped[Array, ""]:
    """The count; of a batch the largest, one for all of it, of truths whether any is.

    A loop whose length or a branch whose condition differs along a batch would be
    turned into one that selects between whole results at every step.
    """
    return count


@largest.def_vmap
def _(size, batched, counts):
    return largest(jnp.max(counts, initial=0)), False  # 0 of a batch of none


def depends(function: Callable, *args: Any) -> bool:
    """Whether anything that a function returns depends on its arguments, as far as can
    be seen from its program."""
    traced = jax.make_jaxpr(function)(*args).jaxpr
    return any(_reached(traced, [True] * len(traced.invars)))


def _reached(jaxpr: Any, marked: list[bool]) -> list[bool]:
    """Which results depend on marked arguments."""
    known = {v for v, mark in zip(jaxpr.invars, marked, strict=True) if mark}
    for equation in jaxpr.eqns:
        inputs = [not isinstance(v, Literal) and v in known for v in equation.invars]
        inner = equation.params.get("jaxpr", equation.params.get("call_jaxpr"))
        inner = getattr(inner, "jaxpr", inner)
        # What a loop carries goes from turn to turn, by ways that are not looked at.
        looped = equation.primitive.name == "scan"
        if inner is not None and not looped and len(inner.invars) == len(inputs):
            outputs = _reached(inner, inputs)
        else:
            outputs = [any(inputs)] * len(equation.outvars)
        known.update(v for v, o in zip(equation.outvars, outputs, strict=False) if o)
    return [not isinstance(v, Literal) and v in known for v in jaxpr.outvars]


_MOST = 4  # more would wait for Python, which traces one program at a time

_Item = TypeVar("_Item")
_Result = TypeVar("_Result")


def side_by_side(
    function: Callable[[_Item], _Result], items: Sequence[_Item]
) -> Iterator[tuple[_Item, _Result]]:
    """Each item with what the function makes of it, in the order in which they are
    done: as many at a time as there are processors."""
    # What a caller has set for its own thread holds in these, too.
    settings: Any = jax.config  # whose attributes are made as it runs
    wide, device = settings.jax_enable_x64, settings.jax_default_device

    def call(item: _Item) -> _Result:
        with jax.enable_x64(wide), jax.default_device(device):
            return function(item)

    pool, ends = ThreadPoolExecutor(min(_MOST, _processors())), True
    try:
        running = {pool.submit(copy_context().run, call, item): item for item in items}
        for done in as_completed(running):
            yield running[done], done.result()
    except KeyboardInterrupt:
        ends = False  # to compile may take half a minute more
        raise
    finally:  # who stops waiting does not wait for what has not begun
        pool.shutdown(wait=ends, cancel_futures=True)


def in_order(
    function: Callable[[_Item], _Result], items: Sequence[_Item]
) -> Iterator[tuple[_Item, _Result]]:
    """As `side_by_side`, in the order of the items."""
    done: dict[int, _Result] = {}
    following = 0
    rows = range(len(items))
    for row, result in side_by_side(lambda row: function(items[row]), rows):
        done[row] = result
        while following in done:
            yield items[following], done.pop(following)
            following += 1


def _processors() -> int:
    """That this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


_Module = TypeVar("_Module", bound=eqx.Module)


def changed(module: _Module, **fields: Any) -> _Module:
    """A module with other values for some of its fields, as they are.

    Nothing is converted or checked again, as by `dataclasses.replace`, and no tree is
    taken apart, as by `equinox.tree_at`: either takes longer than a short fit.
    """
    new = object.__new__(type(module))
    vars(new).update(vars(module), **fields)
    return new
