"""How an input runs between its samples: the choices a recording can carry."""

from abc import abstractmethod
from collections.abc import Callable

import equinox as eqx
import interpax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .. import _checks
from .._errors import InputError
from ._exact import FunctionPath
from ._path import AbstractInputPath
from ._piecewise import PiecewisePolynomial
from ._waveform import Waveform


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
        slope = jnp.diff(u) / jnp.diff(t)
        return PiecewisePolynomial(t, jnp.stack([u[:-1], slope], axis=-1), 1)


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
        _checks.evenly_spaced(
            "`interpolation.BandLimited`", t, "or use `interpolation.Cubic()`"
        )
        n, fine = t.shape[0], t.shape[0] * self.factor
        spectrum = jnp.fft.rfft(u)
        if n % 2 == 0:  # the Nyquist line is shared by both halves of the spectrum
            spectrum = spectrum.at[-1].multiply(0.5)
        values = jnp.fft.irfft(spectrum, fine) * self.factor
        step = (t[-1] - t[0]) / (n - 1)
        times = jnp.linspace(t[0], t[-1] + step, fine + 1, dtype=t.dtype)
        pieces = _pieces(times, jnp.append(values, values[0]), "periodic")
        return Waveform(t[0], step / self.factor, pieces)


class Exact(AbstractInterpolation):
    """The input is known: `function` gives it at any time.

    **Attributes:**

    - `function`: smooth map from a scalar time (s) to the input, written in JAX.
    """

    function: Callable

    def path(self, t, u):
        return FunctionPath(t, self.function)


def _pieces(knots, values, ends: str) -> Float[Array, "m 4"]:
    """Coefficients of the cubic spline, lowest power first."""
    spline = interpax.CubicSpline(knots, values, bc_type=ends, check=False)
    return jnp.flip(spline.c, 0).T


def _check_enough(t) -> None:
    if t.shape[0] < 4:
        raise InputError(
            f"a cubic path needs at least 4 samples, got {t.shape[0]}; use "
            "`interpolation.Linear()`."
        )
