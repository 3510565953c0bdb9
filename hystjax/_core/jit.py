"""Compiling for calls that are made once, from Python."""

import functools
from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar

import equinox as eqx
import jax

from .checks import is_concrete

_Inputs = ParamSpec("_Inputs")
_Output = TypeVar("_Output")

# With the older emitters of XLA for CPUs, programs such as that of `refine` compile in
# half the time and run as fast. Other devices ignore it.
_QUICKER = {"xla_cpu_use_fusion_emitters": False}


def jit(function: Callable[_Inputs, _Output]) -> Callable[_Inputs, _Output]:
    """`equinox.filter_jit` that compiles quickly where it is called from Python.

    Inside of `jit`, `grad` and the like it is what `filter_jit` is: how a program is
    compiled is said where it begins.
    """

    @functools.wraps(function)
    def traced(*args: _Inputs.args, **kwargs: _Inputs.kwargs) -> _Output:
        # The mesh in use, named: unnamed, JAX takes it for another one than inside of
        # loops, and traces again there what it has traced already.
        with jax.sharding.use_abstract_mesh(jax.sharding.get_abstract_mesh()):
            return function(*args, **kwargs)

    plain = eqx.filter_jit(traced)
    options: Any = {"compiler_options": _QUICKER}  # not in its overloads
    quick = eqx.filter_jit(traced, **options)

    @functools.wraps(function)
    def call(*args: _Inputs.args, **kwargs: _Inputs.kwargs) -> _Output:
        alone = is_concrete(*jax.tree.leaves((args, kwargs))) and not _inside()
        return (quick if alone and _known() else plain)(*args, **kwargs)

    return call


def _inside() -> bool:
    """Whether what is computed here, of constants too, becomes part of a program."""
    return not is_concrete(jax.lax.neg(0.0))


@functools.cache
def _known() -> bool:
    """Whether this version of XLA has the options, which name its inner parts."""

    def nothing(x: Any):
        return x

    try:
        jax.jit(nothing, compiler_options=_QUICKER).lower(0.0).compile()
    except jax.errors.JaxRuntimeError:
        return False
    return True
