"""Ways to simulate: classical Runge-Kutta steps on the sample grid, which is fast; and
steps by an estimate of their error: Diffrax, the reference, and the default, which
takes fixed steps, and more where too few.

A loop differentiated as a whole is slow, forwards and far more so backwards: every
intermediate of every step is kept. But once the states are known, the derivatives of
the single steps need not wait for each other: they are found side by side, and only
passed on by a loop of one small product a step.
"""

from abc import abstractmethod
from collections.abc import Callable
from functools import partial
from typing import Any

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, ArrayLike, Bool, Float, Int

from .._core import checks
from .._core.checks import InputError
from .._core.compiling import jit
from .._core.solution import RESULTS, outcome
from ..library import Track, at, sampled
from ..models import AbstractModel, Leg
from ..models._numbers import floats
from ..signals import AbstractInputPath, Grid, Signals


class AbstractSimulation(eqx.Module):
    """Integrates a model along an input path."""

    @property
    def otherwise(self) -> "AbstractSimulation | None":
        """What to try where this way ends as `inaccurate` or `diverged`, if
        anything."""
        return None

    @property
    def parts(self) -> "tuple[AbstractSimulation, ...]":
        """What it is made of, each to be tried where the one before ends as
        `inaccurate` or `diverged`: shorter programs than the whole, of which most runs
        compile the first alone."""
        return (self,)

    @property
    def scaled(self) -> bool:
        """Whether it looks at the output's order of magnitude."""
        return False

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

    substeps: int = eqx.field(
        converter=partial(checks.count, "substeps"), static=True, default=2
    )

    def integrate(self, model, path, w0, scale):
        if self.substeps < path.least_substeps:
            raise InputError(
                "`FixedStep(substeps=1)` cannot step around the turning points of an "
                "input that is smooth between samples; use `substeps=2` or more."
            )
        w, num_steps = remembered(model, path, w0), 0
        if w is None:
            x, m = trajectory(model, path, w0, self.substeps)
            w = outputs(model, x, m, path.signals())
            num_steps = self.substeps * (path.t.shape[0] - 1)
        result = outcome(_finite(path, w), RESULTS.diverged)
        return w, result, {"num_steps": jnp.array(num_steps)}


def _finite(path: AbstractInputPath, w: Float[Array, " n"]) -> Bool[Array, ""]:
    """Whether nothing of a run is lost: plays take no notice of an input that is
    NaN."""
    return jnp.all(jnp.isfinite(w)) & jnp.all(jnp.isfinite(path.samples()[0]))


def first_state(
    model: AbstractModel, m: Any, now: Signals, seen: Float[Array, ""]
) -> Any:
    """The flowing state at a first sample, as arrays of the floats that outputs are: a
    model of one's own may make it of plain or of whole numbers, and one that was saved
    in single precision of its own, which would not flow in double."""

    def as_outputs(leaf):
        leaf = floats(leaf)
        return leaf.astype(jnp.result_type(leaf, seen))

    return jax.tree.map(as_outputs, model.start(m, now, seen))


def flows(model: AbstractModel) -> bool:
    """Whether some of its state flows, which starts as the first output tells; where
    memory is all of it, nothing looks at that output."""
    zero = jnp.zeros(())
    now = Signals(zero, zero, zero)

    def start(model):
        return model.start(model.memory.start(now), now, zero)

    return bool(jax.tree.leaves(eqx.filter_eval_shape(start, model)))


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


_STEPS_A_SAMPLE = 64
_BACKWARDS = diffrax.RecursiveCheckpointAdjoint()


def _check_tolerance(name: str, value: Any) -> None:
    """Raise `InputError` for what is no positive number, and is given for one."""
    if value is None or not checks.is_concrete(value):
        return
    known = np.asarray(value)  # an array of JAX would be made while we are imported
    if known.dtype.kind not in "iuf" or known.ndim or not 0 < known < np.inf:
        raise InputError(
            f"`{name}` must be positive and finite, or None for the default; got "
            f"{checks.described(value)}."
        )


