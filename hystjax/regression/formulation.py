"""From samples to equations that are linear in the coefficients of a law."""

from abc import abstractmethod
from functools import partial
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._core import checks
from .._core.checks import InputError
from ..library import Library
from ..models._base import in_jax
from ..signals import AbstractInputPath
from .differentiation import AbstractDifferentiation

__all__ = [
    "AbstractFormulation",
    "AbstractPointwise",
    "Direct",
    "Pointwise",
    "WeakForm",
]


def __dir__() -> list[str]:
    return __all__


class AbstractFormulation(eqx.Module):
    """Makes linear equations for the k coefficients of a law.

    **Attributes:** `target`, what the law then gives: the `"rate"` w' or the `"value"`
    w.
    """

    target: ClassVar[str] = "rate"

    @abstractmethod
    def equations(
        self, library: Library, path: AbstractInputPath, w: Float[Array, " n"]
    ) -> tuple[Float[Array, "m k"], Float[Array, " m"]]:
        """Left sides, one column a term, and right sides.

        **Arguments:** the candidate terms; the input; and the output at its sample
        times.

        **Raises:** `InputError` when there are too few samples.
        """

    def count(self, samples: int) -> int:
        """How many equations so many samples make, by default one each.

        **Raises:** `InputError` when there are too few samples.
        """
        return samples

    def weights(self, samples: Float[Array, " n"]) -> Float[Array, " m"]:
        """How much each equation counts, by the weights of the samples: as the least of
        those that it looks at; by default there is one a sample, which looks at no
        other."""
        return samples


def _least(x: Float[Array, " n"], width: int, stride: int, ends: str) -> Array:
    """The least of so many neighbours, where all are there or at every sample."""
    start = np.array(np.inf, x.dtype)
    return jax.lax.reduce_window(x, start, jax.lax.min, (width,), (stride,), ends)


class AbstractPointwise(AbstractFormulation):
    """One equation a sample, of what is known there."""

    @abstractmethod
    def samples(
        self, path: AbstractInputPath, w: Float[Array, " n"]
    ) -> tuple[Float[Array, " n"], ...]:
        """Output, input and its derivative at the samples, and what the terms are to
        add up to there."""

    def equations(self, library, path, w):
        value, u, du, target = self.samples(path, w)
        # What terms remember of the input is exact.
        return library(value, u, du, library.signals(path)), target


class Pointwise(AbstractPointwise):
    """The derivative of the output, estimated at each sample, is the sum of the terms.

    Output and input pass through the same differentiation (and its smoothing), so that
    its bias is the same on both sides of the law.

    **Attributes:**

    - `differentiation`: the estimate.
    """

    differentiation: AbstractDifferentiation

    def __check_init__(self):
        such_as = "differentiation.FiniteDifference()"
        checks.kind(
            "differentiation", self.differentiation, AbstractDifferentiation, such_as
        )

    def samples(self, path, w):
        value, slope = self._estimate(path.t, w)
        u, du = self._estimate(path.t, path.samples()[0])
        return value, u, du, slope

    def _estimate(
        self, t: Float[Array, " n"], y: Float[Array, " n"]
    ) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
        """That of the differentiation, which may be one's own."""
        answer = f"`estimate` of {type(self.differentiation).__name__}"
        with in_jax(answer):
            found = self.differentiation.estimate(t, y)
        pair = isinstance(found, tuple | list) and len(found) == 2
        shapes = [getattr(each, "shape", None) for each in found] if pair else []
        if shapes != [t.shape] * 2:
            got = " and ".join(map(checks.described, found if pair else (found,)))
            raise InputError(
                f"{answer} must return two arrays of shape {t.shape}, the signal and "
                f"its derivative; got {got}."
            )
        return found

    def weights(self, samples):
        # Of a spline, which is fitted to all samples, those of weight 0 are refused.
        n, reach = len(samples), self.differentiation.reach or 1
        least = _least(samples, 2 * reach + 1, 1, "SAME")
        # Estimates near the ends are of the first and the last samples that have all.
        return least[np.clip(np.arange(n), reach, n - 1 - reach)]


class Direct(AbstractPointwise):
    """The output at each sample is the sum of the terms: laws w = f(u) of what the
    input decides, as Prandtl-Ishlinskii operators are. Nothing is differentiated.

    Terms that hold the output, or functions of one's own, which might, are refused.
    """

    target: ClassVar[str] = "value"

    def samples(self, path, w):
        return w, *path.samples(), w


_OVERLAP = 16  # test functions start this many to a half width


class WeakForm(AbstractFormulation):
    """The law weighed with test functions phi over short stretches of time,

        sum of c_j  integral of phi theta_j dt  =  - integral of phi' w dt,

    so that the noisy output is never differentiated. phi = (1 - x^2)^4 with x from -1
    to 1. The integrals are sums over the intervals between samples, over each of which
    phi is integrated in closed form, terms are as in its middle, and the output is a
    straight line: a turning point at a sample costs no accuracy, and neither does an
    output far from zero at times that are not evenly spaced.

    **Attributes:**

    - `half_width`: of a test function, in samples, at least 2: a wide one averages much
        noise, and is blind to what happens within it. A third to a half of the samples
        from one turning point of the input to the next does well.

    **Source:** Messenger and Bortz (2021), doi 10.1137/20M1343166.
    """

    half_width: int = eqx.field(
        converter=partial(checks.count, "half_width", least=2), static=True, default=20
    )

    @property
    def _stride(self) -> int:
        return max(1, self.half_width // _OVERLAP)

    def count(self, samples):
        m, smaller = self.half_width, "a smaller `half_width`"
        checks.enough_samples(f"`WeakForm({m})`", samples, 2 * m + 1, smaller)
        return len(range(0, samples - 2 * m, self._stride))

    def weights(self, samples):
        return _least(samples, 2 * self.half_width + 1, self._stride, "VALID")

    def equations(self, library, path, w):
        n, m = path.t.shape[0], self.half_width
        self.count(n)  # of which there must be some
        h = jnp.diff(path.t)
        middle = path.t[:-1] + h / 2
        output = (w[:-1] + w[1:]) / 2
        u, du = path.at(middle)
        regressors = library(output, u, du, library.signals(path, middle))
        # By parts: of a straight line - integral of phi' w = slope * integral of phi.
        columns = jnp.concatenate([regressors, (jnp.diff(w) / h)[:, None]], axis=1)
        starts = jnp.arange(0, n - 2 * m, self._stride)

        def weighed(start):
            times = path.t[start + jnp.arange(2 * m + 1)]
            reach = (times[-1] - times[0]) / 2
            phi = reach * jnp.diff(_area((times - times[0]) / reach - 1))
            both = phi @ columns[start + jnp.arange(2 * m)]
            return both[:-1], both[-1]

        return jax.vmap(weighed)(starts)


def _area(x: Float[Array, " n"]) -> Float[Array, " n"]:
    """An antiderivative of (1 - x^2)^4."""
    return x - 4 * x**3 / 3 + 6 * x**5 / 5 - 4 * x**7 / 7 + x**9 / 9
