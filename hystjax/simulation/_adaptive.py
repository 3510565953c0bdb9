"""The reference: Diffrax with error control."""

import diffrax
import jax
import jax.numpy as jnp

from .._solution import RESULTS
from ._base import AbstractSimulation

_STEPS_A_SAMPLE = 64


class Adaptive(AbstractSimulation):
    """Any Diffrax solver; adaptive steps that end at samples and at jumps of the input.

    **Attributes:**

    - `solver`: a Diffrax solver, `Tsit5()` by default; `Kvaerno5()` for stiff laws.
    - `rtol`: relative tolerance; 1e-9 by default, 1e-5 in float32.
    - `atol`: absolute tolerance in output units; by default `rtol` times the output's
        order of magnitude.
    - `adjoint`: a Diffrax adjoint, for derivatives.
    """

    solver: diffrax.AbstractSolver = diffrax.Tsit5()
    rtol: float | None = None
    atol: float | None = None
    adjoint: diffrax.AbstractAdjoint = diffrax.RecursiveCheckpointAdjoint()

    def integrate(self, model, path, w0, scale):
        t = path.t
        rtol = self.rtol or (1e-9 if t.dtype == jnp.float64 else 1e-5)

        def field(time, state, _):
            u, du = path.at(time)
            return model.rate(state, u, du)

        solution = diffrax.diffeqsolve(
            diffrax.ODETerm(field),
            self.solver,
            t0=t[0],
            t1=t[-1],
            dt0=t[1] - t[0],
            y0=model.start(w0, path.samples()[0][0]),
            saveat=diffrax.SaveAt(ts=t),
            stepsize_controller=diffrax.ClipStepSizeController(
                diffrax.PIDController(
                    rtol=rtol,
                    atol=rtol * scale if self.atol is None else self.atol,
                    # Steps are clipped to stops, by chance to almost nothing: the
                    # next one must then be taken all the same.
                    dtmin=16 * jnp.finfo(t.dtype).eps * jnp.max(jnp.abs(t)),
                    force_dtmin=True,
                ),
                # Steps end at every sample, where the output is asked for: between
                # steps it would be interpolated at a lower order.
                step_ts=None if path.kinked else t,
                jump_ts=path.jumps(),
            ),
            event=diffrax.Event(_lost),
            adjoint=self.adjoint,
            max_steps=4096 + _STEPS_A_SAMPLE * t.shape[0],
            throw=False,
        )
        w = model.observe(t, solution.ys)
        result = RESULTS.promote(solution.result)
        lost = (result == RESULTS.event_occurred) | ~jnp.all(jnp.isfinite(w))
        known = result == RESULTS.max_steps_reached
        result = RESULTS.where(lost & ~known, RESULTS.diverged, result)
        return w, result, {"num_steps": solution.stats["num_steps"]}


def _lost(t, state, args, **_):
    """Whether the state has left the numbers that can be squared: on the way to inf,
    the solver would reject ever shorter steps instead of getting there."""
    leaves = [
        jnp.all(jnp.abs(leaf) < jnp.sqrt(jnp.finfo(leaf.dtype).max))
        for leaf in jax.tree.leaves(state)
    ]
    return ~jnp.all(jnp.stack(leaves))
