"""Converters for the fields of excitations: numbers in, checked arrays out."""

import operator
from abc import abstractmethod
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float, Real

from ..._core import checks
from ..._core.errors import InputError
from .._path import AbstractInputPath
from ..interpolation import AbstractInterpolation, Exact, FunctionPath, Linear


def scalar(name: str) -> Callable[[Any], jax.Array]:
    """A converter to a floating scalar that is finite."""

    def convert(value: Any) -> jax.Array:
        try:
            array = jnp.asarray(value)
        except (TypeError, ValueError):
            array = None
        if array is None or array.ndim or jnp.iscomplexobj(array):
            raise InputError(
                f"`{name}` must be one real number, got {value!r}. Many excitations at "
                "once are made with `jax.vmap`."
            )
        if checks.is_concrete(array) and not jnp.isfinite(array):
            raise InputError(f"`{name}` must be finite, got {value!r}.")
        return array.astype(jnp.result_type(float, array.dtype))

    return convert


def positive(name: str, *, zero: bool = False) -> Callable[[Any], jax.Array]:
    """A converter to a floating scalar that is finite and positive (or zero)."""
    to_scalar = scalar(name)

    def convert(value: Any) -> jax.Array:
        array = to_scalar(value)
        checks.positive(name, array, zero=zero)
        return array

    return convert


def count(name: str) -> Callable[[Any], int]:
    """A converter that lets whole numbers from 1 pass."""

    def convert(value: Any) -> int:
        try:
            number = operator.index(value)
        except TypeError:
            number = 0
        if number < 1:
            raise InputError(f"`{name}` must be a whole number from 1, got {value!r}.")
        return number

    return convert


_OFF_GRID = 1e-6  # of a sample interval: what rounding leaves of a time on the grid


class AbstractExcitation(eqx.Module):
    """An input u(t) known at every time."""

    @abstractmethod
    def __call__(self, t: Real[ArrayLike, ""]) -> Float[Array, ""]:
        """The input at the time `t`, s. Differentiable; for arrays use `jax.vmap`."""

    @abstractmethod
    def path(self, t: Real[ArrayLike, " n"]) -> AbstractInputPath:
        """The input path over the sample times `t`, shape (n,), s, strictly
        increasing.

        **Raises:** `InputError` for times that are not so, or too coarse.
        """

    @property
    @abstractmethod
    def interpolation(self) -> AbstractInterpolation:
        """How a recording under this excitation knows its input between samples."""


class AbstractSmooth(AbstractExcitation):
    """An excitation without corners. Sample it so that at most one turning point lies
    between two samples.
    """

    def path(self, t: Real[ArrayLike, " n"]) -> AbstractInputPath:
        """The exact path: between samples, too, it is this very function."""
        return FunctionPath(t=_times(t), function=self)

    @property
    def interpolation(self):
        """The exact function."""
        return Exact(self)


class AbstractPiecewiseLinear(AbstractExcitation):
    """Straight lines between corners; before the first and after the last corner the
    input rests.
    """

    @abstractmethod
    def corners(self) -> tuple[Float[Array, " m"], Float[Array, " m"]]:
        """Times (s, increasing) and inputs at the corners, the two ends included."""

    def __call__(self, t: Real[ArrayLike, ""]) -> Float[Array, ""]:
        """The input at the time `t`, s."""
        return jnp.interp(t, *self.corners())

    def samples(self, n_per_segment: int) -> Float[Array, " n"]:
        """Sample times with every corner among them: `n_per_segment` equal steps on
        each of the m - 1 straight lines, shape ((m - 1) n_per_segment + 1,), s.
        """
        steps = count("n_per_segment")(n_per_segment)
        times, _ = self.corners()
        fraction = jnp.arange(steps) / steps
        inner = times[:-1, None] + fraction * jnp.diff(times)[:, None]
        return jnp.append(inner.ravel(), times[-1])

    @property
    def interpolation(self):
        """Straight lines: right when every corner is sampled, as `path` requires."""
        return Linear()

    def path(self, t: Real[ArrayLike, " n"]) -> AbstractInputPath:
        """The path of straight lines between samples.

        **Raises:** `InputError` when a corner lies between samples, where a straight
        line would cut it off.
        """
        times = _times(t)
        corners = self.corners()
        if checks.is_concrete(times, *corners):
            _check_corners(np.asarray(times), np.asarray(corners[0]))
        return Linear().path(times, jnp.interp(times, *corners))


def _times(t: Real[ArrayLike, " n"]) -> Float[Array, " n"]:
    times = checks.vector("t", t)
    checks.enough_samples("an input path", times.shape[0], 2)
    checks.finite("t", times)
    checks.increasing("t", times)
    return times


def _check_corners(times: np.ndarray, corners: np.ndarray) -> None:
    inside = corners[(corners > times[0]) & (corners < times[-1])]
    after = np.searchsorted(times, inside)
    step = times[after] - times[after - 1]
    distance = np.minimum(inside - times[after - 1], times[after] - inside)
    rounding = 4 * np.finfo(times.dtype).eps * np.abs(inside)
    cut = inside[distance > np.maximum(_OFF_GRID * step, rounding)]
    if cut.size:
        raise InputError(
            f"{cut.size} corner(s) of the excitation lie between samples of `t`, the "
            f"first at {cut[0]:g} s; straight lines between samples would cut them "
            "off. Take `t` from `samples(n_per_segment)`, or choose a sampling period "
            "that divides the time between corners."
        )
