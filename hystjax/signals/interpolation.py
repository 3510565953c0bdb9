"""What drives a device, at one time, at many, and between its samples: the choices a
recording can carry, and the paths that they make, one object for regression and
simulation alike."""

from abc import abstractmethod
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any, NamedTuple, Optional

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from .._core import checks
from .._core.checks import InputError
from .._core.compiling import jit
from .._core.show import moment

__all__ = [
    "AbstractInterpolation",
    "BandLimited",
    "Cubic",
    "Exact",
    "FunctionPath",
    "Linear",
    "PiecewisePolynomial",
    "StraightLines",
    "Waveform",
]


def __dir__() -> list[str]:
    return __all__


class Signals(NamedTuple):
    """The input of a device.

    **Attributes:** all of one shape.

    - `t`: time, s.
    - `u`, `du`: the input, and its derivative by time.
    """

    t: Float[Array, "*s"]
    u: Float[Array, "*s"]
    du: Float[Array, "*s"]


class Grid(NamedTuple):
    """The input along m steps of a solver with stages at the start, the middle and the
    end of each; it turns at ends of steps only.

    **Attributes:**

    - `steps`: lengths, shape (m,), s.
    - `start`, `middle`, `end`: signals of shape (m,), with the derivative inside of the
        step. Many flat arrays, which a loop over steps reads faster than a few with
        several columns.
    """

    steps: Float[Array, "*batch m"]
    start: Signals
    middle: Signals
    end: Signals

    @property
    def nodes(self) -> Float[Array, " n"]:
        """The input where steps begin and end, n = m + 1."""
        return jnp.concatenate([self.start.u[:1], self.end.u])


_BISECTIONS = 50  # halvings of a sample interval: down to rounding in float64
_ROUNDING = 64  # units of rounding, more than the smallest step of an adaptive solver


