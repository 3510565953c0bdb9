"""The search for the right terms of a law."""

from ._candidate import (
    Candidate as Candidate,
    alike as alike,
    frontier as frontier,
    information_criterion as information_criterion,
    ordered as ordered,
)
from ._choice import Choice as Choice
from ._effective import effective_samples as effective_samples
from ._extension import extensions as extensions
from ._growth import weights as weights
from ._inclusion import inclusion as inclusion
from ._output_error import output_error as output_error
from ._ranking import (
    Ranking as Ranking,
    ranking as ranking,
    rankings as rankings,
    supports as supports,
)
