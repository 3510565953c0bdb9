"""What a record tells of a law inside of a model: the signals that the model makes of
its input and output, and the equations of the law along them."""

from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from .._core import checks
from .._core.errors import InputError
from ..library import Library
from ..models import AbstractModel
from ..recording import Recording
from ..recording._noise import noise

_ABOVE = 4.0  # times the noise, that the power of the output is within its band
_ROLL = 1.25  # of the band's end, where nothing is left
_BANDS = 128  # parts of the spectrum, over which power is averaged
_RESOLVED = 2.0  # half width of test functions, in periods of the band's end
_TURN = 0.4  # and at least, in distances of the driver's turning points
_OVERLAP = 3  # test functions start this many to a half width
_FLATNESS = 4  # of their ends
_EDGE = 10.0  # periods of the band's end, near the record's, that are not looked at


class Seen(eqx.Module):
    """One record in the band in which its output is more than noise.

    **Attributes:** of n samples

    - `step`: between them, s.
    - `u`, `w`: input and output there, shape (n,).
    - `good`: of each test function, whether all that it looks at is known, shape (m,).
    - `half_width`: of test functions, in samples.
    - `first`, `stride`: where the first one begins, and from one to the next.
    """

    step: Float[Array, ""]
    u: Float[Array, " n"]
    w: Float[Array, " n"]
    good: Bool[Array, " m"]
    half_width: int = eqx.field(static=True)
    first: int = eqx.field(static=True)
    stride: int = eqx.field(static=True)

    def rate(self, x: Float[Array, " n"]) -> Float[Array, " n"]:
        """The time derivative of a signal without noise."""
        line, spectrum, frequencies = _spectrum(x, self.step)
        slope = (line[1] - line[0]) / self.step
        return _signal(2j * jnp.pi * frequencies * spectrum, len(x)) + slope

    def equations(
        self,
        model: AbstractModel,
        library: Library,
        rows: Int[Array | np.ndarray, " s"],
    ) -> tuple[Float[Array, "m s"], Float[Array, " m"]]:
        """The law inside of a model in the weak form: of some of the library's terms
        means over test functions, and of the law's rate. In the unit of that rate, for
        the size of what the law gives is not known."""
        signals = model.hidden_signals(self.u, self.w, self.rate)
        assert signals is not None  # as was asked before
        driver, made = signals
        terms = library(made, driver, self.rate(driver))[:, rows]
        x = jnp.linspace(-1, 1, 2 * self.half_width + 1, dtype=made.dtype)
        bump = (1 - x**2) ** _FLATNESS
        slope = -2 * _FLATNESS * x * (1 - x**2) ** (_FLATNESS - 1)
        whole, reach = jnp.sum(bump), self.half_width * self.step
        means = self._weighed(terms, bump / whole)
        return means, self._weighed(made, -slope / whole / reach)

    def _weighed(self, columns: Float[Array, "n *s"], weights: Float[Array, " w"]):
        """Sums under a moving window, zero where it sees what is not known."""
        count, tail = len(self.good), columns.shape[1:]
        rows = columns[self.first :][
            : (len(columns) - self.first) // self.stride * self.stride
        ]
        rows = rows.reshape(-1, self.stride, *tail)

        # Sums over shifted columns: windows side by side would take the memory of as
        # many records as there are samples in one.
        def add(sums, each):
            shift, weight = each
            start = shift // self.stride, shift % self.stride, *(0 for _ in tail)
            part = jax.lax.dynamic_slice(rows, start, (count, 1, *tail))
            return sums + weight * part[:, 0], None

        zeros = jnp.zeros((count, *tail), columns.dtype)
        each = jnp.arange(len(weights)), weights
        sums, _ = jax.lax.scan(add, zeros, each)
        return jnp.where(self.good.reshape(-1, *(1 for _ in tail)), sums, 0.0)


def tells(model: Any) -> bool:
    """Whether input and output of a model tell what the law inside of it does, up to
    numbers of the model."""
    if not isinstance(model, AbstractModel):
        return False
    few = jnp.zeros(4)
    return model.hidden_signals(few, few, lambda x: x) is not None