class AbstractInputPath(eqx.Module):
    """The input u(t) over the sample times `t`, with its one-sided derivative.

    Inside the sample interval `[t[i], t[i+1]]` the path is smooth but for at most one
    turning point; at sample times the derivative may jump, and then takes its value
    from the interval asked about.

    **Attributes:**

    - `t`: sample times, shape (n,), s.
    - `past`: the path up to `t[0]`, where it is known: what memory starts from.
    """

    t: Float[Array, " n"]
    past: Optional["AbstractInputPath"] = eqx.field(kw_only=True, default=None)

    @property
    @abstractmethod
    def kinked(self) -> bool:
        """Whether du/dt may jump at every sample time."""

    @abstractmethod
    def segments(self) -> Any:
        """What is needed to evaluate the path in each sample interval: a PyTree of
        arrays with leading axis n - 1."""

    @abstractmethod
    def evaluate(
        self, segment: Any, fraction: Float[Array, ""]
    ) -> tuple[Float[Array, ""], Float[Array, ""]]:
        """u and du/dt a `fraction` (0 to 1) of the way through one segment, taken from
        inside that segment at its ends."""

    def at(
        self, time: Float[ArrayLike, " *s"] | Sequence[ArrayLike]
    ) -> tuple[Float[Array, " *s"], Float[Array, " *s"]]:
        """u and du/dt (right limit at sample times) at any times, s."""
        return self.at_elapsed(jnp.asarray(time) - self.t[0])

    @jit
    def at_elapsed(
        self, elapsed: Float[Array, " *s"]
    ) -> tuple[Float[Array, " *s"], Float[Array, " *s"]]:
        """As `at`, at times since the first sample: seconds since 1970 would be rounded
        by 1e-7, a part of short steps."""
        t, last = self.t - self.t[0], self.t.shape[0] - 2
        index = jnp.clip(jnp.searchsorted(t, elapsed, side="right") - 1, 0, last)
        fraction = (elapsed - t[index]) / (self.t[index + 1] - self.t[index])
        segments = jax.tree.map(lambda leaf: leaf[index], self.segments())
        evaluate = self.evaluate
        for _ in range(elapsed.ndim):
            evaluate = jax.vmap(evaluate)
        return evaluate(segments, fraction)

    @jit
    def samples(self) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
        """u and du/dt at the sample times: right limits, the left one at the end."""
        start = jnp.zeros((self.t.shape[0] - 1, 1), self.t.dtype)
        u, du = self._everywhere(jnp.concatenate([start, start + 1], axis=1))
        return jnp.append(u[:, 0], u[-1, 1]), jnp.append(du[:, 0], du[-1, 1])

    def signals(self) -> Signals:
        """All of the input at the sample times; derivatives as of `samples`."""
        return Signals(self.t, *self.samples())

    def turning_fractions(self) -> Float[Array, " intervals"]:
        """Where in each sample interval the derivative changes sign: a fraction in
        (0, 1), or NaN where it does not. Shape (n - 1,).

        A change within rounding of a sample belongs to that sample: a solver could not
        step to it.
        """
        if self.kinked:  # straight lines turn at their ends only
            return jnp.full_like(self.t[:-1], jnp.nan)
        fraction, _ = self._sign_changes()
        distance = jnp.minimum(fraction, 1 - fraction) * jnp.diff(self.t)
        rounding = _ROUNDING * jnp.finfo(self.t.dtype).eps * jnp.max(jnp.abs(self.t))
        return jnp.where(distance > rounding, fraction, jnp.nan)

    @jit
    def _sign_changes(self):
        """Where du/dt changes sign, and du/dt at both ends of the intervals."""

        def slope(fraction):
            return jax.vmap(self.evaluate)(self.segments(), fraction)[1]

        low = jnp.zeros_like(self.t[:-1])
        high = jnp.ones_like(low)
        start, end = slope(low), slope(high)

        def halve(_, bracket):
            low, high = bracket
            middle = (low + high) / 2
            before = slope(middle) * start > 0
            return jnp.where(before, middle, low), jnp.where(before, high, middle)

        low, high = jax.lax.fori_loop(0, _BISECTIONS, halve, (low, high))
        fraction = jnp.where(start * end < 0, (low + high) / 2, jnp.nan)
        return fraction, jnp.stack([start, end], axis=-1)

    def jumps(self) -> Float[Array, " m"]:
        """Times at which |du/dt| has a kink or jump, sorted; padded with inf. Of smooth
        paths those between samples only."""
        if self.kinked:
            return self.t
        fraction = self.turning_fractions()
        times = self.t[:-1] + fraction * jnp.diff(self.t)
        return jnp.sort(jnp.where(jnp.isnan(fraction), jnp.inf, times))

    def grid(self, substeps: int) -> Grid:
        """Steps for a fixed-step solver, `substeps` a sample interval, m = substeps
        (n - 1) in all.

        A turning point inside an interval is always a boundary between two steps.
        Inputs that are smooth between samples need at least 2 `substeps` for that.
        """

        def step(interval, i):
            ends = (self.node(interval, j, substeps) for j in (i, i + 1))
            return self.stretch(interval, *ends)

        steps = jax.vmap(step, in_axes=(None, 0))
        every = jax.vmap(steps, in_axes=(0, None))
        return jax.tree.map(jnp.ravel, every(self.intervals(), jnp.arange(substeps)))

    def intervals(self) -> tuple[Any, Any, Any, Any]:
        """What `stretch` needs to know of each sample interval, along the first axis:
        its start and length (s), where it turns, and how to evaluate it."""
        t = self.t
        return t[:-1], jnp.diff(t), self.turning_fractions(), self.segments()

    def node(self, interval: Any, i: Any, substeps: Any) -> Any:
        """Where in one of the `intervals` step `i` of `substeps` begins, as a fraction;
        these are numbers that need not be known when it is compiled."""
        _, _, turning, _ = interval
        nearest = jnp.clip(jnp.round(turning * substeps), 1, substeps - 1)
        return jnp.where(i == nearest, turning, i / substeps)

    def stretch(self, interval: Any, first: Any, last: Any) -> Grid:
        """One step from a fraction of one of the `intervals` to another."""
        start, length, _, segment = interval

        def signals(at):
            return Signals(start + at * length, *self.evaluate(segment, at))

        begun, middle, ended = map(signals, (first, (first + last) / 2, last))
        if not self.kinked:
            begun, ended = (_on_the_way(each, middle.du) for each in (begun, ended))
        return Grid((last - first) * length, begun, middle, ended)

    @property
    def least_substeps(self) -> int:
        """Steps a sample interval that can end at every turning point."""
        return 1 if self.kinked else 2

    def _everywhere(self, fractions: Float[Array, "m s"]):
        """u and du/dt at the given fractions of every sample interval."""
        evaluate = jax.vmap(self.evaluate, in_axes=(None, 0))
        return jax.vmap(evaluate)(self.segments(), fractions)

    def variation(self) -> Float[Array, " n"]:
        """Total variation V of u from `t[0]` to each sample time, input units."""
        fraction = self.turning_fractions()
        turn = jnp.where(jnp.isnan(fraction), 1.0, fraction).astype(self.t.dtype)
        stops = jnp.stack([jnp.zeros_like(turn), turn, jnp.ones_like(turn)], axis=-1)
        steps = jnp.sum(jnp.abs(jnp.diff(self._everywhere(stops)[0])), axis=-1)
        return jnp.concatenate([jnp.zeros_like(steps[:1]), jnp.cumsum(steps)])

    def turning_points(self) -> tuple[np.ndarray, np.ndarray]:
        """Times (s) and inputs at which u changes direction, in order.

        Their number depends on the data: this is for concrete paths, outside `jit`.
        A plateau counts as one turning point, at its end.
        """
        t, u = np.asarray(self.t), np.asarray(self.samples()[0])
        fraction, slopes = map(np.asarray, self._sign_changes())
        # What rounding of u and t makes of a slope of zero is not a direction. That of
        # t matters as far as the slope changes on the way to the next sample.
        change = np.abs(np.diff(slopes, axis=1))[:, 0]
        error = np.max(np.abs(u)) + change * np.max(np.abs(t))
        floor = _ROUNDING * np.finfo(t.dtype).eps * error / np.diff(t)
        moving = np.flatnonzero(np.abs(slopes) > floor[:, None])
        turned = np.flatnonzero(np.diff(np.sign(slopes.ravel()[moving])))
        before, after = moving[turned], moving[turned + 1]
        # Positions 2i and 2i + 1 are the ends of interval i.
        interval, inside = after // 2, before // 2 == after // 2
        since = np.where(inside, fraction[interval], 0.0) * np.diff(t)[interval]
        times = t[interval] + since
        return times, np.asarray(self.at(times)[0])


