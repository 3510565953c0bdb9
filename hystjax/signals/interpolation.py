"""How an input runs between its samples: the choices a recording can carry, and the
paths that they make."""

from abc import abstractmethod
from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._core import checks
from .._core.checks import InputError
from .._core.compiling import jit
from ._path import AbstractInputPath

__all__ = [
    "AbstractInterpolation",
    "BandLimited",
    "Cubic",
    "Exact",
    "FunctionPath",
    "Linear",
    "PiecewisePolynomial",
    "Waveform",
]


def __dir__() -> list[str]:
    return __all__


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
        """Straight lines are, splines are not."""
        return self.coefficients.shape[-1] == 2

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


class Linear(AbstractInterpolation):
    """Straight lines between samples: right for triangles and ramps, safe always."""

    def path(self, t, u):
        return PiecewisePolynomial(t, _lines(t, u), 1)


class Cubic(AbstractInterpolation):
    """A cubic spline with not-a-knot ends: for smooth, well-sampled inputs.

    It overshoots at corners; use `Linear` for triangles and ramps.
    """

    def path(self, t, u):
        _check_enough(t)
        return PiecewisePolynomial(t, _pieces(t, u, "not-a-knot"), 1)


class BandLimited(AbstractInterpolation):
    """The trigonometric interpolant of one or more whole periods, evenly sampled.

    Exact for a multisine sampled above twice its highest frequency. It is evaluated
    on a grid `factor` times finer by the Fourier transform and by cubic splines
    between.

    The recording that it is given to must hold whole periods. Windows of that
    recording, and resampled ones, follow the same interpolant, as an `Exact` input.

    **Attributes:**

    - `factor`: how much finer than the samples the spline's knots are.
    """

    factor: int = eqx.field(static=True, default=8)

    def path(self, t, u):
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

    def path(self, t, u):
        return FunctionPath(t, self.function)


@jit
def _periodic(t, u, factor: int) -> Waveform:
    """The trigonometric interpolant by a spline, `factor` knots a sample."""
    n, fine = t.shape[0], t.shape[0] * factor
    spectrum = jnp.fft.rfft(u)
    if n % 2 == 0:  # the Nyquist line is shared by both halves of the spectrum
        spectrum = spectrum.at[-1].multiply(0.5)
    values = jnp.fft.irfft(spectrum, fine) * factor
    step = (t[-1] - t[0]) / (n - 1)
    times = jnp.linspace(t[0], t[-1] + step, fine + 1, dtype=t.dtype)
    pieces = _pieces(times, jnp.append(values, values[0]), "periodic")
    return Waveform(t[0], step / factor, pieces)


@jit
def _lines(t, u) -> Float[Array, "m 2"]:
    """Coefficients of the lines between samples, lowest power first."""
    return jnp.stack([u[:-1], jnp.diff(u) / jnp.diff(t)], axis=-1)


@jit
def _pieces(knots, values, ends: str) -> Float[Array, "m 4"]:
    """Coefficients of the cubic spline, lowest power first."""
    import interpax  # slow to import

    spline = interpax.CubicSpline(knots, values, bc_type=ends, check=False)
    return jnp.flip(spline.c, 0).T


def _check_enough(t) -> None:
    if t.shape[0] < 4:
        raise InputError(
            f"a cubic path needs at least 4 samples, got {t.shape[0]}; use "
            "`interpolation.Linear()`."
        )
