"""A butterfly: the square of a device that is not seen itself."""

import equinox as eqx
from jaxtyping import Array, Float

from ._base import AbstractModel
from ._numbers import number
from ._wrapper import AbstractWrapper


class Butterfly(AbstractWrapper):
    """The strain w = y^2 + offset of a device whose output y, a polarisation, is
    hidden.

    A loop of y becomes the wings of a butterfly. The sign of y leaves no trace in w:
    of a law and its mirror image, with -y for y, the data tell neither.

    **Attributes:**

    - `device`: the law of y, driven by the input; y is in roots of the output's unit.
    - `offset`: c, least output where y passes 0, output units.
    - `y0`: y at the first sample; 0 by default, for a device at rest.
    - `names`, `units`: of input and output w; keyword only.

    **Source:** Chandra et al. (2023), doi 10.1063/5.0146134, who take y for known.
    """

    device: AbstractModel
    offset: Float[Array, ""] = eqx.field(converter=number, default=0.0)
    y0: Float[Array, ""] = eqx.field(converter=number, default=0.0)

    @property
    def hidden(self):
        return True

    def rate(self, state, u, du):
        return self.device.rate(state, u, du)

    def start(self, w0, u0):
        return self.device.start(self.y0, u0)

    def observe(self, t, states):
        return self.device.observe(t, states) ** 2 + self.offset

    def text(self):
        law = str(self.device).replace("w", "y")
        return f"w = y^2 {float(self.offset):+.4g}, {law}"
