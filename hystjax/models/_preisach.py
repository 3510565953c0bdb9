"""Relays in parallel: the operator of Preisach, on a grid or by an Everett function."""

from dataclasses import replace
from functools import partial

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from .._core import checks
from .._core.checks import InputError
from ..library import Plays, Staircase, check_initial
from ..recording import Recording
from ._base import AbstractOperatorLaw
from ._numbers import Numbers, number, numbers
from ._prandtl_ishlinskii import best_sum, inputs_by_travel, inputs_of, signals_of

_LEVELS = 12  # rows and columns of relays that `guess` tries
_RADII, _CENTRES = 8, 10  # of the plane in radii and centres, likewise


class Preisach(AbstractOperatorLaw):
    """Relays in parallel: w = offset + sum of weights[i, j] times 1 or -1.

    The relay (i, j), i >= j, turns up where the input comes to `levels[i + 1]` and down
    where it comes back to `levels[j]`. A sample costs as much as there are levels, not
    relays: see `library.Staircase`.

    Derivatives with respect to `levels` and to the input are zero, as they are almost
    everywhere: fix the levels, and find weights by `guess`; or use `Everett`.

    **Attributes:**

    - `levels`: shape (L + 1,), input units, rising.
    - `weights`: output units, shape (L (L + 1) / 2,), those of the row i = 0 first, in
        each row from j = 0 to i; a matrix (L, L), which is zero where j > i, is taken
        too. Positive for loops that the output runs through counter-clockwise.
    - `offset`: a scalar, output units, 0 by default.
    - `initial`: how relays stand before the first input: `"demagnetised"`, up below the
        middle of the levels and down above it; or all `"up"` or `"down"`.
    - `names`, `units`: of input and output; keyword only.

    **Raises:** `InputError` for levels that do not rise, another number of weights, or
    an unknown `initial`.

    **Source:** Preisach (1935), doi 10.1007/BF01349418; Mayergoyz (1991), doi
    10.1007/978-1-4612-3028-1.
    """

    levels: Float[Array, " n"] = eqx.field(converter=numbers)
    weights: Float[Array, " _r"]
    offset: Float[Array, ""] = eqx.field(converter=number, default=0.0)
    initial: str = eqx.field(static=True, default="demagnetised")

    def __init__(
        self,
        levels: Numbers,
        weights: Numbers,
        offset: ArrayLike = 0.0,
        initial: str = "demagnetised",
        *,
        names: tuple[str, str] = ("input", "output"),
        units: tuple[str, str] = ("", ""),
    ):
        self.levels, self.offset, self.initial = (
            numbers(levels),
            number(offset),
            initial,
        )
        self.weights = _packed(numbers(weights))
        self.names, self.units = names, units

    def __check_init__(self):
        check_initial(self.initial)
        checks.increasing("levels", self.levels)
        rows = self.levels.shape[-1] - 1
        if self.weights.shape[-1] != rows * (rows + 1) // 2 or rows < 1:
            raise InputError(
                f"{rows + 1} levels make {rows * (rows + 1) // 2} relays, one for each "
                f"pair; got {self.weights.shape[-1]} `weights`."
            )

    @classmethod
    def guess(cls, recording: Recording) -> "Preisach":
        """A first model read off a record: levels evenly over the input's range, and
        weights of one sign by least squares.

        **Raises:** `InputError` where input or output never change.
        """
        low, high = inputs_of(cls.__name__, recording)
        levels = jnp.linspace(low, high, _LEVELS + 1, dtype=recording.u.dtype)
        zero = cls(levels, jnp.zeros(_LEVELS * (_LEVELS + 1) // 2, levels.dtype))
        heights = signals_of(zero.memory, recording)
        i, j = np.tril_indices(_LEVELS)
        up = jnp.where(heights[:, j] > i, 1.0, -1.0)
        # The input reaches the first and the last level in one sample only: what turns
        # there hardly shows, and least squares leaves it out.
        _, _, weights, offset = best_sum([up], recording.w)
        names, units = recording.names, recording.units
        return cls(levels, weights, offset, names=names, units=units)

    @property
    def memory(self):
        return Staircase(self.levels, self.initial)

    def output(self, x, m, now):
        # Sums down the columns, of which the staircase picks one entry each.
        sums = jnp.cumsum(self.plane(), axis=0)
        sums = jnp.concatenate([jnp.zeros_like(sums[:1]), sums])
        up = jnp.sum(jnp.take_along_axis(sums, m[None].astype(int), axis=0))
        return self.offset + 2 * up - jnp.sum(self.weights)

    def plane(self) -> Float[Array, "L L"]:
        """The weights as a matrix: row i for the upper threshold, column j for the
        lower."""
        rows = self.levels.shape[0] - 1
        return (
            jnp.zeros((rows, rows), self.weights.dtype)
            .at[np.tril_indices(rows)]
            .set(self.weights)
        )


class Everett(AbstractOperatorLaw):
    """The operator of Preisach by a smooth function of each play,

        w = offset + sum of G_k(play(u, radii[k])),

    each G_k rising, straight between `centres` and constant beyond: a density on the
    plane of thresholds, in the coordinates r, half of the distance of a relay's
    thresholds, and their mean. Its Everett function has the derivatives that grids of
    relays lack, in every number and in the input.

    **Attributes:**

    - `radii`: shape (k,), input units, from 0.
    - `centres`: shape (s + 1,), input units, rising.
    - `roots`: shape (k, s): by their squares, output units, G_k rises from one centre
        to the next, so that no fit makes it fall.
    - `offset`: the output in the middle of all G_k, a scalar, output units.
    - `sign`: 1, or -1 for an output that falls with its input.
    - `names`, `units`: of input and output; keyword only.

    **Source:** Everett (1955), doi 10.1039/TF9555101551; by plays Brokate and Sprekels
    (1996), doi 10.1007/978-1-4612-4048-8.
    """

    radii: Float[Array, " k"] = eqx.field(converter=numbers)
    centres: Float[Array, " n"] = eqx.field(converter=numbers)
    roots: Float[Array, "k s"] = eqx.field(converter=numbers)
    offset: Float[Array, ""] = eqx.field(converter=number, default=0.0)
    sign: int = eqx.field(static=True, default=1)

    def __check_init__(self):
        checks.increasing("centres", self.centres)
        expected = self.radii.shape[-1], self.centres.shape[-1] - 1
        if self.roots.shape[-2:] != expected:
            raise InputError(
                "`roots` must have a row for each radius and a column for each pair "
                f"of neighbouring centres, shape {expected}; got {self.roots.shape}."
            )
        if self.sign not in (1, -1):
            raise InputError(f"`sign` must be 1 or -1, got {self.sign!r}.")

    @classmethod
    def guess(cls, recording: Recording) -> "Everett":
        """A first model read off a record: radii and centres over the input's range,
        denser where the output changes, and what each G_k rises by from least squares.

        **Raises:** `InputError` where input or output never change.
        """
        inputs = partial(inputs_by_travel, cls.__name__, recording)
        dtype = recording.u.dtype
        aside = np.linspace(0, 0.5, _RADII, endpoint=False)
        radii = jnp.asarray((inputs(0.5 + aside) - inputs(0.5 - aside)) / 2, dtype)
        centres = jnp.asarray(inputs(np.linspace(0, 1, _CENTRES + 1)), dtype)
        roots = jnp.zeros((_RADII, _CENTRES), dtype)
        names, units = recording.names, recording.units
        flat = cls(radii, centres, roots, names=names, units=units)
        return flat.fitted(flat.ramps(recording), recording.w)

    def ramps(self, recording: Recording) -> Float[Array, "n ks"]:
        """How far each G_k has risen from each centre to the next, from 0 to 1, at the
        samples of a record."""
        plays = signals_of(self.memory, recording)
        return _ramps(plays, self.centres).reshape(len(plays), -1)

    def fitted(
        self,
        ramps: Float[Array, "n ks"],
        w: Float[Array, " n"],
        weight: Float[Array, " n"] | None = None,
    ) -> "Everett":
        """The same radii and centres with what least squares makes of the rises, all of
        one sign.

        **Arguments:** the `ramps` of one record or several, one after the other; the
        output there; and how much each sample counts, all the same by default.
        """
        _, sign, weights, offset = best_sum([ramps], w, weight)
        rises = jnp.asarray(sign * weights, w.dtype).reshape(self.roots.shape)
        middle = jnp.asarray(offset + sign * jnp.sum(rises) / 2, w.dtype)
        return replace(self, roots=jnp.sqrt(rises), offset=middle, sign=int(sign))

    @property
    def memory(self):
        return Plays(jnp.where(self.radii < 0, -self.radii, self.radii))

    def output(self, x, m, now):
        rises = self.roots**2
        return self.offset + self.sign * jnp.sum(
            rises * (_ramps(m, self.centres) - 0.5)
        )

    def everett(
        self, high: Float[ArrayLike, "*a"], low: Float[ArrayLike, "*b"]
    ) -> Float[Array, "*s"]:
        """By how much the output falls where the input, having risen to `high` from
        far below, comes down to `low`; output units."""
        high, low = jnp.broadcast_arrays(jnp.asarray(high), jnp.asarray(low))
        top = high[..., None] - self.radii
        end = jnp.minimum(top, low[..., None] + self.radii)
        fall = _ramps(top, self.centres) - _ramps(end, self.centres)
        return self.sign * jnp.sum(self.roots**2 * fall, axis=(-2, -1))


def _ramps(p: Float[Array, "*s"], centres: Float[Array, " n"]) -> Float[Array, "*s _m"]:
    """From 0 to 1 between each centre and the next, at several plays."""
    return jnp.clip((p[..., None] - centres[:-1]) / jnp.diff(centres), 0, 1)


def _packed(weights: Array) -> Array:
    """Weights of relays as a vector."""
    if weights.ndim < 2 or weights.shape[-1] != weights.shape[-2]:
        return weights
    i, j = np.tril_indices(weights.shape[-1])
    return weights[..., i, j]