def seen(
    group: Sequence[Recording],
    model: AbstractModel,
    weights: Sequence[Float[Array, " _n"]] | None,
) -> tuple[Seen, ...]:
    """The records as a model's hidden law is seen in them, where they have weight.

    What is above the band in which the output is more than noise is left out of input
    and output alike: derivatives would be made of noise there. Beyond its ends a record
    is taken to go on as its mirror image by the end, which has no corner there.

    **Raises:** `InputError` for samples that are not evenly spaced, or have no clock.
    """
    each = [None] * len(group) if weights is None else weights
    pairs = zip(group, each, strict=True)
    return tuple(_seen(record, model, weight) for record, weight in pairs)


def _seen(record: Recording, model: AbstractModel, weight) -> Seen:
    from scipy.fft import prev_fast_len  # slow to import, and rarely needed

    checks.evenly_spaced(
        "a law that is seen through the derivatives of the output",
        record.t,
        "or give `size` and `key`, and the first laws are drawn at random",
    )
    model.check_times(record.t, record.clocked)
    checks.enough_samples("a hidden law", len(record), 50)
    step = (record.t[-1] - record.t[0]) / (len(record) - 1)
    # Of a length whose transform is fast: not many are left out.
    n = 1 + prev_fast_len(len(record) - 1, real=True)  # pyright: ignore[reportOperatorIssue]
    end = _end(*(np.asarray(x[:n]) for x in (record.t, record.w)))
    u, w = (_low(x[:n], step, end) for x in (record.u, record.w))
    whole = Seen(step, u, w, jnp.ones(1, bool), 1, 0, 1)
    signals = model.hidden_signals(u, w, whole.rate)
    assert signals is not None
    slopes = np.asarray(whole.rate(signals[0]))
    turns = np.count_nonzero(np.diff(np.sign(slopes)))
    period = 1 / (end * float(step))  # of the band's end, in samples
    half = max(_RESOLVED * period, _TURN * n / (turns + 1), 2.0)
    half = min(round(half), n // 8)
    edge = min(round(_EDGE * period), n // 8)
    known = np.ones(n, bool) if weight is None else np.asarray(weight[:n]) > 0
    known[:edge] = known[n - edge :] = False
    missing = np.concatenate([[0], np.cumsum(~known)])
    stride = max(1, half // _OVERLAP)
    starts = np.arange(0, n - 2 * half - stride, stride)
    good = missing[starts + 2 * half + 1] == missing[starts]
    some = np.flatnonzero(good)
    if not len(some):
        raise InputError(
            "too few samples in a row have weight for a hidden law to be seen in: "
            f"{2 * half + 1} are needed, and {edge} at each end of the recording are "
            "not looked at."
        )
    used = slice(some[0], some[-1] + 1)
    first = int(starts[used][0])
    return Seen(step, u, w, jnp.asarray(good[used]), half, first, stride)


def _end(t: Float[np.ndarray, " n"], w: Float[np.ndarray, " n"]) -> float:
    """The frequency above which an output is hardly more than noise, Hz."""
    step = (t[-1] - t[0]) / (len(t) - 1)
    _, spectrum, frequencies = map(np.asarray, _spectrum(jnp.asarray(w), step))
    width = max(8, len(frequencies) // _BANDS)
    power = np.convolve(np.abs(spectrum) ** 2, np.full(width, 1 / width), "same")
    # White noise has this power in each line of its mirrored record.
    above = np.flatnonzero(power > _ABOVE * 2 * len(w) * noise(w, t) ** 2)
    return float(frequencies[above[-1] if len(above) else -1])


def _low(x: Float[Array, " n"], step, end: float) -> Float[Array, " n"]:
    """A signal up to a frequency, without ringing."""
    line, spectrum, frequencies = _spectrum(x, step)
    beyond = jnp.clip((frequencies / end - 1) / (_ROLL - 1), 0, 1)
    return _signal(spectrum * jnp.cos(jnp.pi / 2 * beyond) ** 2, len(x)) + line


def _spectrum(x: Float[Array, " n"], step):
    """The line through a signal's ends; the spectrum of what is left, mirrored so that
    it goes on without a corner; and the frequencies, Hz."""
    line = jnp.linspace(x[0], x[-1], len(x), dtype=x.dtype)
    left = x - line
    mirrored = jnp.concatenate([left, -left[-2:0:-1]])
    frequencies = jnp.fft.rfftfreq(len(mirrored)) / step
    return line, jnp.fft.rfft(mirrored), frequencies


def _signal(spectrum, n: int) -> Float[Array, " n"]:
    return jnp.fft.irfft(spectrum, 2 * (n - 1))[:n]