class Adaptive(AbstractSimulation):
    """Any Diffrax solver; adaptive steps that end at samples and at jumps of the input.

    **Attributes:**

    - `solver`: a Diffrax solver, `Tsit5()` by default; `Kvaerno5()` for stiff laws.
    - `rtol`: relative tolerance; 1e-9 by default, 1e-5 in float32.
    - `atol`: absolute tolerance in output units; by default `rtol` times the output's
        order of magnitude. Under `jit`, `vmap` and `grad` that is the recording's, or
        of a path that of the first output, and 1 where this is 0.
    - `adjoint`: a Diffrax adjoint, for derivatives. By default, in reverse mode only,
        sensitivities to up to 128 numbers are integrated beside the state; for more,
        such as the samples of an input, it is `RecursiveCheckpointAdjoint()`, which
        takes twice as long to compile and several times as long to run. Where a rate
        jumps inside of steps, as of a device behind a play, derivatives are those of
        `FixedStep`, as of `Automatic`: adjoints take the jump to stay where it is. For
        forward mode give `diffrax.ForwardMode()`. None is right by times of samples.
    """

    solver: diffrax.AbstractSolver = diffrax.Tsit5()
    rtol: float | None = None
    atol: float | None = None
    adjoint: diffrax.AbstractAdjoint | None = None

    def __check_init__(self):
        checks.kind("solver", self.solver, diffrax.AbstractSolver, "diffrax.Kvaerno5()")
        for name in ("rtol", "atol"):
            _check_tolerance(name, getattr(self, name))

    @property
    def scaled(self):
        return self.atol is None

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
        device = model, path, w0, scale
        if self.adjoint is not None:
            return self.solved(device, self.adjoint)
        if not _cut(model, path):
            return _solved(device, self)
        w, *others = self.solved(_constant(device), _BACKWARDS)
        return _differentiable((model, path, w0), w=w), *others

    def solved(self, device, adjoint: diffrax.AbstractAdjoint):
        """What `integrate` returns, with derivatives by an adjoint."""
        model, path, w0, scale = device
        track, signals = Track(model.memory, path), path.signals()
        x = first_state(model, track.at(path.t[0]), at(signals, 0), w0)
        if jax.tree.leaves(x):
            x, result, num_steps = self._flow(model, track, x, scale, adjoint)
        else:  # all that it remembers is exact
            result, num_steps = RESULTS.successful, jnp.array(0)
        w = outputs(model, x, jax.vmap(track.at)(path.t), signals)
        lost = (result == RESULTS.event_occurred) | ~_finite(path, w)
        known = result == RESULTS.max_steps_reached
        result = RESULTS.where(lost & ~known, RESULTS.diverged, result)  # pyright: ignore
        return w, result, {"num_steps": num_steps}

    def _flow(self, model, track: Track, x, scale, adjoint):
        """The flowing state at the samples, how it ended, and the number of steps."""
        path = track.path
        t = path.t - path.t[0]  # in which short steps are exact, whatever the clock

        # Diffrax takes no state with empty parts, which a flat one has not.
        leaves, structure = jax.tree.flatten(x)

        def field(elapsed, leaves, _):
            x = structure.unflatten(leaves)
            return jax.tree.leaves(model.rate(x, *track.at_elapsed(elapsed)))

        def caught_up(elapsed, leaves):
            x, elapsed = structure.unflatten(leaves), jnp.asarray(elapsed)
            return jax.tree.leaves(model.caught_up(x, *track.at_elapsed(elapsed)))

        solution = diffrax.diffeqsolve(
            diffrax.ODETerm(field),
            _CatchingUp(self.solver, caught_up),
            t0=t[0],
            t1=t[-1],
            dt0=t[1] - t[0],
            y0=leaves,
            saveat=diffrax.SaveAt(ts=t),
            stepsize_controller=self._controller(path, t, scale),
            event=diffrax.Event(_lost),
            adjoint=adjoint,
            max_steps=4096 + _STEPS_A_SAMPLE * t.shape[0],
            throw=False,
        )
        result = RESULTS.promote(solution.result)
        x = structure.unflatten(solution.ys)
        return x, result, solution.stats["num_steps"]

    def _controller(self, path, t, scale) -> diffrax.AbstractStepSizeController:
        """How long steps are, with the samples at times `t` since the first."""
        usual = 1e-9 if t.dtype == jnp.float64 else 1e-5
        rtol = usual if self.rtol is None else self.rtol
        by_error = diffrax.PIDController(
            rtol=rtol,
            atol=rtol * scale if self.atol is None else self.atol,
            # Steps are clipped to stops, by chance to almost nothing: the next one must
            # then be taken all the same. Functions of time and what lags see the clock,
            # and nothing of steps that it rounds.
            dtmin=16 * jnp.finfo(t.dtype).eps * jnp.max(jnp.abs(path.t)),
            force_dtmin=True,
        )
        return diffrax.ClipStepSizeController(
            by_error,
            # Steps end at every sample, where the output is asked for: between steps it
            # would be interpolated at a lower order.
            step_ts=None if path.kinked else t,
            jump_ts=path.jumps() - path.t[0],
        )