class Waveform(eqx.Module):
    """A periodic function of time, made of cubic pieces of one length.

    **Attributes:**

    - `start`: time at which the first piece begins, s.
    - `length`: of a piece, s.
    - `coefficients`: shape (m, 4) for the m pieces of a period, lowest power first, of
        the time since the piece's start, s.
    """

    start: Float[Array, ""]
    length: Float[Array, ""]
    coefficients: Float[Array, "m 4"]

    @jit
    def __call__(self, time: Float[Array, ""]) -> Float[Array, ""]:
        """The value at any time, s."""
        position = (time - self.start) / self.length
        piece = jnp.floor(position)
        since = (position - piece) * self.length
        a, b, c, d = self.coefficients[piece.astype(int) % len(self.coefficients)]
        return a + since * (b + since * (c + since * d))


_TURNED = 1e-6  # share of the rate inside of a step that is none at a turning point


def _on_the_way(end: Signals, du: Float[Array, ""]) -> Signals:
    """An end of a step on whose way the rate of the input is `du`. Where the input
    turns there, rounding has its rate on either side of 0, and the derivative of |u'|
    would be that of the other step."""
    turned = (jnp.abs(end.du) <= _TURNED * jnp.abs(du)) & (du != 0)
    least = jnp.finfo(end.du.dtype).tiny
    on_this_side = jnp.copysign(jnp.maximum(jnp.abs(end.du), least), du)
    moved = end.du + jax.lax.stop_gradient(on_this_side - end.du)
    return end._replace(du=jnp.where(turned, moved, end.du))


