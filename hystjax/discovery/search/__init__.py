"""The search for the right terms of a law."""

from ._choice import (
    Support as Support,
    Trial as Trial,
    alike as alike,
    contenders as contenders,
    effective_samples as effective_samples,
    frontier as frontier,
    information_criterion as information_criterion,
    ordered as ordered,
    weights as weights,
)
from ._ranking import (
    Around as Around,
    Choice as Choice,
    OfValue as OfValue,
    Ranking as Ranking,
    extensions as extensions,
    inclusion as inclusion,
    itself as itself,
    output_error as output_error,
    ranking as ranking,
    rankings as rankings,
    supports as supports,
)