def _constant(device: Any) -> Any:
    """The same without derivatives."""
    found = jax.lax.stop_gradient(eqx.filter(device, eqx.is_array))
    return eqx.combine(found, device)


def _cut(model: AbstractModel, path: AbstractInputPath) -> bool:
    """Whether steps may be cut where a rate jumps."""

    def legs():
        grid = path.grid(path.least_substeps)
        m = model.memory.along(model.memory.first(path), grid)
        return model.legs(at(m, 0), at(grid, 0))

    return len(eqx.filter_eval_shape(legs)) > 1


# Numbers whose sensitivities are integrated beside the state. Of a law of one state 126
# take a third of the time of a loop that is gone through backwards, 252 as long.
_FEW = 128


@eqx.filter_custom_vjp
def _solved(device, method: Adaptive):
    """What a method returns, with derivatives by what there are few of.

    A loop that can be gone through backwards, as many times as it happens to be, holds
    its body several times over, and takes XLA longest of all; sensitivities only make
    its state larger.

    **Source:** Dickinson and Gelinas (1976), doi 10.1016/0021-9991(76)90007-3, for the
    direct method.
    """
    return method.solved(device, _BACKWARDS)


@_solved.def_fwd
def _(perturbed, device, method: Adaptive):
    moving, still = eqx.partition(device, perturbed)
    numbers, natural = ravel_pytree(moving)

    def output(numbers, adjoint):
        device = eqx.combine(natural(numbers), still)
        w, *others = method.solved(device, adjoint)
        return w, others

    if len(numbers) > _FEW:
        by_all = partial(output, adjoint=_BACKWARDS)
        w, back, others = jax.vjp(by_all, numbers, has_aux=True)
        return (w, *others), back
    by_few = partial(output, adjoint=diffrax.ForwardMode())

    def along(direction):
        return jax.jvp(by_few, (numbers,), (direction,), has_aux=True)

    directions = jnp.eye(len(numbers), dtype=numbers.dtype)
    w, columns, others = jax.vmap(along, out_axes=(None, 0, None))(directions)
    return (w, *others), columns


@_solved.def_bwd
def _(kept: Any, changes: Any, perturbed, device, method: Adaptive):
    change = changes[0]
    few = isinstance(kept, jax.Array)
    numbers = kept @ change if few else kept(change)[0]
    _, natural = ravel_pytree(eqx.filter(device, perturbed))
    return natural(numbers)