class StraightLines(AbstractInputPath):
    """A path that goes straight from sample to sample.

    It meets all samples, and stands still between equal ones, to the last bit: a relay
    turns just there, or does not, where a sample is one of its thresholds.

    **Attributes:**

    - `t`: sample times, shape (n,), s.
    - `u`: the input there, shape (n,).
    """

    u: Float[Array, " n"]

    @property
    def kinked(self):
        """They are."""
        return True

    def segments(self):
        return self.u[:-1], self.u[1:], jnp.diff(self.t)

    def evaluate(self, segment, fraction):
        start, end, length = segment
        rise = end - start
        # From the end that is nearer, where start + rise can be off by its rounding.
        near, far = start + fraction * rise, end - (1 - fraction) * rise
        return jnp.where(fraction > 0.5, far, near), rise / length


class PiecewisePolynomial(AbstractInputPath):
    """A path with `pieces` equal polynomial pieces in every sample interval.

    **Attributes:**

    - `t`: sample times, shape (n,), s.
    - `coefficients`: shape (pieces (n - 1), degree + 1), lowest power first, of the
        time since the piece's start, s.
    - `pieces`: number of pieces a sample interval.
    """

    coefficients: Float[Array, "m order"]
    pieces: int = eqx.field(static=True)

    @property
    def kinked(self):
        """Splines are not; straight lines are a path of their own."""
        return False

    def segments(self):
        intervals = self.t.shape[0] - 1
        return (
            jnp.diff(self.t) / self.pieces,
            self.coefficients.reshape(intervals, self.pieces, -1),
        )

    def evaluate(self, segment, fraction):
        length, coefficients = segment
        piece = jnp.clip(jnp.floor(fraction * self.pieces), 0, self.pieces - 1)
        since = (fraction * self.pieces - piece) * length
        # A lone piece needs no look-up, which would slow the fixed-step solver.
        index = 0 if self.pieces == 1 else piece.astype(int)
        powers = coefficients[index]
        u, du = powers[-1], jnp.zeros_like(since)
        for order in range(powers.shape[0] - 2, -1, -1):
            du = du * since + u
            u = u * since + powers[order]
        return u, du


class FunctionPath(AbstractInputPath):
    """A path given by a smooth function of time.

    **Attributes:**

    - `t`: sample times, shape (n,), s; they say where the path is looked at, and
        there is at most one turning point between two of them.
    - `function`: the input at a scalar time, differentiable by JAX.
    """

    function: Callable

    @property
    def kinked(self):
        """Smooth functions are not."""
        return False

    def segments(self):
        return self.t[:-1], jnp.diff(self.t)

    def evaluate(self, segment, fraction):
        start, length = segment
        time = start + fraction * length
        return jax.jvp(self.function, (time,), (jnp.ones_like(time),))


class AbstractInterpolation(eqx.Module):
    """Makes an input path from samples."""

    @abstractmethod
    def path(self, t: Float[Array, " n"], u: Float[Array, " n"]) -> AbstractInputPath:
        """The path through `u` (input units) at the times `t` (s)."""

    def elsewhere(
        self, t: Float[Array, " n"], u: Float[Array, " n"]
    ) -> "AbstractInterpolation":
        """How the input through `u` at `t` runs between other times, such as some of
        them: the same way, unless that way takes all of the samples."""
        return self

    def of_units(self, factor: float, offset: float) -> "AbstractInterpolation":
        """How the input times `factor` plus `offset` runs: the same way, where that is
        told by the samples."""
        return self


class Linear(AbstractInterpolation):
    """Straight lines between samples: right for triangles and ramps, safe always."""

    def path(self, t, u):
        return StraightLines(*_floats(t=t, u=u))


class Cubic(AbstractInterpolation):
    """A cubic spline with not-a-knot ends: for smooth, well-sampled inputs.

    It overshoots at corners; use `Linear` for triangles and ramps.
    """

    def path(self, t, u):
        t, u = _floats(t=t, u=u)
        _check_enough(t)
        return PiecewisePolynomial(t, _pieces(t, u, "not-a-knot"), 1)


