"""A device seen through its instruments."""

import equinox as eqx
import interpax
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..library import AbstractMemory
from ..signals import Signals
from ._base import AbstractModel
from ._named import field_parameters
from ._numbers import optional
from ._wrapper import AbstractWrapper


def comes_late(model: AbstractModel) -> bool:
    """Whether what is recorded of a model is not its output itself, but that of another
    time: no step from one sample to the next can know it then."""
    some = jnp.zeros(3)
    traced = jax.make_jaxpr(model.recorded)(some, some).jaxpr
    return traced.outvars[0] is not traced.invars[1]


class Instrumented(AbstractWrapper):
    """A model behind a gain and an offset at its input, and a gain, an offset and a
    delay at its output:

        y: the device's output under  input_gain u(t) + input_offset
        w(t) = output_gain y(t - delay) + output_offset

    What is left out is ideal, and no parameter; the others can be fitted by `refine`,
    beside the device's own parameters. Not all can be told apart: the scale of a law's
    coefficients is one with a gain, for example, and a fixed `input_gain` or fixed
    coefficients settle that. `refine` says what the data leave open.

    Within the `delay` after the first sample the output is taken to have stood still;
    between samples it is a local cubic spline.

    **Attributes:**

    - `device`: the model behind.
    - `input_gain`: device's input over recorded input, a scalar.
    - `input_offset`: in units of the device's input.
    - `output_gain`: recorded output over device's output.
    - `output_offset`: in units of the recorded output.
    - `delay`: s, by which the recorded output comes late; negative if it comes early.
    - `names`, `units`: of the recorded input and output; keyword only.
    """

    device: AbstractModel
    input_gain: Float[Array, ""] | None = eqx.field(converter=optional, default=None)
    input_offset: Float[Array, ""] | None = eqx.field(converter=optional, default=None)
    output_gain: Float[Array, ""] | None = eqx.field(converter=optional, default=None)
    output_offset: Float[Array, ""] | None = eqx.field(converter=optional, default=None)
    delay: Float[Array, ""] | None = eqx.field(converter=optional, default=None)

    @property
    def hidden(self):
        return self.device.hidden

    @property
    def memory(self):
        return Driven(self.device.memory, self.input_gain, self.input_offset)

    def start(self, m, now, seen):
        return self.device.start(m, self.memory.inside(now), self._behind(seen))

    def rate(self, x, m, now):
        return self.device.rate(x, m, self.memory.inside(now))

    def output(self, x, m, now):
        y = self.device.output(x, m, self.memory.inside(now))
        return _plus(self.output_offset, _times(self.output_gain, y))

    def hidden_signals(self, u, w, rate):
        if self.delay is not None:
            return None
        inside = _plus(self.input_offset, _times(self.input_gain, u))
        return self.device.hidden_signals(inside, self._behind(w), rate)

    def recorded(self, t, w):
        return w if self.delay is None else _at(t - self.delay, t, w)

    def _behind(self, w):
        """The device's output, of a recorded one."""
        gain = 1.0 if self.output_gain is None else self.output_gain
        offset = 0.0 if self.output_offset is None else self.output_offset
        return (w - offset) / gain

    def text(self):
        own = ", ".join(f"{k} = {x:.4g}" for k, x in field_parameters(self).items())
        return f"{self.device} ({own or 'ideal instruments'})"


class Driven(AbstractMemory):
    """The memory of a device behind a gain and an offset at its input.

    **Attributes:** the `device`'s memory, and the `gain` and `offset`, if there are.
    """

    device: AbstractMemory
    gain: Float[Array, ""] | None
    offset: Float[Array, ""] | None

    def inside(self, now: Signals) -> Signals:
        """What the device sees of the input."""
        u = _plus(self.offset, _times(self.gain, now.u))
        return Signals(now.t, u, _times(self.gain, now.du))

    def start(self, now):
        return self.device.start(self.inside(now))

    def after(self, m, before, now):
        return self.device.after(m, self.inside(before), self.inside(now))

    def values(self, m, now):
        return self.device.values(m, self.inside(now))


def _times(gain, value):
    return value if gain is None else gain * value


def _plus(offset, value):
    return value if offset is None else value + offset


def _at(times: Float[Array, " n"], t: Float[Array, " n"], y: Float[Array, " n"]):
    """The output at other times; before the first sample and after the last one it
    stands still."""
    if t.shape[0] < 2:
        return y
    return interpax.interp1d(jnp.clip(times, t[0], t[-1]), t, y, method="cubic")
