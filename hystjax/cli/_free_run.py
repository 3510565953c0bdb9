"""Judge a law as fast as it allows."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from .._jit import jit
from .._judge import Judgement, judge
from .._recording import Recording
from .._simulate import Trajectory
from ..models import AbstractLaw
from ..refinement import exponents
from ..simulation import Adaptive, FixedStep

_STIFF = 0.5  # change of w' by w over a step: Runge-Kutta is then right to 1e-4


def judged(law: AbstractLaw, recording: Recording) -> Judgement:
    """The fixed-step free run, which compiles quickly; where it is lost, or its steps
    are too long for the law, the adaptive one."""
    method = FixedStep()
    fast = judge(law, recording, method=method)
    pace = float(_pace(law, recording, fast.trajectory)) / method.substeps
    if fast.succeeded and pace < _STIFF:
        return fast
    return judge(law, recording, method=Adaptive())


@jit
def _pace(
    law: AbstractLaw, recording: Recording, trajectory: Trajectory
) -> Float[Array, ""]:
    """By how much of itself a small change of w grows or shrinks in a sample interval,
    at most."""
    u, du = recording.path.samples()
    local, _ = exponents(law, trajectory.t, trajectory.w, u, du)
    return jnp.max(jnp.abs(local[:-1]) * jnp.diff(trajectory.t))
