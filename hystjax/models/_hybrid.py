"""A law, and a network for what it misses."""

from collections.abc import Sequence
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PRNGKeyArray

from .._core import checks
from .._core.checks import InputError
from .._core.compiling import changed
from ..recording import Recording, as_group
from ..saving import register
from ._around import AbstractWhole
from ._base import AbstractLaw
from ._numbers import leaf_parameters, numbers, optional, replace_leaves
from ._sparse import SparseModel

_INPUTS = 3  # of the network
_STEEP = 2.0  # standard deviation of what units are drawn with


def _blank(width: int, depth: int) -> "Hybrid":
    """Whatever the law and the numbers: both come from elsewhere."""
    law = SparseModel.from_terms({"du": 1.0})
    return Hybrid(law, _network(width, depth, jax.random.key(0)))


def _network(width: int, depth: int, key: PRNGKeyArray) -> eqx.nn.MLP:
    return eqx.nn.MLP(_INPUTS, "scalar", width, depth, jnp.tanh, key=key)


@register(like=_blank)
class Hybrid(AbstractWhole, AbstractLaw):
    """A law, and beside it a network N for what it misses:

        w' = law + (W / U) |u'| N((u - u0) / U, (w - w0) / W, u' / V)

    The network's part is in proportion to the speed of the input. Where that rests the
    law alone decides, so that the model settles where and as fast as the law does; and
    with tanh units N is bounded, so that far out what pulls the law's output back, such
    as -b w |u'|, wins. In between, while the input moves, N can undo the law's fading:
    `refine(..., fading=0.1)` keeps it, and `complete` asks for it.

    Its parameters are the law's, and the weights and biases of the network, such as
    `network.layers.0.weight[1,0]`. Its `numbers`, which reports list, are the law's.

    **Attributes:**

    - `law`: a law w' = f(w, u, u').
    - `network`: from three numbers to one, bounded units between; `untrained` makes it.
    - `centre`: u0 and w0, shape (2,), not fitted; zero by default.
    - `reach`: U and W, shape (2,), positive, not fitted; one by default.
    - `speed`: V, of the input, input units over s, not fitted. `None`, the default:
        the network gets the sign of u' instead, and the model is rate independent where
        the law is.
    - `names`, `units`: of input and output; keyword only.

    **Source:** Rackauckas et al. (2020), arXiv 2001.04385, for a network inside of a
    differential equation that is known but for a part.
    """

    law: AbstractLaw
    network: eqx.nn.MLP
    centre: Float[Array, "2"] = eqx.field(converter=numbers, default=(0.0, 0.0))
    reach: Float[Array, "2"] = eqx.field(converter=numbers, default=(1.0, 1.0))
    speed: Float[Array, ""] | None = eqx.field(converter=optional, default=None)

    _part: ClassVar[str] = "law"

    def __post_init__(self):
        if self.fitted_range is None and isinstance(self.law, AbstractLaw):
            self.fitted_range = self.law.fitted_range

    def __check_init__(self):
        check_law(self.law)
        checks.kind(
            "network",
            self.network,
            eqx.nn.MLP,
            "eqx.nn.MLP(3, 'scalar', 8, 1, key=key)",
        )
        inputs, outputs = self.network.in_size, self.network.out_size
        if (inputs, outputs) != (_INPUTS, "scalar"):
            raise InputError(
                f"`network` must make a 'scalar' of {_INPUTS} numbers, as an `eqx.nn."
                f"MLP({_INPUTS}, 'scalar', ...)` does; got one from {inputs} to "
                f"{outputs}."
            )
        for name in ("centre", "reach"):
            shape = getattr(self, name).shape
            if shape != (2,):
                raise InputError(
                    f"`{name}` must hold two numbers, of input and output; got an "
                    f"array of shape {shape}."
                )
        checks.positive("reach", self.reach)
        if self.speed is not None:
            checks.positive("speed", self.speed)

    @classmethod
    def untrained(
        cls,
        law: AbstractLaw,
        recordings: Recording | Sequence[Recording],
        *,
        width: int = 16,
        key: PRNGKeyArray,
    ) -> "Hybrid":
        """A law, and a network of one hidden layer that adds nothing yet, scaled to
        recordings. Of a rate-independent law it does not see how fast the input is.

        **Arguments:**

        - `law`: w' = f(w, u, u').
        - `recordings`: one, or several of one device.
        - `width`: units of the hidden layer; five numbers each, and one more.
        - `key`: a `jax.random` key, for the weights of the hidden layer.
        """
        checks.count("width", width)
        checks.key("key", key)
        check_law(law)
        each = as_group(recordings, "Hybrid.untrained(law, recordings)")
        u, w = (np.concatenate([getattr(r, x) for r in each]) for x in "uw")
        for name, column in (("u", u), ("w", w)):
            why = "a network cannot be scaled to it."
            checks.not_constant(name, jnp.asarray(column), why)
        slopes = np.concatenate([np.diff(r.u) / np.diff(r.t) for r in each])
        ends = np.array([[np.min(x), np.max(x)] for x in (u, w)])
        return cls(
            law,
            _drawn(_network(width, 1, key), key),
            jnp.asarray(np.mean(ends, axis=1)),
            jnp.asarray(np.ptp(ends, axis=1) / 2),
            None if law.rate_independent else np.sqrt(np.mean(slopes**2)),
            names=each[0].names,
            units=each[0].units,
        )

    @property
    def width(self) -> int:
        """Units of a hidden layer."""
        return self.network.width_size

    @property
    def depth(self) -> int:
        """Number of hidden layers."""
        return self.network.depth

    @property
    def size(self) -> int:
        """How many numbers it has, those of the law and of the network."""
        return len(self.parameters())

    @property
    def memory(self):
        return self.law.memory

    @property
    def rate_independent(self):
        return self.law.rate_independent if self.speed is None else False

    def fitted_on(self, known):
        return changed(super().fitted_on(known), law=self.law.fitted_on(known))

    def kinks(self, x):
        return self.law.kinks(x)

    def hidden_signals(self, u, w, rate):
        return None  # what it gives is not the law's alone

    def rate(self, x, m, now):
        return self.law.rate(x, m, now) + self.added(x, now.u, now.du)

    def added(
        self,
        w: Float[Array, ""],
        u: Float[Array, ""],
        du: Float[Array, ""],
    ) -> Float[Array, ""]:
        """What the network adds to the law's rate."""
        here = (jnp.stack([u, w]) - self.centre) / self.reach
        moving = jnp.sign(du) if self.speed is None else du / self.speed
        made = self.network(jnp.append(here, moving))
        return self.reach[1] / self.reach[0] * jnp.abs(du) * made

    def _own(self):
        return leaf_parameters({"network": self.network})

    def _with_own(self, values):
        network = replace_leaves({"network": self.network}, values)["network"]
        return eqx.tree_at(lambda model: model.network, self, network)

    def numbers(self):
        return self.law.numbers()

    def number_units(self):
        return changed(self.law, units=self.units).number_units()

    def text(self):
        widths = "-".join(map(str, [_INPUTS, *[self.width] * self.depth, 1]))
        moving = "its direction" if self.speed is None else "u'"
        return f"{self.law.text()} + |u'| times a network {widths} of u, w and {moving}"


def check_law(law: Any) -> None:
    """Raise `InputError` for what is no law of the rate."""
    if not isinstance(law, AbstractLaw) or law.target != "rate":
        raise InputError(
            "`law` must be a law of the rate, w' = f(w, u, u'), such as `discover` "
            f"finds; got {checks.described(law)}."
        )


def _drawn(network: eqx.nn.MLP, key: PRNGKeyArray) -> eqx.nn.MLP:
    """A network of one hidden layer, with units drawn at random of which nothing is let
    through yet. Inputs are about one in size: units bend within them, some sharply, and
    nowhere alike."""
    numbers, structure = jax.tree.flatten(network.layers[0])
    keys = jax.random.split(key, len(numbers))
    units = [
        _STEEP * jax.random.normal(each, x.shape, x.dtype)
        for each, x in zip(keys, numbers, strict=True)
    ]
    hidden = jax.tree.unflatten(structure, units)
    nothing = jax.tree.map(jnp.zeros_like, network.layers[1])
    return eqx.tree_at(lambda net: net.layers, network, (hidden, nothing))
