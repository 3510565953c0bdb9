"""The fast way: classical Runge-Kutta steps on the sample grid.

A loop differentiated as a whole is slow, forwards and far more so backwards: every
intermediate of every step is kept. But once the states are known, the derivatives of
the single steps need not wait for each other: they are found side by side, and only
passed on by a loop of one small product a step.
"""

from abc import abstractmethod
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float

from .._core import checks
from .._core.checks import InputError
from .._core.compiling import jit
from .._core.solution import RESULTS, outcome
from ..library import at, sampled
from ..models import AbstractModel, Leg
from ..models._numbers import numbers
from ..signals import AbstractInputPath, Grid, Signals


class AbstractSimulation(eqx.Module):
    """Integrates a model along an input path."""

    @property
    def otherwise(self) -> "AbstractSimulation | None":
        """What to try where this way ends as `inaccurate` or `diverged`, if
        anything."""
        return None

    @abstractmethod
    def integrate(
        self,
        model: AbstractModel,
        path: AbstractInputPath,
        w0: Float[Array, ""],
        scale: Float[Array, ""],
    ) -> tuple[Float[Array, " n"], RESULTS, dict]:
        """The output at the path's sample times.

        **Arguments:** the law, the input, the output at the first sample time, and the
        output's order of magnitude (output units).

        **Returns:** w of shape (n,), how it ended, and statistics.
        """


Step = Callable[[Any, Any, Any], Any]


def march(advance: Step, model: Any, x: Any, rows: Any) -> Any:
    """States at the start and after each of m steps, a PyTree of arrays with leading
    axis m + 1.

    **Arguments:**

    - `advance`: the state after a step, of the model, the state before it, and the
        step's row.
    - `model`: any PyTree.
    - `x`: the state at the start, a PyTree of arrays.
    - `rows`: what else each step needs, a PyTree of arrays with leading axis m.
    """
    if not jax.tree.leaves(x):
        return x
    flat, structure = ravel_pytree(x)

    def flat_step(device, state, row):
        return ravel_pytree(advance(device[0], structure(state), row))[0]

    return jax.vmap(structure)(_marched((model,), flat, rows, step=flat_step))


@eqx.filter_custom_jvp
def _marched(device, start, rows, *, step) -> Float[Array, "n d"]:
    def next_state(state, row):
        state = step(device, state, row)
        return state, state

    return from_start(start, jax.lax.scan(next_state, start, rows)[1])


@_marched.def_jvp
def _(primals, tangents, *, step):
    device, start, rows = primals
    d_device, d_start, d_rows = tangents
    path = _marched(device, start, rows, step=step)
    before = path[:-1]

    def along(direction):
        change = jnp.broadcast_to(direction, before.shape)
        steps = lambda states: jax.vmap(step, (None, 0, 0))(device, states, rows)  # noqa: E731
        return jax.jvp(steps, (before,), (change,))[1]

    # Directions go outside and steps inside, for long loops over contiguous memory.
    onward = jax.vmap(along, out_axes=-1)(jnp.eye(len(start), dtype=path.dtype))

    both, changes = (device, rows), (d_device, d_rows)
    moving, still = parted(both, changes)
    added = jnp.zeros_like(before)
    if jax.tree.leaves(moving):

        def steps(moving):
            device, rows = eqx.combine(moving, still)
            return jax.vmap(step, (None, 0, 0))(device, before, rows)

        added = jax.jvp(steps, (moving,), (changes,))[1]
    first = jnp.zeros_like(start) if d_start is None else d_start
    return path, _passed_on(first, onward, added)


def _passed_on(
    first: Float[Array, " d"], onward: Float[Array, "m d d"], added: Float[Array, "m d"]
) -> Float[Array, "n d"]:
    """What becomes of a change over m steps, each of which passes it on and adds to
    it."""

    def chain(change, row):
        onward, added = row
        change = added + jnp.sum(onward * change, axis=-1)
        return change, change

    return from_start(first, jax.lax.scan(chain, first, (onward, added))[1])


def from_start(first: Any, later: Any) -> Any:
    """A first row, and those after it, on a leading axis."""
    return jax.tree.map(lambda a, b: jnp.concatenate([a[None], b]), first, later)


def parted(primals: Any, tangents: Any) -> tuple[Any, Any]:
    """What has a tangent, and what has `None` for one: two PyTrees to be combined."""
    none = lambda leaf: leaf is None  # noqa: E731
    moves = jax.tree.map(lambda leaf: leaf is not None, tangents, is_leaf=none)
    return eqx.partition(primals, moves)


