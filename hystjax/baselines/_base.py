"""What a baseline is."""

from abc import abstractmethod

import equinox as eqx
import jax
from jaxtyping import Array, ArrayLike, Float, Int, PRNGKeyArray

from .._errors import InputError
from .._recording import Recording
from .._regressors import differentiated
from .._solution import Solution
from ..differentiation import AbstractDifferentiation, FiniteDifference
from ..interpolation import Signals
from ..library import Library, Track
from ..models import AbstractModel

Rows = Int[ArrayLike, " r"]


class AbstractBaseline(eqx.Module):
    """Another way from a recording to a model.

    Free run and errors are those of every model: `simulate` and `judge` take the
    `value` of what `fit` returns.
    """

    @abstractmethod
    def fit(self, recording: Recording, *, key: PRNGKeyArray | None = None) -> Solution:
        """Fit a model.

        **Arguments:**

        - `recording`: of n samples.
        - `key`: a `jax.random` key, for what starts at random.

        **Returns:** a `Solution` whose `value` is an `AbstractModel` or an
        `AbstractSequenceModel`.
        """


class AbstractRateBaseline(AbstractBaseline):
    """A baseline that learns the derivative of the output from given features of a
    sample.

    **Attributes:**

    - `library`: the k features.
    - `differentiation`: how derivatives are estimated, of output and input alike.
    """

    library: eqx.AbstractVar[Library]
    differentiation: eqx.AbstractVar[AbstractDifferentiation]

    @abstractmethod
    def fit(
        self,
        recording: Recording,
        *,
        key: PRNGKeyArray | None = None,
        rows: Rows | None = None,
    ) -> Solution:
        """As every baseline's, with `rows` for the numbers of the samples that are
        fitted, all by default."""

    def rows(
        self, recording: Recording, rows: Rows | None
    ) -> tuple[Float[Array, "r k"], Float[Array, " r"]]:
        """Features and derivative of some samples, or of all."""
        w, u, dw, du = differentiated(recording, self.differentiation)
        chosen = slice(None) if rows is None else rows
        memory = self.library.signals(recording.path)
        return self.library(w, u, du, memory)[chosen], dw[chosen]


def rates(
    model: AbstractModel,
    recording: Recording,
    *,
    rows: Rows | None = None,
    differentiation: AbstractDifferentiation = FiniteDifference(),
) -> tuple[Float[Array, " r"], Float[Array, " r"]]:
    """Derivative of a recording's output, and as predicted from the same samples.

    An error of these is no error of a free run: the measured output enters at every
    sample, and nothing adds up.

    **Arguments:**

    - `model`: one whose output is its state.
    - `recording`: of n samples.
    - `rows`: numbers of the samples to look at, all by default.
    - `differentiation`: how derivatives are estimated.

    **Raises:** `InputError` for a model with hidden states.
    """
    if model.hidden:  # of which the flow is none of the output
        raise InputError(
            f"`model` must be a law, whose output is its state; the states of a "
            f"{type(model).__name__} are hidden. Judge it by free run instead."
        )
    w, u, dw, du = differentiated(recording, differentiation)
    chosen = slice(None) if rows is None else rows
    track = Track(model.memory, recording.path)
    now = Signals(recording.t, u, du)
    rate = jax.vmap(model.rate)(w, jax.vmap(track.at)(recording.t), now)
    return dw[chosen], rate[chosen]