class _CatchingUp(diffrax.AbstractWrappedSolver):
    """A solver before whose steps a model catches up with what it remembers of itself.
    Its rate is the same before and after that, so that a solver may keep it."""

    solver: diffrax.AbstractSolver
    caught_up: Callable

    @property
    def term_structure(self):
        return self.solver.term_structure

    @property
    def interpolation_cls(self):  # pyright: ignore[reportIncompatibleVariableOverride]
        return self.solver.interpolation_cls

    # Diffrax sets these two of the solver inside.

    @property
    def root_finder(self):
        return self.solver.root_finder  # pyright: ignore[reportAttributeAccessIssue]

    @property
    def scan_kind(self):
        return self.solver.scan_kind  # pyright: ignore[reportAttributeAccessIssue]

    def order(self, terms):
        return self.solver.order(terms)

    def error_order(self, terms):
        return self.solver.error_order(terms)

    def init(self, terms, t0, t1, y0, args):
        return self.solver.init(terms, t0, t1, y0, args)

    def step(self, terms, t0, t1, y0, args, solver_state, made_jump):
        y0 = self.caught_up(t0, y0)
        return self.solver.step(terms, t0, t1, y0, args, solver_state, made_jump)

    def func(self, terms, t0, y0, args):
        return self.solver.func(terms, t0, y0, args)


def _lost(t, state, args, **_):
    """Whether the state has left the numbers that can be squared: on the way to inf,
    the solver would reject ever shorter steps instead of getting there."""
    leaves = [
        jnp.all(jnp.abs(leaf) < jnp.sqrt(jnp.finfo(leaf.dtype).max))
        for leaf in jax.tree.leaves(state)
    ]
    return ~jnp.all(jnp.stack(leaves))


_MOST = 64  # steps a sample interval
_CLOSE = 1e-6  # share of the output by which theirs may be off
_DERIVATIVES = (2, 8, _MOST)  # steps that derivatives are compiled for


class Automatic(AbstractSimulation):
    """Steps of `FixedStep`, twice as many until that changes the output no more.

    The output of some steps a sample interval is compared with that of twice as many.
    The difference is many times the error of the latter, which is returned. Steps end
    where |w| has its kinks, which would cost that accuracy. Where 64 steps a sample
    are not enough, as for stiff laws, or the output is lost, `otherwise` takes over,
    with its own derivatives; under `jit` and `vmap`, where it cannot, `result` then is
    `inaccurate` or `diverged`. Where `otherwise` fails, as with a force that chatters
    about its limit, an output that is known to a hundredth is kept, as `inaccurate`.

    Derivatives are those of `FixedStep` by the fewest of 2, 8 or 64 steps a sample
    whose output is within 1e-6. Where a coarsely sampled |w| goes through 0 their error
    falls with the step only: some 1e-3 of a derivative with a dozen samples a cycle.

    **Attributes:**

    - `rtol`: largest difference over the largest output; 1e-7 by default, 1e-4 in
        float32.
    - `otherwise`: what takes over, by default to some 1e-6 of the output; `None` for
        nothing.

    **Source:** Runge (1895), doi 10.1007/BF01446807; Richardson (1911),
    doi 10.1098/rsta.1911.0009: estimates of errors by doubled steps.
    """

    rtol: float | None = None
    otherwise: AbstractSimulation | None = Adaptive.stiff()

    def __check_init__(self):
        _check_tolerance("rtol", self.rtol)
        if self.otherwise is not None:
            checks.kind(
                "otherwise", self.otherwise, AbstractSimulation, "simulation.Adaptive()"
            )

    @property
    def parts(self):
        return _Doubled(_plainly, self.rtol), _Doubled(_with_care, self.rtol)

    def integrate(self, model, path, w0, scale):
        return _Doubled(_doubled, self.rtol).integrate(model, path, w0, scale)


class _Doubled(AbstractSimulation):
    """Steps that are doubled, until the output is as well known as is asked.

    **Attributes:**

    - `how`: the output of a model along a path from a first output, the number of steps
        a sample interval, and how far off the output is; given `rtol` as well.
    - `rtol`: as of `Automatic`.
    """

    how: Callable = eqx.field(static=True)
    rtol: float | None = None

    def integrate(self, model, path, w0, scale):
        w = remembered(model, path, w0)
        if w is not None:  # exact
            result = outcome(_finite(path, w), RESULTS.diverged)
            none = {"num_steps": jnp.array(0), "error": jnp.zeros_like(scale)}
            return w, result, none
        device = model, path, w0
        usual = 1e-7 if path.t.dtype == jnp.float64 else 1e-4
        rtol = usual if self.rtol is None else self.rtol
        w, substeps, error = self.how(*_constant(device), rtol=rtol)
        w = _differentiable(device, w=w)
        met, finite = _known(error, w, rtol), _finite(path, w)
        result = RESULTS.where(met, RESULTS.successful, RESULTS.inaccurate)  # pyright: ignore
        result = RESULTS.where(finite, result, RESULTS.diverged)  # pyright: ignore
        num_steps = substeps * (path.t.shape[0] - 1)
        return w, result, {"num_steps": num_steps, "error": error}


