"""Judge a law as fast as it allows."""

from .._judge import Judgement, judge
from .._recording import Recording
from ..models import AbstractModel
from ..simulation import Adaptive, FixedStep


def judged(model: AbstractModel, recording: Recording) -> Judgement:
    """The fixed-step free run, which compiles quickly; where that is lost, the adaptive
    one, since a stiff law is stable for short enough steps."""
    fast = judge(model, recording, method=FixedStep())
    return fast if fast.succeeded else judge(model, recording, method=Adaptive())
