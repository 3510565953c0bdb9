"""The default: Runge-Kutta steps, as many as an estimate of their error asks for."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from .._solution import RESULTS
from ..library import at
from ._adaptive import Adaptive
from ._base import AbstractSimulation
from ._fixed_step import FixedStep, outputs, step
from ._march import from_start

_MOST = 64  # steps a sample interval
_DERIVATIVES = (2, 8, _MOST)  # steps that derivatives are compiled for


class Automatic(AbstractSimulation):
    """Steps of `FixedStep`, twice as many until that changes the output no more.

    The output of some steps a sample interval is compared with that of twice as many.
    The difference is many times the error of the latter, which is returned: 15 times
    where the law is smooth, and 3 times where |w| has kinks. Where 64 steps a sample
    are not enough, as for stiff laws, `otherwise` takes over; under `jit`, `vmap` and
    `grad`, where it cannot, `result` then is `inaccurate`.

    **Attributes:**

    - `rtol`: largest difference over the output's order of magnitude; 1e-7 by default,
        1e-4 in float32.
    - `otherwise`: what takes over.

    **Source:** Runge (1895), doi 10.1007/BF01446807; Richardson (1911),
    doi 10.1098/rsta.1911.0009: estimates of errors by doubled steps.
    """

    rtol: float | None = None
    otherwise: AbstractSimulation = Adaptive.stiff()

    def integrate(self, model, path, w0, scale):
        device = model, path, w0
        rtol = self.rtol or (1e-7 if path.t.dtype == jnp.float64 else 1e-4)
        found = jax.lax.stop_gradient(eqx.filter(device, eqx.is_array))
        fixed = eqx.combine(found, device)
        w, substeps, error = _doubled(*fixed, rtol * scale)
        w = _differentiable(device, w=w, substeps=substeps)
        met, finite = error <= rtol * scale, jnp.all(jnp.isfinite(w))
        result = RESULTS.where(met, RESULTS.successful, RESULTS.inaccurate)  # pyright: ignore
        result = RESULTS.where(finite | ~met, result, RESULTS.diverged)  # pyright: ignore
        num_steps = substeps * (path.t.shape[0] - 1)
        return w, result, {"num_steps": num_steps, "error": error}


def _doubled(model, path, w0, most_error):
    """The output at the first number of steps, least and twice that and so on, that
    changed it by less than allowed; that number, and the change."""
    least = path.least_substeps

    def unfinished(state):
        _, substeps, error = state
        return (error > most_error) & (2 * substeps <= _MOST)

    def again(state):
        coarse, substeps, _ = state
        fine = run(model, path, w0, 2 * substeps)
        return fine, 2 * substeps, _apart(coarse, fine)

    first = run(model, path, w0, jnp.array(least))
    start = again((first, jnp.array(least), jnp.zeros(())))
    return jax.lax.while_loop(unfinished, again, start)


def _apart(coarse: Float[Array, " n"], fine: Float[Array, " n"]) -> Float[Array, ""]:
    """The largest difference of two outputs; none where both are lost at one sample,
    for then it is the law that diverges, and infinite where one is lost."""
    lost = ~jnp.isfinite(coarse), ~jnp.isfinite(fine)
    known = ~(lost[0] | lost[1])
    difference = jnp.max(jnp.abs(jnp.where(known, fine - coarse, 0.0)))
    when = [jnp.where(jnp.any(each), jnp.argmax(each), -1) for each in lost]
    return jnp.where(when[0] == when[1], difference, jnp.inf)


def run(model, path, w0, substeps: Int[Array, ""]) -> Float[Array, " n"]:
    """The output at the samples by so many steps a sample interval: a number that need
    not be known when it is compiled, as that of `FixedStep` must."""
    signals = path.signals()
    m = model.memory.first(path)
    state = model.start(m, at(signals, 0), w0), m
    intervals = path.intervals()

    def advance(state, interval):
        def once(i, state):
            return step(model, state, path.row(interval, i, substeps))

        state = jax.lax.fori_loop(0, substeps, once, state)
        return state, state

    _, later = jax.lax.scan(advance, state, intervals)
    x, m = from_start(state, later)
    return outputs(model, x, m, signals)


@eqx.filter_custom_jvp
def _differentiable(device: Any, *, w, substeps) -> Float[Array, " n"]:
    """The output `w`, with the derivatives of `FixedStep` by as many steps: loops of
    unknown length have none."""
    return w


@_differentiable.def_jvp
def _(primals, tangents, *, w, substeps):
    (device,), (changes,) = primals, tangents
    moves = jax.tree.map(_is_some, changes, is_leaf=_is_none)
    moving, still = eqx.partition(device, moves)

    def by(count: int):
        def output(moving):
            model, path, w0 = eqx.combine(moving, still)
            method = FixedStep(count)
            return method.integrate(model, path, w0, jnp.ones_like(w0))[0]

        return output

    # Made again on the way back: what is kept of one branch takes its place in all.
    branches = [jax.checkpoint(by(count)) for count in _DERIVATIVES]
    index = jnp.searchsorted(jnp.array(_DERIVATIVES), substeps)

    def output(moving):
        return jax.lax.switch(index, branches, moving)

    return w, jax.jvp(output, (moving,), (changes,))[1]


def _is_some(leaf) -> bool:
    return leaf is not None


def _is_none(leaf) -> bool:
    return leaf is None