def _size(w: Float[Array, " n"]) -> Float[Array, ""]:
    return jnp.max(jnp.abs(w))


def _known(error, w, rtol) -> Bool[Array, ""]:
    """Whether an output is as well known as is asked; never one that is lost, of which
    a share is infinite, too."""
    return (error <= rtol * _size(w)) & jnp.isfinite(error)


def _doubled(model, path, w0, rtol):
    """The output at the first number of steps, least and twice that and so on, that
    changed it by less than allowed; that number, and the change.

    Most records need no care for kinks: first come steps without, whose loops have
    nothing else inside, and which take a fraction of the time.
    """
    w, _, error = plain = _plainly(model, path, w0, rtol)
    enough = _known(error, w, rtol)
    careful = _with_care(model, path, w0, rtol, ~enough)
    return jax.tree.map(partial(jnp.where, enough), plain, careful)


def _plainly(model, path, w0, rtol):
    """As `_doubled`, without care for kinks, by the least number of steps doubled once:
    whether that is enough of them, by `rtol`, is seen by the change."""
    least = path.least_substeps
    coarse, fine = abreast(model, path, w0, least)
    return fine, jnp.array(2 * least), _apart(coarse, fine)


def _with_care(model, path, w0, rtol, wanted: ArrayLike = True):
    """As `_doubled`, with care for kinks from the first step on; if it is `wanted`."""

    def unfinished(state):
        w, substeps, error = state
        return wanted & ~_known(error, w, rtol) & (substeps <= _MOST)

    # The first two runs are in the loop too, so that there is one to compile.
    def next_run(state):
        coarse, substeps, _ = state
        fine = run(model, path, w0, substeps)
        return fine, 2 * substeps, _apart(coarse, fine)

    unknown = jnp.full_like(path.t, jnp.nan)
    start = unknown, jnp.array(path.least_substeps), jnp.zeros((), path.t.dtype)
    w, substeps, error = jax.lax.while_loop(unfinished, next_run, start)
    return w, substeps // 2, error


def abreast(model, path, w0, substeps: int) -> list[Float[Array, " n"]]:
    """The outputs by so many steps a sample interval, and by twice as many, in one
    loop: neither waits for the other, and a processor takes both steps at a time."""
    m, signals = model.memory.first(path), path.signals()
    x = first_state(model, m, at(signals, 0), w0)
    coarse, fine = (
        model.memory.along(m, path.grid(count)) for count in (substeps, 2 * substeps)
    )
    intervals = jax.tree.map(
        lambda leaf: jnp.repeat(leaf, substeps, axis=0), path.intervals()
    )
    count = path.t.shape[0] - 1
    rows = (
        intervals,
        jnp.tile(jnp.arange(substeps), count),
        coarse,
        jax.tree.map(lambda leaf: leaf.reshape(-1, 2, *leaf.shape[1:]), fine),
    )

    def advanced(x, m, interval, i, count):
        ends = (path.node(interval, j, count) for j in (i, i + 1))
        return flow(model, x, model.legs(m, path.stretch(interval, *ends)))

    def over(states, row):
        one, other = states
        interval, i, m, halves = row
        one = advanced(one, m, interval, i, substeps)
        for j in (0, 1):
            other = advanced(other, at(halves, j), interval, 2 * i + j, 2 * substeps)
        return (one, other), (one, other)

    _, later = jax.lax.scan(over, (x, x), rows)
    m = sampled(coarse, substeps)
    states = at(from_start((x, x), later), slice(None, None, substeps))
    return [outputs(model, each, m, signals) for each in states]


