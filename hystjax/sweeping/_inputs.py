"""What a sweep depends on, as fingerprints: equal for equal sweeps in any process."""

import hashlib
from collections.abc import Iterator
from importlib.metadata import version as installed
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .._errors import InputError
from ._program import Lane

_HOST_CALLS = ("pure_callback", "io_callback")
# Of these a name and a release say all: what they compute with, they are given.
_KNOWN = ("equinox._errors", "hystjax")


def inputs(lane: Lane, version: str | None = None) -> dict[str, str]:
    """Fingerprints of the values swept over, of what is shared, and of the function;
    and the caller's word on the version of what no fingerprint sees.

    That of the function is of the program JAX makes of it for one lane, so that a
    change anywhere in its code or in what it closes over is seen. Python code which
    that program calls on the host is seen by name alone.

    **Raises:** `InputError` when such code is the caller's own and has no `version`.
    """
    return {
        "space": _digest(lane.space, repr(jax.tree.structure(lane.space))),
        "shared arguments": _digest(lane.shared),
        "function": _of_function(lane, version),
        "version": version or "",
    }


def _digest(tree: Any, text: str = "") -> str:
    digest = hashlib.sha256(text.encode())
    for leaf in jax.tree.leaves(eqx.filter(tree, eqx.is_array)):
        _add(digest, leaf)
    return digest.hexdigest()


def _of_function(lane: Lane, version: str | None) -> str:
    arrays, static = eqx.partition(lane, eqx.is_array)

    def one(arrays, index):
        return eqx.combine(arrays, static)(index)

    traced = jax.jit(one).trace(arrays, jnp.array(0))
    texts = [traced.lower().as_text()]
    texts += [_named(call, version) for call in _host_calls(traced.jaxpr)]
    return hashlib.sha256("\n".join(texts).encode()).hexdigest()


def _host_calls(jaxpr) -> Iterator[Any]:
    """The Python functions that a program calls and whose results it uses."""
    for equation in jaxpr.eqns:
        if equation.primitive.name in _HOST_CALLS:
            callback = equation.params["callback"]
            yield getattr(callback, "callback_func", callback)
        for inner in jax.tree.leaves(list(equation.params.values())):
            if hasattr(inner, "eqns"):
                yield from _host_calls(inner)


def _named(function: Any, version: str | None) -> str:
    module = getattr(function, "__module__", None) or ""
    name = f"{module}.{getattr(function, '__qualname__', type(function).__qualname__)}"
    if any(f"{module}.".startswith(f"{known}.") for known in _KNOWN):
        return f"{name} {installed(module.partition('.')[0])}"
    if not version:
        raise InputError(
            f"`function` calls Python code on the host (`{name}`), whose changes no "
            "fingerprint sees: `out` would go on with numbers of older code. Give "
            "`version`, any word, and another one whenever that code, or what it "
            "reads, changes."
        )
    return name


def _add(digest, leaf) -> None:
    if jnp.issubdtype(leaf.dtype, jax.dtypes.prng_key):
        leaf = jax.random.key_data(leaf)
    array = np.asarray(leaf)
    digest.update(f"{array.dtype} {array.shape}".encode())
    digest.update(np.ascontiguousarray(array).tobytes())
