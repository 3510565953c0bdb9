"""Judge a law by free run."""

from typing import Any

import equinox as eqx
from jaxtyping import Array, ArrayLike

from . import metrics
from ._jit import jit
from ._recording import Recording
from ._simulate import Trajectory, simulate
from ._solution import RESULTS
from .models import AbstractModel, AbstractSequenceModel
from .simulation import AbstractSimulation, Automatic


class Judgement(eqx.Module):
    """How well a law reproduces a recording from its initial value alone.

    **Attributes:**

    - `recording`: the recording, of n samples.
    - `trajectory`: the free run; `trajectory.result` tells whether it diverged.
    - `errors`: scalars by name: `nrmse`, `relative_error`, `relative_squared_error` and
        `r2` as ratios, `rmse` and `max_error` in output units. Not finite for a law
        that diverges.
    """

    recording: Recording
    trajectory: Trajectory
    errors: dict[str, Array]

    @property
    def succeeded(self) -> bool:
        """Whether the free run reached the end. Concrete judgements only."""
        return bool(self.trajectory.result == RESULTS.successful)


def judge(
    model: AbstractModel | AbstractSequenceModel,
    recording: Recording,
    *,
    w0: ArrayLike | None = None,
    method: AbstractSimulation = Automatic(),
) -> Judgement:
    """Simulate a law along a recording and measure how far it gets from it.

    Judge on rows that the law was not fitted on: errors on its own rows flatter it.

    **Arguments:** as `simulate`. A law that diverges does not raise.

    **Returns:** a `Judgement`.
    """
    trajectory = simulate(model, recording, w0=w0, method=method, throw=False)
    return Judgement(recording, trajectory, _errors(recording.w, trajectory.w))


@jit
def _errors(w, w_hat) -> dict[str, Any]:
    measures = (
        metrics.nrmse,
        metrics.relative_error,
        metrics.relative_squared_error,
        metrics.r2,
        metrics.rmse,
        metrics.max_error,
    )
    return {measure.__name__: measure(w, w_hat) for measure in measures}
