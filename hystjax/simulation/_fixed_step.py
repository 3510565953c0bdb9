"""The fast way: classical Runge-Kutta steps on the sample grid."""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp

from .._errors import InputError
from .._solution import RESULTS, outcome
from ..interpolation import Grid
from ..models import AbstractModel
from ._base import AbstractSimulation


class FixedStep(AbstractSimulation):
    """Runge-Kutta of fourth order with a fixed number of steps a sample interval.

    Jumps of du/dt fall between steps, so they cost no accuracy. There is no error
    control: for fitting, sweeps and well-sampled records.

    **Attributes:**

    - `substeps`: steps a sample interval; inputs that are smooth between samples need
        at least 2, one before and one after a turning point.
    """

    substeps: int = eqx.field(static=True, default=2)

    def __check_init__(self):
        if self.substeps < 1:
            raise InputError(f"`substeps` must be at least 1, got {self.substeps}.")

    def integrate(self, model, path, w0, scale):
        if self.substeps < 2 and not path.kinked:
            raise InputError(
                "`FixedStep(substeps=1)` cannot step around the turning points of an "
                "input that is smooth between samples; use `substeps=2` or more."
            )
        states = march(
            model, model.start(w0, path.samples()[0][0]), path.grid(self.substeps)
        )
        states = jax.tree.map(lambda leaf: leaf[:: self.substeps], states)
        w = model.observe(path.t, states)
        result = outcome(jnp.all(jnp.isfinite(w)), RESULTS.diverged)
        return (
            w,
            result,
            {"num_steps": jnp.array(self.substeps * (path.t.shape[0] - 1))},
        )


def march(
    model: AbstractModel,
    start: Any,
    grid: Grid,
    correct: Callable[[Any, Any], Any] | None = None,
    rows: Any = None,
) -> Any:
    """States at the start and after every step of a grid of m steps, by the classical
    Runge-Kutta method; a PyTree with leading axis m + 1.

    **Arguments:** `correct` changes the state that a step starts from; it is called
    with the state and that step's row of `rows`, a PyTree with leading axis m. What is
    returned are the states before.
    """

    def next_state(state, inputs):
        step, row = inputs
        state = advance(model, state, step, row, correct)
        return state, state

    _, later = jax.lax.scan(next_state, start, (grid, rows))
    return jax.tree.map(
        lambda first, rest: jnp.concatenate([first[None], rest]), start, later
    )


def advance(
    model: AbstractModel,
    state: Any,
    step: Grid,
    row: Any = None,
    correct: Callable[[Any, Any], Any] | None = None,
) -> Any:
    """The state after one step of a grid, corrected before it as in `march`."""
    start = state if correct is None else correct(state, row)
    return _runge_kutta(model.rate, start, *step)


def _runge_kutta(rate, state, step, u, du):
    def moved(slope, time):
        return jax.tree.map(lambda x, dx: x + time * dx, state, slope)

    k1 = rate(state, u[0], du[0])
    k2 = rate(moved(k1, step / 2), u[1], du[1])
    k3 = rate(moved(k2, step / 2), u[1], du[1])
    k4 = rate(moved(k3, step), u[2], du[2])
    total = jax.tree.map(lambda a, b, c, d: a + 2 * (b + c) + d, k1, k2, k3, k4)
    return moved(total, step / 6)