class FixedStep(AbstractSimulation):
    """Runge-Kutta of fourth order with a fixed number of steps a sample interval.

    Jumps of du/dt fall between steps, so they cost no accuracy. There is no error
    control: for fitting, sweeps and well-sampled records.

    The order is lost where a law is not smooth inside a step, as one with |w| where w
    crosses zero: the error then falls with about the square of the step, in leaps. Of
    uneven times the longest steps decide. Errors are 1e-9 to 1e-3 of the output on
    common records, but a law that is unstable makes more of them: 0.11 was seen on
    uneven times, with w crossing zero. To see the error, simulate with twice the
    `substeps` and compare: the difference is almost all of it, and a sixteenth of it is
    left where the order is kept. Where much more is left, use `Adaptive`.

    **Attributes:**

    - `substeps`: steps a sample interval; inputs that are smooth between samples need
        at least 2, one before and one after a turning point.
    """

    substeps: int = eqx.field(static=True, default=2)

    def __check_init__(self):
        if checks.whole("substeps", self.substeps) < 1:
            raise InputError(f"`substeps` must be at least 1, got {self.substeps}.")

    def integrate(self, model, path, w0, scale):
        if self.substeps < path.least_substeps:
            raise InputError(
                "`FixedStep(substeps=1)` cannot step around the turning points of an "
                "input that is smooth between samples; use `substeps=2` or more."
            )
        w = remembered(model, path, w0)
        if w is None:
            x, m = trajectory(model, path, w0, self.substeps)
            w = outputs(model, x, m, path.signals())
        result = outcome(jnp.all(jnp.isfinite(w)), RESULTS.diverged)
        num_steps = jnp.array(self.substeps * (path.t.shape[0] - 1))
        return w, result, {"num_steps": num_steps}


def first_state(
    model: AbstractModel, m: Any, now: Signals, seen: Float[Array, ""]
) -> Any:
    """The flowing state at a first sample, as arrays of floats: a model of one's own
    may make it of plain or of whole numbers, which would not flow."""
    return jax.tree.map(numbers, model.start(m, now, seen))


def remembered(
    model: AbstractModel, path: AbstractInputPath, w0: Float[Array, ""]
) -> Float[Array, " n"] | None:
    """The output at the samples of a path where memory alone makes it, exactly; `None`
    where something flows."""
    signals = path.signals()
    x = first_state(model, model.memory.first(path), at(signals, 0), w0)
    if jax.tree.leaves(x):
        return None
    return model.recorded(signals.t, model.memory.seen(model.output_of(x), path))


def trajectory(
    model: AbstractModel, path: AbstractInputPath, w0: Float[Array, ""], substeps: int
) -> tuple[Any, Any]:
    """The states (x, m) of a device at the samples of a path."""
    grid, m = path.grid(substeps), model.memory.first(path)
    memory = model.memory.along(m, grid)
    x = first_state(model, m, at(path.signals(), 0), w0)
    path_of_x = march(flow, model, x, jax.vmap(model.legs)(memory, grid))
    return at(path_of_x, slice(None, None, substeps)), sampled(memory, substeps)


def outputs(
    model: AbstractModel, x: Any, m: Any, signals: Signals
) -> Float[Array, " n"]:
    """What is recorded of a device in n states, on leading axes, at n times."""
    return model.recorded(signals.t, jax.vmap(model.output)(x, m, signals))


def step(model: AbstractModel, state: tuple[Any, Any], row: Grid) -> tuple[Any, Any]:
    """The state of a device after one step, over which the input is monotone.

    **Arguments:**

    - `model`: the device.
    - `state`: x that flows, and m that the memory keeps.
    - `row`: one step of a grid: its length, and the signals at its start, middle and
        end, scalars.

    **Returns:** the state at the end: m exactly, x by the classical Runge-Kutta method.

    **Source:** Kutta (1901), Zeitschrift für Mathematik und Physik 46, 435-453.
    """
    x, m = state
    middle = model.memory.after(m, row.start, row.middle)
    end = model.memory.after(middle, row.middle, row.end)
    return flow(model, x, model.legs((m, middle, end), row)), end


def flow(model: AbstractModel, x: Any, legs: tuple[Leg, ...]) -> Any:
    """The flowing state after one step, of which the model has told the legs."""
    device = model.flowing
    for leg in legs:
        x = _after_leg(device, x, *leg)
    return x


def _after_leg(model: AbstractModel, x: Any, m: tuple[Any, Any, Any], row: Grid) -> Any:
    """The flowing state after a leg, given the memory at its three stages."""
    first, middle, last = m

    def moved(slope, time):
        return jax.tree.map(lambda x, dx: x + time * dx, x, slope)

    h = row.steps
    x = model.caught_up(x, first, row.start)
    k1 = _rate(model, x, first, row.start)
    k2 = _rate(model, moved(k1, h / 2), middle, row.middle)
    k3 = _rate(model, moved(k2, h / 2), middle, row.middle)
    k4 = _rate(model, moved(k3, h), last, row.end)
    total = jax.tree.map(lambda a, b, c, d: a + 2 * (b + c) + d, k1, k2, k3, k4)
    return moved(total, h / 6)


# A step asks four times: this traces the model once.
@jit
def _rate(model: AbstractModel, x: Any, m: Any, now: Signals) -> Any:
    return model.rate(x, m, now)
