"""How an input runs between its samples: the choices a recording can carry."""

from abc import abstractmethod
from collections.abc import Callable

import equinox as eqx
import interpax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._checks import is_concrete
from .._errors import InputError
from ._exact import FunctionPath
from ._path import AbstractInputPath
from ._piecewise import PiecewisePolynomial


class AbstractInterpolation(eqx.Module):
    """Makes an input path from samples."""

    @abstractmethod
    def path(self, t: Float[Array, " n"], u: Float[Array, " n"]) -> AbstractInputPath:
        """The path through `u` (input units) at the times `t` (s)."""


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
        return _spline(t, t, u, 1)


class BandLimited(AbstractInterpolation):
    """The trigonometric interpolant of one or more whole periods, evenly sampled.

    Exact for a multisine sampled above twice its highest frequency. It is evaluated
    on a grid `factor` times finer by the Fourier transform and by cubic splines
    between.

    **Attributes:**

    - `factor`: how much finer than the samples the spline's knots are.
    """

    factor: int = eqx.field(static=True, default=8)

    def path(self, t, u):
        _check_even(t)
        n, fine = t.shape[0], t.shape[0] * self.factor
        spectrum = jnp.fft.rfft(u)
        if n % 2 == 0:  # the Nyquist line is shared by both halves of the spectrum
            spectrum = spectrum.at[-1].multiply(0.5)
        values = jnp.fft.irfft(spectrum, fine) * self.factor
        knots = (n - 1) * self.factor + 1
        times = jnp.linspace(t[0], t[-1], knots, dtype=t.dtype)
        return _spline(t, times, values[:knots], self.factor)


class Exact(AbstractInterpolation):
    """The input is known: `function` gives it at any time.

    **Attributes:**

    - `function`: smooth map from a scalar time (s) to the input, written in JAX.
    """

    function: Callable

    def path(self, t, u):
        return FunctionPath(t, self.function)


def _spline(t, knots, values, pieces: int) -> PiecewisePolynomial:
    if t.shape[0] < 4:
        raise InputError(
            f"a cubic path needs at least 4 samples, got {t.shape[0]}; use "
            "`interpolation.Linear()`."
        )
    spline = interpax.CubicSpline(knots, values, bc_type="not-a-knot", check=False)
    return PiecewisePolynomial(t, jnp.flip(spline.c, 0).T, pieces)


def _check_even(t) -> None:
    if not is_concrete(t):
        return
    steps = np.diff(np.asarray(t, np.float64))
    spread = np.ptp(steps) / np.mean(steps)
    if spread > 0.01:
        raise InputError(
            f"`interpolation.BandLimited` needs evenly sampled times, but the steps of "
            f"`t` vary by {spread:.1%}; resample first, or use `interpolation.Cubic()`."
        )