class BandLimited(AbstractInterpolation):
    """The trigonometric interpolant of one or more whole periods, evenly sampled.

    Exact for a multisine sampled above twice its highest frequency. It is evaluated
    on a grid `factor` times finer by the Fourier transform and by cubic splines
    between.

    The recording that it is given to must hold whole periods, the first row not again
    at the end. Windows of that recording, and resampled ones, follow the same
    interpolant, as an `Exact` input.

    **Attributes:**

    - `factor`: how much finer than the samples the spline's knots are.
    """

    factor: int = eqx.field(
        converter=partial(checks.count, "factor"), static=True, default=8
    )

    def path(self, t, u):
        t, u = _floats(t=t, u=u)
        coefficients = self._waveform(t, u).coefficients
        inside = (t.shape[0] - 1) * self.factor  # the last sample ends the path
        return PiecewisePolynomial(t, coefficients[:inside], self.factor)

    def elsewhere(self, t, u):
        return Exact(self._waveform(t, u))

    def _waveform(self, t, u) -> Waveform:
        _check_enough(t)
        checks.evenly_spaced(
            "`interpolation.BandLimited`", t, "or use `interpolation.Cubic()`"
        )
        return _periodic(t, u, self.factor)


class Exact(AbstractInterpolation):
    """The input is known: `function` gives it at any time.

    **Attributes:**

    - `function`: smooth map from a scalar time (s) to the input, written in JAX.
    """

    function: Callable

    def __check_init__(self):
        if not callable(self.function):
            raise InputError(
                "`function` must be a function of time, such as `jnp.sin`; got "
                f"{checks.described(self.function)}."
            )

    def path(self, t, u):
        return FunctionPath(t, self.function)

    def of_units(self, factor, offset):
        return Exact(_Affine(self.function, factor, offset))


class _Affine(eqx.Module):
    """A function of time in other units."""

    function: Callable
    factor: float
    offset: float

    def __call__(self, time: Float[Array, ""]) -> Float[Array, ""]:
        return self.factor * self.function(time) + self.offset


@jit
def _periodic(t, u, factor: int) -> Waveform:
    """The trigonometric interpolant by a spline, `factor` knots a sample."""
    n, fine = t.shape[0], t.shape[0] * factor
    spectrum = jnp.fft.rfft(u)
    # The Nyquist line is shared by both halves of a spectrum that goes beyond it.
    if n % 2 == 0 and factor > 1:
        spectrum = spectrum.at[-1].multiply(0.5)
    values = jnp.fft.irfft(spectrum, fine) * factor
    length = (t[-1] - t[0]) / (fine - factor)
    # Numbers of pieces for times, which would be rounded, and not equally far apart.
    knots = jnp.arange(fine + 1, dtype=t.dtype)
    pieces = _pieces(knots, jnp.append(values, values[0]), "periodic")
    return Waveform(t[0], length, pieces / length ** jnp.arange(4))


@jit
def _pieces(knots, values, ends: str) -> Float[Array, "m 4"]:
    """Coefficients of the cubic spline, lowest power first."""
    import interpax  # slow to import

    spline = interpax.CubicSpline(knots, values, bc_type=ends, check=False)
    return jnp.flip(spline.c, 0).T


def _floats(**columns: ArrayLike | Sequence[float]) -> Iterator[Float[Array, " n"]]:
    """Columns as arrays of floats: loops whose samples are whole numbers would have to
    keep these whole."""
    for name, x in columns.items():
        if isinstance(x, jax.Array) and jnp.issubdtype(x.dtype, jnp.floating):
            yield x
        else:
            yield checks.vector(name, x)


def check_within(
    name: str, times: Array, known: Array, of: str, unit: str = " s"
) -> None:
    """Raise `InputError` for times beyond those between which an input is known."""
    if not checks.is_concrete(times, known) or not len(times):
        return
    asked, held = (
        (float(jnp.min(each)), float(jnp.max(each))) for each in (times, known)
    )
    if asked[0] < held[0] or asked[1] > held[1]:
        told = [
            " to ".join(f"{moment(t)}{unit}" for t in each) for each in (asked, held)
        ]
        raise InputError(
            f"`{name}` runs from {told[0]}, beyond {of}'s {told[1]}; hystjax does not "
            "extrapolate measurements."
        )


def _check_enough(t) -> None:
    if t.shape[0] < 4:
        raise InputError(
            f"a cubic path needs at least 4 samples, got {t.shape[0]}; use "
            "`interpolation.Linear()`."
        )
