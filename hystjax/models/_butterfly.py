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

    def start(self, m, now, seen):
        return self.device.start(m, now, self.y0)

    def rate(self, x, m, now):
        return self.device.rate(x, m, now)

    def output(self, x, m, now):
        return self.device.output(x, m, now) ** 2 + self.offset

    def text(self):
        known = self.device.addends() is not None
        law = str(self.device).replace("w", "y") if known else f"y of {self.device}"
        return f"w = y^2 {float(self.offset):+.4g}, {law}"
