"""What a lane returns, as named arrays."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.tree_util import DictKey, GetAttrKey, SequenceKey, tree_flatten_with_path
from jaxtyping import Array

from .._solution import RESULTS, Solution, outcome
from ..models import AbstractModel, SparseModel

RESULT = "result"
_NONFINITE: Any = RESULTS.nonfinite
_Item = type(RESULTS.successful)


class Variable(eqx.Module):
    """A named array of a lane.

    **Attributes:**

    - `values`: of any shape.
    - `dims`: names of its axes, or none for unnamed ones.
    - `labels`: of its last axis.
    """

    values: Array
    dims: tuple[str, ...] = eqx.field(static=True, default=())
    labels: tuple[str, ...] = eqx.field(static=True, default=())


def variables(output: Any) -> dict[str, Variable]:
    """The arrays of what a lane returned, by name, and how it ended as `result`.

    Of a `Solution` these are the coefficients and support of a `SparseModel`, or else
    the parameters of its model, and those of `stats` that are numbers or vectors, alone
    or in a dictionary. Of anything else they are all arrays in it, named by where they
    are. What does not say how it ended has succeeded if all its numbers are finite.
    """
    if isinstance(output, Solution):
        found = _of_value(output.value) | _of_stats(output.stats)
        return found | {RESULT: _code(output.result)}
    found = _of_tree(output)
    if RESULT not in found:
        floats = [v.values for v in found.values() if eqx.is_inexact_array(v.values)]
        finite = jnp.all(jnp.array([jnp.all(jnp.isfinite(each)) for each in floats]))
        found[RESULT] = _code(outcome(finite, _NONFINITE))
    return found


def _of_value(value: Any) -> dict[str, Variable]:
    if isinstance(value, SparseModel):
        terms = ("term",), value.library.names
        return {
            "coefficients": Variable(jnp.asarray(value.coefficients), *terms),
            "support": Variable(jnp.asarray(value.support), *terms),
        }
    return _of_tree(value.parameters() if isinstance(value, AbstractModel) else value)


def _of_stats(stats: dict[str, Any]) -> dict[str, Variable]:
    plain = {k: v for k, v in stats.items() if eqx.is_array(v) or isinstance(v, dict)}
    found = _of_tree(plain)
    return {name: each for name, each in found.items() if each.values.ndim < 2}


def _of_tree(tree: Any) -> dict[str, Variable]:
    leaves, _ = tree_flatten_with_path(tree, is_leaf=_is_result)
    return {
        ".".join(map(_key, path)) or "value": _leaf(leaf)
        for path, leaf in leaves
        if _is_result(leaf) or eqx.is_array_like(leaf)
    }


def _leaf(leaf: Any) -> Variable:
    return _code(leaf) if _is_result(leaf) else Variable(jnp.asarray(leaf))


def _code(result: Any) -> Variable:
    known = result._enumeration is RESULTS
    return Variable(jnp.asarray((result if known else RESULTS.promote(result))._value))


def _is_result(leaf: Any) -> bool:
    return isinstance(leaf, _Item)


def _key(key: Any) -> str:
    match key:
        case DictKey():
            return str(key.key)
        case GetAttrKey():
            return key.name
        case SequenceKey():
            return str(key.idx)
    return jax.tree_util.keystr((key,))
