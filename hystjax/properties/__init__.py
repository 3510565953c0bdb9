"""Properties that define hysteresis, as numbers, for any model.

A model is driven along straight lines between turning points, by a `Drive`; each
function says how far the outcome is from a property that an ideal device has.
"""

from ._congruency import incongruency as incongruency
from ._dissipation import Dissipation as Dissipation, dissipation as dissipation
from ._drive import Drive as Drive, Run as Run, run as run
from ._examine import Properties as Properties, examine as examine
from ._memory import memory_loss as memory_loss
from ._monotonicity import Steepness as Steepness, steepness as steepness
from ._rate import rate_dependence as rate_dependence
