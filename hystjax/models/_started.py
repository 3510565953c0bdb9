"""A device whose memory starts from a known state, or one that is fitted."""

from typing import Any

import equinox as eqx

from ..library import AbstractMemory, at
from ..signals import Signals
from ._base import AbstractModel
from ._named import leaf_parameters, replace_leaves
from ._wrapper import AbstractWrapper


class Started(AbstractWrapper):
    """A device of whose past nothing is known but what its memory is at first.

    Windows of a recording remember the input before them, and other recordings are
    taken to start from a memory at rest. Where neither holds, as for a device that was
    driven before anyone recorded it, the state of its memory is one of the unknowns:
    its numbers are parameters, named `state[...]`, which `refine` fits beside the
    device's own. What came before a recording is not looked at.

    All recordings that are fitted together start from the one state. What the input
    wipes out within them is known as well as it can be seen before that; of a play
    whose signal never differs from that of a start at rest nothing is. Plays forget in
    leaps, and with them the sum of squares falls in leaps: several `starts` help.

    **Attributes:**

    - `device`: the model inside.
    - `state`: of its memory, a PyTree of arrays as `memory.start` returns; moved to
        what the first input allows, so that a play is never further than its radius
        from it.
    - `names`, `units`: of input and output; keyword only.
    """

    device: AbstractModel
    state: Any

    @classmethod
    def at_rest(cls, device: AbstractModel, recording: Any) -> "Started":
        """The device as it is taken to start on a recording: from what came before it
        where that is known, else at rest."""
        state = device.memory.first(recording.path)
        return cls(device, state, names=device.names, units=device.units)

    @property
    def memory(self):
        return Resumed(self.device.memory, self.state)

    @property
    def hidden(self):
        return self.device.hidden

    def start(self, m, now, seen):
        return self.device.start(m, now, seen)

    def rate(self, x, m, now):
        return self.device.rate(x, m, now)

    def output(self, x, m, now):
        return self.device.output(x, m, now)

    def recorded(self, t, w):
        return self.device.recorded(t, w)

    def parameters(self):
        return self.device.parameters() | leaf_parameters({"state": self.state})

    def with_parameters(self, values):
        own = leaf_parameters({"state": self.state})
        changed = {name: x for name, x in values.items() if name in own}
        state = replace_leaves({"state": self.state}, changed)["state"]
        inner = {name: x for name, x in values.items() if name not in own}
        device = self.device.with_parameters(inner)
        return eqx.tree_at(lambda m: (m.device, m.state), self, (device, state))

    def text(self):
        own = leaf_parameters({"state": self.state})
        told = ", ".join(f"{name} = {x:.4g}" for name, x in own.items())
        return f"{self.device} ({told})"


class Resumed(AbstractMemory):
    """A memory that starts from a state that is given.

    **Attributes:** the `memory`, and its `state`.
    """

    inside: AbstractMemory
    state: Any

    @property
    def needs_past(self):
        return False

    def start(self, now: Signals):
        # A step of no length moves a state to what the input allows, and no further.
        return self.inside.after(self.state, now, now)

    def first(self, path):
        return self.start(at(path.signals(), 0))

    def after(self, m, before, now):
        return self.inside.after(m, before, now)

    def along(self, m, grid):
        return self.inside.along(m, grid)

    def values(self, m, now):
        return self.inside.values(m, now)
