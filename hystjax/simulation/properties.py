"""Properties that define hysteresis, as numbers, for any model; and where a law comes
to rest while its input is held.

A model is driven along straight lines between turning points, by a `Drive`; each
function says how far the outcome is from a property that an ideal device has. Shares
of an output that stands still are 0.
"""

import functools
import inspect
from collections.abc import Callable, Sequence
from typing import Any, Concatenate, NamedTuple, ParamSpec, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Bool, Float

from .._core import checks
from .._core.checks import InputError, described
from .._core.compiling import jit
from .._core.solution import Solution
from ..library import at
from ..models import AbstractModel, as_model, check_answers
from ..recording import Recording, as_recording
from ..signals import Grid, Signals
from ..signals.excitation import positive, scalar
from ._steps import first_state, flow, from_start, march, outputs

__all__ = [
    "Dissipation",
    "Drive",
    "Properties",
    "Rests",
    "Run",
    "Steepness",
    "dissipation",
    "examine",
    "incongruency",
    "memory_loss",
    "rate_dependence",
    "rests",
    "run",
    "steepness",
]


def __dir__() -> list[str]:
    return __all__


_NODES = 1001  # between which signs are compared; odd, so that one is half way
_MOST = 16  # rests that are told
_HALVINGS = 60  # of an interval between nodes, down to rounding


class Rests(NamedTuple):
    """Outputs at which a law stays while its input is held.

    **Attributes:**

    - `w`: those outputs, in ascending order, the first sixteen of them, shape (16,);
        NaN behind the last.
    - `stable`: whether the law returns there from nearby, shape (16,).
    - `drift`: how fast the output moves half way between those that were looked at,
        output units/s; where there is no rest, for ever, unless it is 0.
    """

    w: Float[Array, " k"]
    stable: Bool[Array, " k"]
    drift: Float[Array, ""]


def rests(
    model: AbstractModel | Solution, u: ArrayLike, low: ArrayLike, high: ArrayLike
) -> Rests:
    """Where a law comes to rest under an input that is held, and what it leaves.

    A law with one stable rest forgets what it went through; with several it ends at one
    or the other, whichever the past led to; with none it runs away. Memory is that of
    an input which has always been `u`.

    **Arguments:**

    - `model`: a law whose state is one number that its output tells.
    - `u`: where the input is held, input units.
    - `low`, `high`: between which outputs are looked for, output units. Of two rests
        less than a thousandth of that apart neither is seen.

    **Returns:** `Rests`, with their derivatives; none for a law whose output stands
    still wherever it is, as that of a rate-independent law does.

    **Raises:** `InputError` when `low` does not lie below `high`, or one of the three
    is not finite; and when the state of the model is not one number that the output
    tells.

    **Source:** Strogatz (2015), Nonlinear Dynamics and Chaos, chapter 2, ISBN
    978-0-8133-4910-7: fixed points on the line.
    """
    model = _with_step("rests(model, u, low, high)", model)
    u, low, high = scalar("u")(u), scalar("low")(low), scalar("high")(high)
    _check_order(low, high)
    found, told = _rests(model, u, low, high)
    if checks.is_concrete(told) and not told:
        raise _untold(model)
    return found


def _check_order(low: Float[Array, ""], high: Float[Array, ""]) -> None:
    if checks.is_concrete(low, high) and not low < high:
        raise InputError(f"`low` must lie below `high`, got {low} and {high}.")


def _untold(model: AbstractModel) -> InputError:
    return InputError(
        "`rests` is about laws whose state is one number that the output tells, and "
        f"that of this {type(model).__name__} is not."
    )


_ALIKE = 1e-3  # of the range, as far as the output may be off that which was to start


