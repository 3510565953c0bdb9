"""What drives a device at one time, or at many."""

from typing import NamedTuple

from jaxtyping import Array, Float


class Signals(NamedTuple):
    """The input of a device.

    **Attributes:** all of one shape.

    - `t`: time, s.
    - `u`, `du`: the input, and its derivative by time.
    """

    t: Float[Array, "*s"]
    u: Float[Array, "*s"]
    du: Float[Array, "*s"]


class Grid(NamedTuple):
    """The input along m steps of a solver with stages at the start, the middle and the
    end of each; it turns at ends of steps only.

    **Attributes:**

    - `steps`: lengths, shape (m,), s.
    - `start`, `middle`, `end`: signals of shape (m,), with the derivative inside of the
        step. Many flat arrays, which a loop over steps reads faster than a few with
        several columns.
    """

    steps: Float[Array, "*batch m"]
    start: Signals
    middle: Signals
    end: Signals
