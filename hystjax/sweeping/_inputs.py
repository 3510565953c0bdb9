"""What a sweep depends on, as fingerprints: equal for equal sweeps in any process."""

import hashlib
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ._program import Lane


def inputs(lane: Lane) -> dict[str, Any]:
    """Fingerprints of the values swept over, of what is shared, and of the function.

    That of the function is of the program JAX makes of it for one lane, so that a
    change anywhere in its code or in what it closes over is seen.
    """
    return {
        "space": _digest(lane.space, repr(jax.tree.structure(lane.space))),
        "shared arguments": _digest(lane.shared),
        "function": _of_function(lane),
    }


def _digest(tree: Any, text: str = "") -> str:
    digest = hashlib.sha256(text.encode())
    for leaf in jax.tree.leaves(eqx.filter(tree, eqx.is_array)):
        _add(digest, leaf)
    return digest.hexdigest()


def _of_function(lane: Lane) -> str:
    arrays, static = eqx.partition(lane, eqx.is_array)

    def one(arrays, index):
        return eqx.combine(arrays, static)(index)

    lowered = jax.jit(one).lower(arrays, jnp.array(0))
    return hashlib.sha256(lowered.as_text().encode()).hexdigest()


def _add(digest, leaf) -> None:
    if jnp.issubdtype(leaf.dtype, jax.dtypes.prng_key):
        leaf = jax.random.key_data(leaf)
    array = np.asarray(leaf)
    digest.update(f"{array.dtype} {array.shape}".encode())
    digest.update(np.ascontiguousarray(array).tobytes())