@jit
def _rests(model, u, low, high) -> tuple[Rests, Bool[Array, ""]]:
    """The rests, and whether the output tells the state."""
    now = Signals(jnp.zeros(()), u, jnp.zeros(()))
    m = model.memory.start(now)

    def moved(w):
        """The output, where it is w, and its derivative, output units/s."""
        x = first_state(model, m, now, w)
        shapes = [jnp.shape(leaf) for leaf in jax.tree.leaves(x)]
        if shapes != [()]:
            raise _untold(model)
        rate = model.rate(x, m, now)
        return jax.jvp(lambda x: model.output(x, m, now), (x,), (rate,))

    # Beyond the ends by what is rounded: a rest there would have one sign beside it.
    more = 16 * jnp.finfo(low.dtype).eps * jnp.maximum(jnp.abs(low), jnp.abs(high))
    nodes = jnp.linspace(low - more, high + more, _NODES)
    outputs, drifts = jax.vmap(moved)(nodes)
    told = ~(jnp.max(jnp.abs(outputs - nodes)) > _ALIKE * (high - low))
    # Of a rest at a node only the interval before or after it counts.
    upward = drifts >= 0
    crossed = (upward[:-1] != upward[1:]) & jnp.isfinite(drifts[:-1] + drifts[1:])
    (first,) = jnp.nonzero(crossed, size=_MOST, fill_value=-1)
    stable = upward[first]

    def halved(_, ends):
        left, right = ends
        middle = (left + right) / 2
        beyond = (jax.vmap(moved)(middle)[1] >= 0) == stable
        return jnp.where(beyond, middle, left), jnp.where(beyond, right, middle)

    ends = nodes[first], nodes[first + 1]
    left, right = jax.lax.fori_loop(0, _HALVINGS, halved, ends)
    found, middle = first >= 0, jax.lax.stop_gradient((left + right) / 2)
    # A step of Newton's that moves no rest, for the derivative of it.
    (_, still), (_, slope) = jax.vmap(lambda w: jax.jvp(moved, (w,), (1 + 0 * w,)))(
        middle
    )
    fixed, slope = jax.lax.stop_gradient((still, jnp.where(slope == 0, 1.0, slope)))
    w = jnp.clip(middle - (still - fixed) / slope, low, high)
    drift = drifts[_NODES // 2]
    return Rests(jnp.where(found, w, jnp.nan), found & stable, drift), told


class Drive(eqx.Module):
    """An input that goes up and down between two values at one speed.

    **Attributes:**

    - `low`, `high`: ends of the input's range, input units.
    - `rate`: its speed, input units/s, positive.
    - `w0`: output at the start, where the input is `low`; output units, 0 by default.
    - `cycles`: how many precede what is looked at, so that the model settles; from 1.
    - `steps`: Runge-Kutta steps of fourth order on each straight line; an even number.
    """

    low: Float[Array, ""] = eqx.field(converter=scalar("low"))
    high: Float[Array, ""] = eqx.field(converter=scalar("high"))
    rate: Float[Array, ""] = eqx.field(converter=positive("rate"))
    w0: Float[Array, ""] = eqx.field(converter=scalar("w0"), default=0.0)
    cycles: int = eqx.field(
        converter=functools.partial(checks.count, "cycles"), static=True, default=20
    )
    steps: int = eqx.field(
        converter=functools.partial(checks.whole, "steps"), static=True, default=400
    )

    def __check_init__(self):
        _check_order(self.low, self.high)
        if self.steps < 2 or self.steps % 2:
            raise InputError(
                f"`steps` must be even, for Simpson's rule, got {self.steps}."
            )

    @classmethod
    def like(
        cls, recording: Recording, *, cycles: int = 20, steps: int = 400
    ) -> "Drive":
        """Over the input range of a recording, at its mean speed, from its output where
        the input is lowest; `cycles` and `steps` as of a `Drive`."""
        recording = as_recording(recording, "Drive.like(recording)")
        t, u = recording.t, recording.u
        rate = recording.path.variation()[-1] / (t[-1] - t[0])
        w0 = recording.w[jnp.argmin(u)]
        return cls(jnp.min(u), jnp.max(u), rate, w0, cycles, steps)

    def shrunk(self, share: Float[ArrayLike, ""]) -> "Drive":
        """Over a share of the range, about the same middle."""
        middle, half = (self.low + self.high) / 2, (self.high - self.low) / 2
        ends = middle - share * half, middle + share * half
        return eqx.tree_at(lambda drive: (drive.low, drive.high), self, ends)


_Further = ParamSpec("_Further")
_Found = TypeVar("_Found")


def _property(
    function: Callable[Concatenate[AbstractModel, Drive, _Further], _Found],
) -> Callable[Concatenate[AbstractModel | Solution, Drive, _Further], _Found]:
    """A function of models, drives and multiples of these, compiled; all are checked
    before, and of a `Solution` its model is taken."""
    compiled, signature = jit(function), inspect.signature(function)

    @functools.wraps(function)
    def call(model, drive, *args, **kwargs):
        model = _checked(function.__name__, model, drive)
        given = signature.bind(model, drive, *args, **kwargs)
        given.apply_defaults()
        _, _, *further = given.arguments.items()
        multiples = {name: _multiples(name, values) for name, values in further}
        return compiled(model, drive, **multiples)

    return call


def _checked(name: str, model: Any, drive: Any) -> AbstractModel:
    found = _with_step(f"{name}(model, drive)", model)
    if not isinstance(drive, Drive):
        raise InputError(
            f"`drive` must be a `hystjax.properties.Drive`, got {described(drive)}; "
            "`Drive.like(recording)` makes that of a recording."
        )
    return found


def _with_step(call: str, model: Any) -> AbstractModel:
    found = as_model(model, call)
    if not isinstance(found, AbstractModel):
        raise InputError(
            f"{described(found)} maps whole sequences, and has no step to be driven by."
        )
    check_answers(found)
    return found


class Run(NamedTuple):
    """Inputs and outputs along straight lines, each with both of its ends.

    **Attributes:** `u` and `w`, shape (lines, steps + 1). The first two lines are the
    last of the drive's cycles, up and down; the others follow from there. An output
    that sees the derivative of the input jumps where it turns: from the last of one
    line to the first of the next.
    """

    u: Float[Array, "lines n"]
    w: Float[Array, "lines n"]

    @property
    def range(self) -> Float[Array, ""]:
        """Largest less smallest output of that cycle, output units."""
        return jnp.ptp(self.w[:2])


def run(
    model: AbstractModel | Solution,
    drive: Drive,
    *turns: float,
    speed: ArrayLike = 1.0,
) -> Run:
    """Drive a model through the drive's cycles and then through further turning points.

    **Arguments:**

    - `model`: any.
    - `drive`: the input.
    - `turns`: where the input turns after the cycles, which end at its lowest value: 0
        there, 1 at its highest.
    - `speed`: as a multiple of the drive's.

    **Returns:** a `Run`; not finite from where the model diverges.

    **Raises:** `InputError` for what is no model with a step, and no `Drive`.
    """
    model = _checked("run", model, drive)
    speed = checks.number("speed", speed)
    checks.positive("speed", speed)
    further = [checks.number("turns", turn) for turn in turns]
    shares = jnp.array([*(0.0, 1.0) * drive.cycles, 0.0, *further])
    ends = drive.low + shares * (drive.high - drive.low)
    fractions = jnp.linspace(0, 1, drive.steps + 1)
    u = ends[:-1, None] + fractions * jnp.diff(ends)[:, None]
    w = _outputs(model, u, drive.rate * speed, drive.w0)
    return Run(u[-len(turns) - 2 :], w[-len(turns) - 2 :])


def _outputs(model, u, rate, w0):
    """Outputs at the inputs of every line, shape (lines, steps + 1)."""
    lines, points = u.shape
    start, end = u[:, :-1].ravel(), u[:, 1:].ravel()
    steps = jnp.abs(end - start) / rate
    du = jnp.sign(end - start) * rate
    t = from_start(jnp.zeros(()), jnp.cumsum(steps))
    stages = (t[:-1], start), (t[:-1] + steps / 2, (start + end) / 2), (t[1:], end)
    grid = Grid(steps, *(Signals(time, value, du) for time, value in stages))
    first = at(grid.start, 0)
    m = model.memory.start(first)
    memory = model.memory.along(m, grid)
    legs = jax.vmap(model.legs)(memory, grid)
    x = march(flow, model, first_state(model, m, first, w0), legs)
    m, before = from_start(m, memory[2]), from_start(first, grid.end)
    # The same, but for derivatives, which are those of the steps that begin there.
    after = before._replace(du=jnp.append(grid.start.du, du[-1]))
    begun, later = (outputs(model, x, m, signals) for signals in (after, before))
    begun = begun[:-1].reshape(lines, points - 1)
    return jnp.concatenate([begun[:, :1], later[1:].reshape(begun.shape)], axis=1)


def _share(amount, height):
    """An amount over the height of a loop; 0 where that has none, and the amount is
    rounding at most."""
    return amount / jnp.where(height == 0, jnp.inf, height)


class Steepness(NamedTuple):
    """Smallest dw/du on the branches of a loop, over the loop's mean steepness, which
    is its range in w over its range in u.

    **Attributes:** `rising`, `falling`: scalars; a model is piecewise monotone on this
    loop where neither is negative.
    """

    rising: Float[Array, ""]
    falling: Float[Array, ""]


@_property
def steepness(model: AbstractModel, drive: Drive) -> Steepness:
    """Where the loop is least steep.

    **Arguments:** any `model`; the `drive`, to whose steps steepness refers.

    **Returns:** a `Steepness`.

    **Source:** Visintin (1994), doi 10.1007/978-3-662-11557-2.
    """
    loop = run(model, drive)
    slopes = jnp.diff(loop.w) / jnp.diff(loop.u)
    least = jnp.min(slopes, axis=1) * (drive.high - drive.low)
    return Steepness(*_share(least, loop.range))


@_property
def rate_dependence(
    model: AbstractModel,
    drive: Drive,
    speeds: ArrayLike | Sequence[float] = (0.25, 1.0, 4.0),
) -> Float[Array, ""]:
    """How far apart loops at several speeds are.

    0 for a rate independent model. A law is one when all of its terms are of degree one
    in u' and |u'| together.

    **Arguments:** any `model`; the `drive`; `speeds` as multiples of the drive's.

    **Returns:** the largest distance between outputs at equal inputs of the last
    cycles, over the range of all these outputs.

    **Source:** Visintin (1994), doi 10.1007/978-3-662-11557-2; for Duhem laws Oh and
    Bernstein (2005), doi 10.1109/TAC.2005.847035.
    """
    w = jax.vmap(lambda speed: run(model, drive, speed=speed).w)(speeds)
    return _share(jnp.max(jnp.ptp(w, axis=0)), jnp.ptp(w))


_LOW, _HIGH = 0.25, 0.75  # of the range, between which excursions and loops are minor


@_property
def memory_loss(model: AbstractModel, drive: Drive) -> Float[Array, ""]:
    """How far from its return point a minor excursion ends.

    From the settled major loop the input turns back over the middle half of its range,
    and then comes to the turning point again: once from the rising branch, once from
    the falling. With return-point memory (wiping-out) the output is there what it was:
    0.

    **Arguments:** any `model`; the `drive`.

    **Returns:** the larger of the two distances, over the range of the output in the
    major loop.

    **Source:** Mayergoyz (2003), Mathematical Models of Hysteresis and Their
    Applications, ISBN 978-0-12-480873-7.
    """
    rising = run(model, drive, _HIGH, _LOW, _HIGH)
    falling = run(model, drive, 1.0, _LOW, _HIGH, _LOW)
    gaps = [each.w[-1, -1] - each.w[-3, -1] for each in (rising, falling)]
    return _share(jnp.max(jnp.abs(jnp.stack(gaps))), rising.range)


@_property
def incongruency(model: AbstractModel, drive: Drive) -> Float[Array, ""]:
    """How much minor loops over the middle half of the input's range differ in shape.

    Congruent loops are equal up to a shift of the output: 0. One loop is entered from
    the rising branch of the settled major loop, the other from its falling branch. Each
    is taken after ONE cycle between the minor loop's ends; in a model that forgets,
    such as a Duhem law, the difference shrinks with further cycles.

    **Arguments:** any `model`; the `drive`.

    **Returns:** the largest distance between the two loops, each less its mean, over
    the range of the output in the first, or in the second where the first has none.

    **Source:** Mayergoyz (2003), Mathematical Models of Hysteresis and Their
    Applications, ISBN 978-0-12-480873-7.
    """
    from_below = run(model, drive, _HIGH, *(_LOW, _HIGH) * 2).w[-2:]
    from_above = run(model, drive, 1.0, _LOW, *(_HIGH, _LOW) * 2).w[-2:]
    one, other = _shape(from_below), _shape(from_above[::-1])
    height = jnp.where(jnp.ptp(one) == 0, jnp.ptp(other), jnp.ptp(one))
    return _share(jnp.max(jnp.abs(one - other)), height)


def _shape(w):
    return w - jnp.mean(w)


class Dissipation(NamedTuple):
    """Work of cycles at a amplitudes and s speeds.

    **Attributes:** each of shape (a, s).

    - `work`: the integral of w du over the cycle, input times output units.
    - `share`: the work as a share of the rectangle about the loop.
    - `closure`: how far the output is from where the cycle began, over its range:
        work is that of a steady loop where this is almost 0.
    """

    work: Float[Array, "a s"]
    share: Float[Array, "a s"]
    closure: Float[Array, "a s"]


@_property
def dissipation(
    model: AbstractModel,
    drive: Drive,
    amplitudes: ArrayLike | Sequence[float] = (0.25, 0.5, 1.0),
    speeds: ArrayLike | Sequence[float] = (1.0,),
) -> Dissipation:
    """The integral of w du over the drive's last cycle.

    Positive where the output is higher while the input rises (a clockwise loop, a force
    over a position: work done on the device); negative where the output lags behind the
    input (a displacement over a voltage, an induction over a field: there the work done
    on the device is the integral of u dw, which over a closed loop is minus this).

    **Arguments:**

    - `model`: any.
    - `drive`: the input.
    - `amplitudes`: shares of the drive's range, about its middle.
    - `speeds`: multiples of the drive's.

    **Returns:** a `Dissipation`.

    **Source:** Brokate and Sprekels (1996), Hysteresis and Phase Transitions, doi
    10.1007/978-1-4612-4048-8.
    """

    def cycle(amplitude, speed):
        return _cycle(run(model, drive.shrunk(amplitude), 1.0, speed=speed))

    every = jax.vmap(jax.vmap(cycle, in_axes=(None, 0)), in_axes=(0, None))
    return every(amplitudes, speeds)


def _multiples(name: str, values: ArrayLike | Sequence[float]) -> Float[Array, " n"]:
    multiples = checks.vector(name, values)
    if not multiples.size:
        raise InputError(f"`{name}` is empty; pass at least one.")
    if checks.is_concrete(*jax.tree.leaves(values)):
        checks.positive(name, np.asarray(values))
    return multiples


def _cycle(loop):
    """Of a run that has begun the next cycle, at which the last should begin again."""
    work = jnp.sum(_simpson(loop.u[:2], loop.w[:2]))
    closure = jnp.abs(loop.w[2, 0] - loop.w[0, 0])
    shares = work / jnp.ptp(loop.u), closure
    return Dissipation(work, *(_share(each, loop.range) for each in shares))


def _simpson(u, w):
    """Integrals of w du over each line, whose inputs are evenly spaced."""
    steps = u.shape[1] - 1
    weights = np.ones(steps + 1)
    weights[1:-1:2], weights[2:-1:2] = 4, 2
    return w @ weights * (u[:, -1] - u[:, 0]) / (3 * steps)


class Properties(NamedTuple):
    """What the functions of `hystjax.properties` return that need no more than a drive.

    **Attributes:** `rate_dependence`, `incongruency` and `memory_loss`, scalars;
    `steepness`; `dissipation`.
    """

    rate_dependence: Float[Array, ""]
    steepness: Steepness
    incongruency: Float[Array, ""]
    memory_loss: Float[Array, ""]
    dissipation: Dissipation


@_property
def examine(model: AbstractModel, drive: Drive) -> Properties:
    """Every property of a model, with default settings.

    **Arguments:** any `model`; the `drive`, such as `Drive.like(recording)`.

    **Returns:** `Properties`; those of a model that diverges are not finite.
    """
    return Properties(
        rate_dependence(model, drive),
        steepness(model, drive),
        incongruency(model, drive),
        memory_loss(model, drive),
        dissipation(model, drive),
    )
