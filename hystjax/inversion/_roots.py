"""The input at the end of a step that takes the output to a target: one equation in one
unknown, whose slope may jump where the input turns."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

Answer = Callable[[Float[Array, ""]], tuple[Any, Float[Array, ""]]]
"""Of an input: the state it leads to, and how far the output then is off."""

_SECANTS = 3  # after the first two guesses: two digits become twelve
_DOUBLINGS = 32  # of the distance at which an input on the other side is looked for
_HALVINGS = 128  # at most, of which regula falsi needs a dozen


class Step(NamedTuple):
    """What is known before a step.

    **Attributes:** the input `u` there; the lowest and highest input `low` and `high`
    at its end; and `slopes` of the output over the input, upwards and downwards, as of
    the steps before.
    """

    u: Float[Array, ""]
    low: Float[Array, ""]
    high: Float[Array, ""]
    slopes: Float[Array, "2"]


class Found(NamedTuple):
    """An input, the state it leads to, how far the output is off, and the slopes for
    the next step."""

    u: Float[Array, ""]
    state: Any
    off: Float[Array, ""]
    slopes: Float[Array, "2"]


def quick(answer: Answer, step: Step) -> Found:
    """By a few secants from where the input is: enough, where the output is smooth in
    the input as long as this goes one way."""
    _, first = answer(step.u)
    rising = -first * step.slopes[0] > 0
    slope = jnp.where(rising, step.slopes[0], step.slopes[1])
    u, off = step.u, first
    later = jnp.clip(u - _ratio(first, slope), step.low, step.high)
    for _ in range(_SECANTS):
        _, there = answer(later)
        u, off, later = later, there, _secant(step, (u, off), (later, there))
    state, there = answer(later)
    new = _ratio(there - first, later - step.u)
    usable = jnp.isfinite(new) & (new != 0)
    new = jnp.where(usable, new, slope)
    up = later > step.u
    slopes = jnp.stack(
        [
            jnp.where(up, new, step.slopes[0]),
            jnp.where(up, step.slopes[1], new),
        ]
    )
    return Found(later, state, there, slopes)


def _secant(step: Step, before, now) -> Float[Array, ""]:
    (a, off_a), (b, off_b) = before, now
    moved = b - _ratio(off_b * (b - a), off_b - off_a)
    return jnp.clip(moved, step.low, step.high)


def _ratio(a, b):
    """a / b, and 0 for nothing."""
    zero = b == 0
    return jnp.where(zero, 0.0, a / jnp.where(zero, 1.0, b))


def careful(
    answer: Answer, step: Step, tried: Found, first: Any, allowed: Any
) -> Found:
    """By an interval that holds a root, however the output bends and jumps: looked for
    on both sides, twice as far each time, and then made smaller by regula falsi with
    halved weights, and by halves where that is slow.

    Where no input within reach is enough, the one that comes closest.

    **Arguments:** what has been `tried`; a first distance, `first`; and how far the
    output may be off.

    **Source:** Dowell and Jarratt (1971), doi 10.1007/BF01934364.
    """
    u = step.u

    def off(v):
        return answer(v)[1]

    start = off(u)
    better = jnp.abs(tried.off) < jnp.abs(start)  # not where it is NaN
    best = jnp.where(better, tried.u, u), jnp.where(better, tried.off, start)
    size = jnp.where(jnp.isfinite(first) & (first > 0), first, 1.0)
    bracket, best = _bracketed(off, step, start, best, size, allowed)
    v, there = _narrowed(off, bracket, allowed)
    found = jnp.abs(there) < jnp.abs(best[1])
    v = jnp.where(found, v, best[0])
    state, there = answer(v)
    usable = jnp.all(jnp.isfinite(tried.slopes))
    return Found(v, state, there, jnp.where(usable, tried.slopes, step.slopes))


def _bracketed(off, step: Step, start, best, size, allowed):
    """Two inputs with what they are off by, of different signs, where there are such
    within reach: one number after the other, as an array; and the best input met on the
    way, which may be enough."""
    u, low, high = step.u, step.low, step.high

    def apart(state):
        i, _, _, best, worst_of = state
        return (i < _DOUBLINGS) & (jnp.abs(best[1]) > allowed) & (worst_of > 0)

    def wider(state):
        i, inner, outer, best, _ = state
        distance = size * 2.0**i
        ends = jnp.clip(u + jnp.array([-1.0, 1.0]) * distance, low, high)
        offs = jax.vmap(off)(ends)
        crossed = offs * start <= 0
        # Of both sides the one where the output comes to by less of a change.
        side = jnp.where(crossed[0] & crossed[1], _nearer(offs), jnp.argmax(crossed))
        known = inner[1]
        near = (
            jnp.where(jnp.any(crossed), inner[0][side], u),
            jnp.where(jnp.any(crossed), known[side], start),
        )
        far = ends[side], offs[side]
        closer = jnp.argmin(jnp.where(jnp.isfinite(offs), jnp.abs(offs), jnp.inf))
        better = jnp.abs(offs[closer]) < jnp.abs(best[1])
        best = tuple(
            jnp.where(better, new, old)
            for new, old in zip((ends[closer], offs[closer]), best, strict=True)
        )
        still = (ends[0] > low) | (ends[1] < high)
        going = jnp.where(jnp.any(crossed) | ~still, 0, 1)
        bracket = jnp.stack([near[0], near[1], far[0], far[1]])
        bracket = jnp.where(jnp.any(crossed), bracket, outer)
        return i + 1, (ends, offs), bracket, best, going

    inner = jnp.stack([u, u]), jnp.stack([start, start])
    unknown = jnp.stack([u, start, u, start])
    begin = jnp.array(0), inner, unknown, best, jnp.array(1)
    _, _, bracket, best, _ = jax.lax.while_loop(apart, wider, begin)
    return bracket, best


def _narrowed(off, bracket: Float[Array, "4"], allowed):
    """An input within a bracket that is nearly a root, and by how much it is off."""

    def wide(state):
        i, a, off_a, b, off_b = state
        close = jnp.minimum(jnp.abs(off_a), jnp.abs(off_b)) <= allowed
        rounding = 4 * jnp.finfo(bracket.dtype).eps * (jnp.abs(a) + jnp.abs(b))
        return (i < _HALVINGS) & ~close & (jnp.abs(b - a) > rounding)

    def smaller(state):
        i, a, off_a, b, off_b = state
        straight = b - _ratio(off_b * (b - a), off_b - off_a)
        middle = (a + b) / 2
        inside = (straight - a) * (straight - b) < 0
        # Every third by halves: a jump would make the others crawl.
        v = jnp.where(inside & (i % 3 < 2), straight, middle)
        there = off(v)
        across = there * off_b <= 0
        # The end that stays counts half, so that the next secant passes the root.
        a, off_a = jnp.where(across, b, a), jnp.where(across, off_b, 0.5 * off_a)
        return i + 1, a, off_a, v, there

    _, _, _, v, there = jax.lax.while_loop(wide, smaller, (jnp.array(0), *bracket))
    return v, there


def _nearer(offs):
    return jnp.argmin(jnp.abs(offs))
