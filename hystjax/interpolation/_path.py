"""The input between its samples: one object for regression and simulation alike."""

from abc import abstractmethod
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

_BISECTIONS = 50  # halvings of a sample interval: down to rounding in float64


class AbstractInputPath(eqx.Module):
    """The input u(t) over the sample times `t`, with its one-sided derivative.

    Inside the sample interval `[t[i], t[i+1]]` the path is smooth but for at most one
    turning point; at sample times the derivative may jump, and then takes its value
    from the interval asked about.

    **Attributes:**

    - `t`: sample times, shape (n,), s.
    """

    t: Float[Array, " n"]

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
        self, time: Float[Array, " *s"]
    ) -> tuple[Float[Array, " *s"], Float[Array, " *s"]]:
        """u and du/dt (right limit at sample times) at any times, s."""
        last = self.t.shape[0] - 2
        index = jnp.clip(jnp.searchsorted(self.t, time, side="right") - 1, 0, last)
        start = self.t[index]
        fraction = (time - start) / (self.t[index + 1] - start)
        segments = jax.tree.map(lambda leaf: leaf[index], self.segments())
        evaluate = self.evaluate
        for _ in range(jnp.ndim(time)):
            evaluate = jax.vmap(evaluate)
        return evaluate(segments, fraction)

    def samples(self) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
        """u and du/dt at the sample times: right limits, the left one at the end."""
        start = jnp.zeros((self.t.shape[0] - 1, 1), self.t.dtype)
        u, du = self._everywhere(jnp.concatenate([start, start + 1], axis=1))
        return jnp.append(u[:, 0], u[-1, 1]), jnp.append(du[:, 0], du[-1, 1])

    def turning_fractions(self) -> Float[Array, " intervals"]:
        """Where in each sample interval the derivative changes sign: a fraction in
        (0, 1), or NaN where it does not. Shape (n - 1,)."""
        low = jnp.zeros_like(self.t[:-1])
        high = jnp.ones_like(low)
        if self.kinked:  # straight lines turn at their ends only
            return low * jnp.nan

        def slope(fraction):
            return jax.vmap(self.evaluate)(self.segments(), fraction)[1]

        start = slope(low)
        turns = start * slope(high) < 0

        def halve(_, bracket):
            low, high = bracket
            middle = (low + high) / 2
            before = slope(middle) * start > 0
            return jnp.where(before, middle, low), jnp.where(before, high, middle)

        low, high = jax.lax.fori_loop(0, _BISECTIONS, halve, (low, high))
        return jnp.where(turns, (low + high) / 2, jnp.nan)

    def jumps(self) -> Float[Array, " m"]:
        """Times at which |du/dt| has a kink or jump, sorted; padded with inf."""
        if self.kinked:
            return self.t
        fraction = self.turning_fractions()
        times = self.t[:-1] + fraction * jnp.diff(self.t)
        return jnp.sort(jnp.where(jnp.isnan(fraction), jnp.inf, times))

    def grid(
        self, substeps: int
    ) -> tuple[
        Float[Array, "m substeps"], Float[Array, "m stages"], Float[Array, "m stages"]
    ]:
        """Step lengths and input for a fixed-step solver with stages at the start,
        middle and end of each of `substeps` steps a sample interval.

        A turning point inside an interval is always a boundary between two steps.

        **Returns:** step lengths (n - 1, substeps) in s; u and du/dt, each
        (n - 1, 2 substeps + 1), at starts, middles and ends.
        """
        nodes = jnp.linspace(0, 1, substeps + 1, dtype=self.t.dtype)
        nodes = jnp.broadcast_to(nodes, (self.t.shape[0] - 1, substeps + 1))
        if not self.kinked:
            turning = self.turning_fractions()[:, None]
            nearest = jnp.clip(jnp.round(turning * substeps), 1, substeps - 1)
            nodes = jnp.where(jnp.arange(substeps + 1) == nearest, turning, nodes)
        middles = (nodes[:, :-1] + nodes[:, 1:]) / 2
        pairs = jnp.stack([nodes[:, :-1], middles], axis=-1)
        stages = jnp.column_stack([pairs.reshape(len(pairs), -1), nodes[:, -1]])
        u, du = self._everywhere(stages)
        return jnp.diff(nodes) * jnp.diff(self.t)[:, None], u, du

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
        if not self.kinked:
            times = np.asarray(self.jumps())
            times = times[np.isfinite(times)]
        else:
            _, slope = self.samples()
            sign = np.sign(np.asarray(slope[:-1]))
            moving = np.flatnonzero(sign)
            turned = np.flatnonzero(np.diff(sign[moving]))
            times = np.asarray(self.t)[moving[turned + 1]]
        return times, np.asarray(self.at(jnp.asarray(times))[0])