def _apart(coarse: Float[Array, " n"], fine: Float[Array, " n"]) -> Float[Array, ""]:
    """The largest difference of two outputs, infinite where one is lost."""
    difference = jnp.abs(fine - coarse)
    return jnp.max(jnp.where(jnp.isfinite(difference), difference, jnp.inf))


def run(
    model, path, w0, substeps: Int[Array, ""], advance: Callable | None = None
) -> Float[Array, " n"]:
    """The output at the samples by so many steps a sample interval: a number that need
    not be known when it is compiled, as that of `FixedStep` must.

    **Arguments:** `advance`, which takes a step: by default with care for kinks.
    """
    take: Callable = _careful if advance is None else advance
    signals = path.signals()
    m = model.memory.first(path)
    state = first_state(model, m, at(signals, 0), w0), m
    intervals = path.intervals()

    def over(state, interval):
        def once(i, state):
            ends = (path.node(interval, j, substeps) for j in (i, i + 1))
            return take(model, state, path, interval, *ends)

        state = jax.lax.fori_loop(0, substeps, once, state)
        return state, state

    _, later = jax.lax.scan(over, state, intervals)
    x, m = from_start(state, later)
    return outputs(model, x, m, signals)


def _once(model, state, path, interval, first, last):
    """The state after a step from one fraction of an interval to another."""
    return step(model, state, path.stretch(interval, first, last))


def _careful(model, state, path, interval, first, last):
    """The state after a step, in two where the rate has a kink inside: a kink within a
    step costs its method two orders of accuracy."""

    def to(state, first, last):
        return _once(model, state, path, interval, first, last)

    def kinks(state):
        return jnp.stack(model.kinks(state[0]))

    whole = to(state, first, last)
    if not model.kinks(state[0]):
        return whole
    before, after = kinks(state), kinks(whole)
    crossed = before * after < 0

    def divided():
        def share(before, after):
            """How far it is to the first kink, if all runs straight."""
            return jnp.min(jnp.where(crossed, before / (before - after), 1.0))

        middle = first + share(before, after) * (last - first)
        # Once more from there, for what the kink itself has bent.
        near = kinks(to(state, first, middle))
        short = jnp.any(crossed & (near * before > 0))
        onward = middle + share(near, after) * (last - middle)
        back = first + share(before, near) * (middle - first)
        middle = jnp.where(short, onward, back)
        return to(to(state, first, middle), middle, last)

    return jax.lax.cond(jnp.any(crossed), divided, lambda: whole)


@eqx.filter_custom_jvp
def _differentiable(device: Any, *, w) -> Float[Array, " n"]:
    """The output `w`, with the derivatives of `FixedStep`: loops of unknown length have
    none."""
    return w


@_differentiable.def_jvp
def _(primals, tangents, *, w):
    (device,), (changes,) = primals, tangents
    moving, still = parted(device, changes)

    def by(count: int):
        def output(moving):
            model, path, w0 = eqx.combine(moving, still)
            method = FixedStep(count)
            return method.integrate(model, path, w0, jnp.ones_like(w0))[0]

        return output

    # Made again on the way back: what is kept of one branch takes its place in all.
    branches = [jax.checkpoint(by(count)) for count in _DERIVATIVES]
    model, path, w0 = device
    # The fewest steps whose own output is close to it, without care for kinks.
    few, more, _ = _DERIVATIVES
    close = _CLOSE * _size(w)

    def among_more():
        coarse = run(model, path, w0, jnp.array(more), _once)
        return jnp.where(_apart(coarse, w) <= close, 1, 2)

    first = FixedStep(few).integrate(model, path, w0, w0)[0]
    index = jax.lax.cond(_apart(first, w) <= close, lambda: 0, among_more)

    def output(moving):
        return jax.lax.switch(index, branches, moving)

    # Not `w` itself, which to a derivative of this rule would be a constant.
    return _differentiable(device, w=w), jax.jvp(output, (moving,), (changes,))[1]
