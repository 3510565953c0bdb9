"""All properties at once."""

from typing import NamedTuple

from jaxtyping import Array, Float

from .._jit import jit
from ..models import AbstractModel
from ._congruency import incongruency
from ._dissipation import Dissipation, dissipation
from ._drive import Drive
from ._memory import memory_loss
from ._monotonicity import Steepness, steepness
from ._rate import rate_dependence


class Properties(NamedTuple):
    """What each function of `hystjax.properties` returns.

    **Attributes:** `rate_dependence`, `incongruency` and `memory_loss`, scalars;
    `steepness`; `dissipation`.
    """

    rate_dependence: Float[Array, ""]
    steepness: Steepness
    incongruency: Float[Array, ""]
    memory_loss: Float[Array, ""]
    dissipation: Dissipation


@jit
def examine(model: AbstractModel, drive: Drive) -> Properties:
    """Every property of a model, with default settings.

    **Arguments:** any `model`; the `drive`, such as `Drive.like(recording)`.

    **Returns:** `Properties`; those of a model that diverges are not finite.
    """
    return Properties(
        rate_dependence(model, drive),
        steepness(model, drive),
        incongruency(model, drive),
        memory_loss(model, drive),
        dissipation(model, drive),
    )
