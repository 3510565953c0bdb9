"""The search for the right terms of a law."""

from ._candidate import (
    Candidate as Candidate,
    alike as alike,
    effective_samples as effective_samples,
    frontier as frontier,
    information_criterion as information_criterion,
    ordered as ordered,
    weights as weights,
)
from ._ranking import (
    Choice as Choice,
    Ranking as Ranking,
    extensions as extensions,
    inclusion as inclusion,
    output_error as output_error,
    ranking as ranking,
    rankings as rankings,
    supports as supports,
)
