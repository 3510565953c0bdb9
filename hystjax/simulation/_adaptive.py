"""The reference: Diffrax with error control."""

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx

from .._core.errors import InputError
from .._core.solution import RESULTS
from ..library import Track, at
from ..signals import Signals
from ._base import AbstractSimulation
from ._fixed_step import outputs

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

    def __check_init__(self):
        for name in ("rtol", "atol"):
            value = getattr(self, name)
            if value is not None and not 0 < value < np.inf:
                raise InputError(
                    f"`{name}` must be positive and finite, or None for the default; "
                    f"got {value}."
                )

    @classmethod
    def stiff(cls) -> "Adaptive":
        """With an implicit solver, for laws whose output settles much faster than it is
        sampled; to 1e-8, which takes fewer steps than the default."""
        # Diffrax's own root finder asks that iterates approach each other faster and
        # faster, which those of a step clipped to almost nothing do not: they differ by
        # rounding. Steps then shrink without end.
        chord = diffrax.with_stepsize_controller_tols(optx.Chord)()
        return cls(diffrax.Kvaerno5(root_finder=chord), rtol=1e-8)

    def integrate(self, model, path, w0, scale):
        track, signals = Track(model.memory, path), path.signals()
        x = model.start(track.at(path.t[0]), at(signals, 0), w0)
        if jax.tree.leaves(x):
            x, result, num_steps = self._flow(model, track, x, scale)
        else:  # all that it remembers is exact
            result, num_steps = RESULTS.successful, jnp.array(0)
        w = outputs(model, x, jax.vmap(track.at)(path.t), signals)
        lost = (result == RESULTS.event_occurred) | ~jnp.all(jnp.isfinite(w))
        known = result == RESULTS.max_steps_reached
        result = RESULTS.where(lost & ~known, RESULTS.diverged, result)  # pyright: ignore
        return w, result, {"num_steps": num_steps}

    def _flow(self, model, track: Track, x, scale):
        """The flowing state at the samples, how it ended, and the number of steps."""
        path = track.path
        t = path.t
        rtol = self.rtol or (1e-9 if t.dtype == jnp.float64 else 1e-5)

        def field(time, x, _):
            return model.rate(x, track.at(time), Signals(time, *path.at(time)))

        solution = diffrax.diffeqsolve(
            diffrax.ODETerm(field),
            self.solver,
            t0=t[0],
            t1=t[-1],
            dt0=t[1] - t[0],
            y0=x,
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
        result = RESULTS.promote(solution.result)
        return solution.ys, result, solution.stats["num_steps"]


def _lost(t, state, args, **_):
    """Whether the state has left the numbers that can be squared: on the way to inf,
    the solver would reject ever shorter steps instead of getting there."""
    leaves = [
        jnp.all(jnp.abs(leaf) < jnp.sqrt(jnp.finfo(leaf.dtype).max))
        for leaf in jax.tree.leaves(state)
    ]
    return ~jnp.all(jnp.stack(leaves))
