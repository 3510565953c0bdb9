"""What families are fitted to, and what a fit of one leaves."""

from collections.abc import Sequence
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from .._core.errors import InputError
from ..discovery._layout import Layout
from ..models import AbstractModel
from ..recording import Recording


class Case(NamedTuple):
    """Recordings of one device, the weights of their samples if these are not even, and
    how they are laid out in blocks."""

    group: tuple[Recording, ...]
    weights: Sequence[Float[Array, " _n"]] | None
    layout: Layout

    @property
    def clocked(self) -> bool:
        """Whether times are known."""
        return all(each.clocked for each in self.group)

    def check_clock(self) -> None:
        """That times are known.

        **Raises:** `InputError` if they are not.
        """
        if not self.clocked:
            raise InputError(
                "it depends on the rate, and the recordings have no clock."
            )

    @property
    def widest(self) -> Recording:
        """That whose input goes farthest, which shows most of a device."""
        return max(self.group, key=lambda each: float(jnp.ptp(each.u)))

    def padded(
        self, each: Sequence[Float[ArrayLike, "_n k"]]
    ) -> Float[np.ndarray, "r n k"]:
        """Columns along each recording, zero where it is shorter than others."""
        rows = [np.asarray(columns) for columns in each]
        whole = np.zeros((*self.layout.samples.w.shape, rows[0].shape[1]))
        for row, columns in zip(whole, rows, strict=True):
            row[: len(columns)] = columns
        return whole

    def errors(self, outputs: Float[np.ndarray, "b r n"]) -> Float[np.ndarray, " b"]:
        """The errors of fits: of those that each left out a block, on that block; of
        the last, to all samples, on all. Root mean squares of residuals over the range
        of their recording, so that recordings of any size count alike."""
        samples, blocks = self.layout.samples, np.asarray(self.layout.blocks)
        w, known = np.asarray(samples.w), np.asarray(samples.weight) > 0
        ranges = np.array([float(jnp.ptp(each.w)) for each in self.group])
        judged = [known & (blocks == block) for block in range(len(outputs) - 1)]
        with np.errstate(over="ignore"):
            squares = ((outputs - w) / ranges[:, None]) ** 2
            means = [
                np.mean(s[at]) for s, at in zip(squares, [*judged, known], strict=True)
            ]
        errors = np.sqrt(means)
        return np.where(np.isfinite(errors), errors, np.inf)


class Fit(NamedTuple):
    """A family fitted: the model fitted to all samples; the outputs of those fitted
    without each block, and of the model itself, shape (blocks + 1, R, n); how many
    numbers were fitted; and what is to be said."""

    model: AbstractModel
    outputs: Float[np.ndarray, "b r n"]
    numbers: int
    note: str = ""
