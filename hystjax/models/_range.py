"""How far the inputs went that a law was fitted on, and where another leaves that."""

from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._core.checks import is_concrete
from .._core.show import quantity
from ..recording import Recording
from ..saving import Storable
from ._numbers import number, optional

# By which noise on an input takes one half of a record beyond the other: up to 3.5 % of
# its width, and 1.03 times as fast, on the measured recordings of `datasets`.
_WIDER, _FASTER = 0.05, 0.25
_MUCH = 0.01  # of the output's range, by which laws differ


class FittedRange(Storable):
    """How far and how fast the inputs went that a law was fitted on.

    **Attributes:**

    - `low`, `high`: least and greatest input, input units.
    - `fastest`: largest change of the input from one sample to the next over the time
        between, input units per s; `None` where there was no clock.
    - `apart`: by how much of the output's range laws that follow as well differ under
        inputs that go farther or at another rate; 0 where none are known.
    """

    low: Float[Array, ""] = eqx.field(converter=number)
    high: Float[Array, ""] = eqx.field(converter=number)
    fastest: Float[Array, ""] | None = eqx.field(converter=optional, default=None)
    apart: Float[Array, ""] = eqx.field(converter=number, default=0.0)

    @classmethod
    def of(cls, recordings: Sequence[Recording]) -> "FittedRange":
        """That of the inputs of some recordings."""
        xp = _numbers_of([(each.t, each.u) for each in recordings])
        every = [(xp.asarray(each.t), xp.asarray(each.u)) for each in recordings]
        ends = [(xp.min(u), xp.max(u)) for _, u in every]
        low, high = (xp.stack(side) for side in zip(*ends, strict=True))
        fastest = None
        if all(each.clocked for each in recordings):
            fastest = xp.max(xp.stack([xp.max(_speeds(xp, *each)) for each in every]))
        return cls(xp.min(low), xp.max(high), fastest)

    def left_by(
        self,
        t: Float[Array | np.ndarray, " n"],
        u: Float[Array | np.ndarray, " n"],
        any_rate: bool,
    ) -> "Beyond":
        """Where an input leaves the range.

        **Arguments:** times, s; the input there; and whether it may run at any rate, as
        it may where a law does not depend on that.
        """
        xp = _numbers_of(t, u, self)
        t, u = xp.asarray(t), xp.asarray(u)
        low, high = xp.asarray(self.low), xp.asarray(self.high)
        width = xp.where(high > low, high - low, 1.0)
        outside = xp.maximum(xp.maximum(u - high, low - u) / width, 0.0)
        faster = xp.zeros_like(outside)
        if self.fastest is not None and not any_rate:
            known = xp.asarray(self.fastest)
            fastest = xp.where(known > 0, known, 1.0)
            speeds = _speeds(xp, t, u)
            faster = xp.maximum(xp.append(speeds, speeds[-1]) / fastest - 1, 0.0)
        gone = (outside > _WIDER) | (faster > _FASTER)
        since = xp.min(xp.where(gone, t, xp.inf))
        found = xp.max(outside), xp.max(faster), since
        return Beyond(*map(jnp.asarray, found))

    def __str__(self) -> str:
        if not is_concrete(*jax.tree.leaves(self)):
            return repr(self)
        return f"inputs from {self.in_words('')}"

    def in_words(self, unit: str) -> str:
        """Such as `-150 V to 150 V, up to 943 V per s`. For concrete ranges only."""
        low, high = (quantity(float(end), unit) for end in (self.low, self.high))
        if self.fastest is None:
            return f"{low} to {high}"
        return f"{low} to {high}, up to {quantity(float(self.fastest), unit)} per s"


class Beyond(eqx.Module):
    """How far an input leaves what a law was fitted on.

    **Attributes:**

    - `input`: the farthest that it is outside of the fitted inputs, over their width; 0
        where it stays inside.
    - `rate`: by how much its fastest change is faster than any that was fitted, over
        that; 0 where it is not, where the law does not depend on the rate, or where
        there was no clock.
    - `since`: the time from which that is more than what noise on an input does, 5 % of
        the width or 25 % of the rate, s; inf where it never is.
    """

    input: Float[Array, ""]
    rate: Float[Array, ""]
    since: Float[Array, ""]

    @property
    def noticed(self) -> bool:
        """Whether that is more than what noise on an input does. For concrete numbers
        only."""
        return bool(np.isfinite(np.asarray(self.since)))

    def in_words(self, fitted: FittedRange, unit: str) -> str:
        """What is said of it where it is `noticed`. For concrete numbers only."""
        said = []
        if self.input > _WIDER:
            said.append(f"goes outside by {100 * float(self.input):.3g} % of the width")
        if self.rate > _FASTER:
            said.append(f"runs {1 + float(self.rate):.3g} times as fast")
        share = float(fitted.apart)
        others = (
            f" Laws that follow as well differ by some {100 * share:.2g} % of the "
            "output's range there."
            if share > _MUCH
            else ""
        )
        return (
            f"from t = {float(self.since):g} s on the input leaves what this law was "
            f"fitted on ({fitted.in_words(unit)}): it {' and '.join(said)}. Nothing is "
            "known of the law there; fit it on a record that goes as far, or judge it "
            f"by one.{others}"
        )


def _numbers_of(*trees: Any) -> Any:
    """NumPy where all values are known, for which JAX would compile programs."""
    return np if is_concrete(*jax.tree.leaves(trees)) else jnp


def _speeds(xp: Any, t: Any, u: Any) -> Any:
    """The change of an input over each sample interval, input units per s."""
    return xp.abs(xp.diff(u) / xp.diff(t))
